"""Drawings at 1:1 to lay cords on: what is drawn where, in mm, without a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.device.device import Device
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import plane_section
from ...store.layout import LayoutRecord
from ...store.manifest import CordStretch, Manifest
from .assembly.plan import BATCH, anchored_later
from .assembly.steps import Joint
from .assembly.wording import ENDS, called
from .cord_lines import CordLine, cord_line

_BELOW = 0.05  # mm under the face, where its outline is taken


@dataclass(frozen=True)
class Strip:
    """A piece of cord, straight: mm from the end that is crimped first. `mark` is where the other
    ferrule's middle comes, and `length` where the piece ends; `notes` says what to do."""

    title: str
    first: str
    second: str
    mark: float
    length: float
    cord: float
    ferrule: tuple[float, float]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Lying:
    """A stretch of a cord in a face: its line (p, 2) mm, where it is named; ferrules as (middle,
    direction), mm."""

    name: str
    line: Float
    ferrules: tuple[tuple[Float, Float], ...]


@dataclass(frozen=True)
class Face:
    """The face of a joint's lower parts as one looks onto it: outline (m, 2, 2) mm of segments, the
    cords in it, wires (p, 2) mm, pins as (letter, middle (2,), diameter). All from the lower left
    corner; `size` (2,) mm."""

    title: str
    outline: Float
    cords: tuple[Lying, ...]
    wires: tuple[Float, ...]
    pins: tuple[tuple[str, Float, float], ...]
    size: Float
    ferrule: tuple[float, float]
    cord: float


def strips(device: Device, manifest: Manifest) -> tuple[Strip, ...]:
    """One a cord."""
    out = []
    for cord in manifest.cords:
        late = anchored_later(cord)
        first = 0 if late is None else 1 - late
        whole = cord.cut_length * device.cord.ohm_per_mm
        notes = [
            f"cut to {cord.cut_length:.1f} mm: {whole:.0f} ohm"
            f" ({(1 - BATCH) * whole:.0f} to {(1 + BATCH) * whole:.0f}) from end to end",
            f"{cord.unstretched:.1f} mm between the middles of the ferrules, loose:"
            f" {cord.resistance_before:.0f} ohm",
        ]
        if cord.prestretch:
            pull = cord.between_ferrules - cord.unstretched
            notes.append(
                f"stretched by {pull:.1f} mm ({cord.prestretch:.0%}) in the device:"
                f" {cord.resistance:.0f} ohm"
            )
        else:
            notes.append(f"not stretched in the device: {cord.resistance:.0f} ohm")
        out.append(
            Strip(
                called(cord.sensor), ENDS[first], ENDS[1 - first], cord.unstretched,
                cord.cut_length, device.cord.diameter,
                (device.cord.ferrule_diameter, device.cord.ferrule_length), tuple(notes),
            )
        )  # fmt: skip
    return tuple(out)


def face(
    joint: Joint,
    title: str,
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
) -> Face | None:
    """The face of a joint's lower parts with its cords; None where no cord lies in it."""
    cords = [c for c in manifest.cords if any(s.joint == joint.index for s in c.stretches)]
    if not cords:
        return None
    sensor = next(s for s in layout.sensors if s.name == cords[0].sensor)
    frame = _frame(sensor.plane.origin, joint.opens, sensor.points)
    below = Plane(frame.origin - _BELOW * joint.opens, frame.axes)
    outline = np.concatenate([plane_section(parts[n], below) for n in joint.lower])
    lying = [
        _lying(cord_line(layout, c), s, device, frame)
        for c in cords
        for s in c.stretches
        if s.joint == joint.index
    ]
    wires = [_flat(w, frame) for w in joint.wires]
    everything = np.concatenate(
        [outline.reshape(-1, 2), *(x.line for x in lying), *(m[None] for x in lying
                                                             for m, _ in x.ferrules)]
    )  # fmt: skip
    low, high = everything.min(0), everything.max(0)
    kinds = {p.name: p.diameter for p in manifest.pins}
    return Face(
        title,
        outline - low,
        tuple(
            Lying(x.name, x.line - low, tuple((m - low, d) for m, d in x.ferrules)) for x in lying
        ),
        tuple(w - low for w in wires),
        tuple(
            (letter, _flat(p.center[None], frame)[0] - low, kinds[p.name])
            for letter, p in zip(joint.letters, joint.pins, strict=True)
        ),
        high - low,
        (device.cord.ferrule_diameter, device.cord.ferrule_length),
        device.cord.diameter,
    )


def _frame(origin: Float, normal: Float, points: Float) -> Plane:
    """Seen from where `normal` points to; the line through the points' ends lies across."""
    return Plane.from_normal(origin, normal, points[-1] - points[0])


def _flat(points: Float, frame: Plane) -> Float:
    return np.asarray((points - frame.origin) @ frame.axes[:, :2])


def _lying(line: CordLine, stretch: CordStretch, device: Device, frame: Plane) -> Lying:
    ferrules = tuple(
        (
            _flat(line.ferrule(end, device.cord.ferrule_length)[None], frame)[0],
            line.way_out(end) @ frame.axes[:, :2],
        )
        for end in line.ends_in(stretch)
    )
    inner = line.along(stretch.start, stretch.stop, per_mm=2.0)
    return Lying(called(line.cord.sensor), _flat(inner, frame), ferrules)
