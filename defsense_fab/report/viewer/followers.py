"""What goes with the body: cords, wires, pins and marker seats, each as a few points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import igl
import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...core.device.device import Device
from ...core.mesh import Surface
from ...store.layout import CordRecord, LayoutRecord
from ...store.manifest import CutCord, JoinStep, Manifest, PinRecord

# How a device opens: the joints in the reverse of the order in which they are closed.

_OPENED = 0.1  # of the device's size: how far either side of a joint goes
_NEAR = 0.5  # mm further off than the nearest part: a cord lies between both
_SOFT = 0.04  # of a cord's length: how soon it goes from one part's way to another's


def openings(steps: Sequence[JoinStep], names: Sequence[str], size: float) -> Float:
    """Where the joints take the parts `names` as they open, (steps, parts, 3) mm: either side along
    the normal of the cut."""
    out = np.zeros((len(steps), len(names), 3))
    for k, step in enumerate(steps):
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                out[k, list(names).index(name)] = sign * _OPENED * size * step.opens
    return out


def move_with_parts(
    followers: Sequence[Follower], parts: Mapping[str, Surface], ways: Float
) -> list[Float]:
    """Where the joints take the points (p, 3) of each follower, (steps, p, 3) mm, as they open by
    the `ways` (steps, parts, 3) mm of the parts: with the parts that they lie in or between."""
    if not followers:
        return []
    counts = [len(f.points) for f in followers]
    points = np.concatenate([f.points for f in followers])
    squared = [
        igl.point_mesh_squared_distance(points, s.vertices, s.faces)[0] for s in parts.values()
    ]
    away = np.sqrt(np.maximum(np.transpose(squared), 0))
    near = (away <= away.min(axis=1, keepdims=True) + _NEAR).astype(float)
    near /= near.sum(axis=1, keepdims=True)
    pieces = np.split(near, np.cumsum(counts)[:-1])
    return [
        np.einsum("pn,snj->spj", _evened(f, piece), ways)
        for f, piece in zip(followers, pieces, strict=True)
    ]


def _evened(follower: Follower, near: Float) -> Float:
    """Shares (p, parts): of what bends they change little by little, of others not."""
    if not follower.bends:
        return np.broadcast_to(near.mean(axis=0), near.shape)
    at = arc_lengths(follower.points)
    soft = np.exp(-(((at[:, None] - at) / (_SOFT * max(float(at[-1]), 1e-9))) ** 2))
    return np.asarray(soft @ near / soft.sum(axis=1, keepdims=True))


CORD, WIRE, PIN, SEAT = "cord", "wire", "pin", "seat"
_SPACING = 1.5  # mm, between points of a cord
_MOST = 96  # points of a cord


@dataclass(frozen=True)
class Follower:
    """What moves along with parts, of a kind with a name; the middle line (p, 3) mm of a tube of a
    `radius` mm, or the corners (4, 3) mm of a flat one, whose radius is 0; what is told of it,
    label and value."""

    kind: str
    name: str
    points: Float
    radius: float
    facts: tuple[tuple[str, str], ...]

    @property
    def bends(self) -> bool:
        """Whether it can go with one part here and with another there."""
        return self.kind in (CORD, WIRE)


def followers(device: Device, layout: LayoutRecord, manifest: Manifest) -> list[Follower]:
    """All of a device, cords first, in the order of the layout's."""
    cut = {c.sensor: c for c in manifest.cords}
    return [
        *(_cord(s, cut[s.name]) for s in layout.sensors),
        *(w for c in manifest.cords for w in _wires(c, device.fabrication.wire_diameter / 2)),
        *_pins(manifest),
        *_seats(manifest),
    ]


def _cord(cord: CordRecord, cut: CutCord) -> Follower:
    low, high = cut.range
    laid = (
        "glued in all along" if cord.prestretch is None
        else f"stretched by {100 * cord.prestretch:.0f} % as it is laid"
    )  # fmt: skip
    return Follower(
        CORD,
        cord.name,
        _line(cord.points),
        cord.cord_diameter / 2,
        (
            ("path", f"{cord.length:.1f} mm long, {cord.cord_diameter:g} mm thick"),
            ("cut to", f"{cut.cut_length:.0f} mm, {laid}"),
            ("strain in use", f"{100 * cord.least_strain:.1f} to {100 * cord.peak_strain:.1f} %"),
            ("at rest", f"{cut.resistance:.0f} Ω"),
            ("in use", f"{low:.0f} to {high:.0f} Ω"),
            ("reference resistor", f"{cut.reference_resistor:g} Ω"),
        ),
    )


def _wires(cord: CutCord, radius: float) -> Iterator[Follower]:
    for end, what in zip(cord.ends, ("start", "end"), strict=True):
        line = end.wire.line
        if line is not None:
            facts = (
                ("leaves by the", end.wire.leaves),
                ("in the body", f"{end.wire.length:.1f} mm"),
            )
            yield Follower(WIRE, f"{cord.sensor}, {what}", _line(line), radius, facts)


def _pins(manifest: Manifest) -> Iterator[Follower]:
    kinds: Mapping[str, PinRecord] = {p.name: p for p in manifest.pins}
    for step in manifest.assembly:
        for pin in step.pins:
            kind, along = kinds[pin.name], step.opens / np.linalg.norm(step.opens)
            ends = pin.center + kind.length / 2 * np.array([[-1.0], [1.0]]) * along
            facts = (
                ("size", f"{kind.diameter:g} mm thick, {kind.length:g} mm long"),
                ("socket", f"{pin.socket:g} mm, {pin.depth:g} mm deep"),
                ("between", " and ".join(pin.between)),
            )
            yield Follower(PIN, pin.name, ends, kind.diameter / 2, facts)


def _seats(manifest: Manifest) -> Iterator[Follower]:
    for seat in manifest.marker_seats:
        x = seat.x_axis * seat.tag / 2
        y = np.cross(seat.normal, x)
        corners = seat.center + np.array([-x - y, x - y, x + y, y - x])
        facts = (("tag", f"{seat.tag:g} mm wide"),)
        yield Follower(SEAT, f"tag {seat.marker}", corners, 0.0, facts)


def _line(points: Float) -> Float:
    """As many points as a picture of a line needs."""
    length = float(arc_lengths(points)[-1])
    return resample(points, 0.0, length, int(np.clip(length / _SPACING, 8, _MOST)))
