"""Devices made up of blocks: a box divided along cords' planes in a random order, as manifests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.mesh import Surface
from defsense_fab.core.storage.typed_json import to_json
from defsense_fab.geometry.channels.cord_assembly import find_late_joints, find_stretches
from defsense_fab.store.manifest import (
    CordEnd,
    CutCord,
    JoinedPin,
    JoinStep,
    JointStretch,
    Manifest,
    PartRecord,
    PinRecord,
    Plate,
    WireRecord,
)
from defsense_fab.workflow.build.cut_list import last_end
from tests.conftest import box_surface
from tests.support.places import BAR

_SIZE, _FERRULE = 60.0, 7.0
_PINS = (
    PinRecord("pin-5x12.0", "p.stl", 2, 5.0, 12.0),
    PinRecord("pin-4x9.0", "q.stl", 2, 4.0, 9.0),
)


@dataclass(frozen=True)
class Blocks:
    """A device of blocks, with the data that an assembler of its guide needs."""

    device: object
    manifest: Manifest
    parts: dict[str, Surface]
    layout: dict[str, object]

    def plain(self):
        return to_json(self.manifest)

    def triangles(self):
        return {n: s.vertices[s.faces] for n, s in self.parts.items()}


def blocks(seed=0, cords=3, assembly="held", ends=None, pins=True):
    """Return a device with up to three cords, each in a plane of another direction.

    `ends` has for each cord two kinds ("mouth", "bend" or "outside"); None chooses random ones.
    """
    rng = np.random.default_rng(seed)
    boxes, joints, within = [], [], []
    order = rng.permutation(cords)
    lines = [_path(rng, axis) for axis in range(cords)]

    def divide(low, high, todo):
        for n, axis in enumerate(todo):
            inside = (lines[axis] > low - 1e-9) & (lines[axis] < high + 1e-9)
            if not inside.all(axis=1).any() or not low[axis] < 0 < high[axis]:
                continue
            start = len(boxes)
            top, foot = high.copy(), low.copy()
            top[axis] = foot[axis] = 0.0
            divide(low, top, todo[n + 1 :])
            middle = len(boxes)
            divide(foot, high, todo[n + 1 :])
            joints.append((set(range(start, middle)), set(range(middle, len(boxes)))))
            within.append(axis)
            return
        boxes.append((low, high))

    half = np.full(3, _SIZE / 2)
    divide(-half, half, list(order))
    surfaces = [box_surface(*box) for box in boxes]
    names = [f"{k + 1}-block" for k in range(len(boxes))]
    kinds = ends or rng.choice(["mouth", "bend", "outside"], (cords, 2))
    cut_cords = [
        _cord(k, lines[k], surfaces, joints, within, kinds[k], assembly) for k in range(cords)
    ]
    manifest = Manifest(
        device="blocks",
        unit="mm",
        parts=tuple(
            PartRecord(n, k + 1, f"{n}.stl", f"print/{n}.stl", None, s.volume, s.bounds, ())
            for k, (n, s) in enumerate(zip(names, surfaces, strict=True))
        ),
        pins=_PINS if pins and joints else (),
        plates=(Plate("plate.3mf", {n: s.bounds for n, s in zip(names, surfaces, strict=True)}),),
        cords=tuple(cut_cords),
        assembly_of_cords=assembly,
        bill=(),
        assembly=tuple(
            JoinStep(
                (tuple(names[i] for i in sorted(a)), tuple(names[i] for i in sorted(b))),
                (f"cord-{axis}",),
                (),
                np.eye(3)[axis],
                _pins(a, b, names, axis) if pins else (),
            )
            for (a, b), axis in zip(joints, within, strict=True)
        ),
        marker_seats=(),
        checks=(),
        prediction=None,
        removed_volume=0.0,
        body_volume=_SIZE**3,
        warnings=(),
    )
    planes = [{"normal": normal.tolist()} for normal in np.eye(3)]
    sensors = [
        {"name": f"cord-{k}", "points": line.tolist(), "plane": planes[k]}
        for k, line in enumerate(lines)
    ]
    parts = dict(zip(names, surfaces, strict=True))
    return Blocks(load_device(BAR), manifest, parts, {"sensors": sensors})


def _path(rng, axis):
    """Return a path across the box in the plane in which a coordinate is 0."""
    x = np.linspace(-_SIZE / 2, _SIZE / 2, 61)
    y = rng.uniform(5, 12) * np.sin(x / 30 * rng.uniform(1, 2.5) + rng.uniform(0, 6)) + 8
    out = np.zeros((61, 3))
    out[:, (axis + 1) % 3], out[:, (axis + 2) % 3] = x, y
    return out


def _pins(low, high, names, axis):
    pair = (names[min(low)], names[min(high)])
    at = np.full(3, 20.0)
    at[axis] = 0.0
    return (JoinedPin("pin-5x12.0", at, 5.2, 6.3, pair), JoinedPin("pin-4x9.0", -at, 4.2, 5, pair))


def _cord(k, line, surfaces, joints, within, kinds, assembly):
    own = [j for j, axis in enumerate(within) if axis == k]
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    stretches = find_stretches(line, np.eye(3)[k], 1.1, surfaces, joints, own) if own else ()
    drawn = find_late_joints(stretches, joints)
    ends = []
    for end, kind in enumerate(kinds):
        at, depth = line[-end], 0.0 if kind == "outside" else 7.0 if kind == "mouth" else 11.0
        path = None
        wire_stretches = ()
        if kind == "bend" and own:
            inner = line[8 if end == 0 else -9]
            path = np.stack([inner, inner + 0.3 * (at - inner) + 2 * np.eye(3)[(k + 2) % 3]])
            wire_stretches = find_stretches(path, np.eye(3)[k], 0.6, surfaces, joints, own)
        length_in_body = 6.0 if path is not None else 0.0
        wire = WireRecord(kind, length_in_body, path, stretches=recorded(wire_stretches))
        joint, lead = ("free", 20.0) if kind == "outside" else ("pocket", 0.0)
        ends.append(CordEnd(joint, depth, at, lead, wire))
    late, after = last_end(stretches, drawn, ends)
    stretch = 0.04 if assembly == "held" else None
    between = length - sum(e.pocket - _FERRULE / 2 if e.pocket else -e.lead for e in ends)
    loose = between / (1 + (stretch or 0.0))
    slack = 5.0
    if late is not None:
        ends[late] = replace(ends[late], after=after)
        slack = 45.0
    return CutCord(
        f"cord-{k}",
        loose + _FERRULE + slack,
        slack,
        length,
        between,
        loose,
        stretch,
        between,
        tuple(ends),
        2.2,
        14.5 * loose,
        14.5 * between * 1.04,
        (900.0, 1300.0),
        1100.0,
        recorded(stretches),
        tuple(drawn),
    )


def recorded(stretches):
    return tuple(JointStretch(s.joint, s.start, s.stop) for s in stretches)
