"""Place the cords, wires, pins and marker seats of the 3D view, which move along with parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import igl
import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...core.device.device import Device
from ...core.device.filaments import TraceSpec
from ...core.mesh import Surface
from ...store.layout import CordRecord, LayoutRecord
from ...store.manifest import CutCord, Manifest, PinRecord

CORD, WIRE, PIN, SEAT = "cord", "wire", "pin", "seat"
_POINT_SPACING_MM = 1.5  # of a cord
_MIN_POINTS, _MAX_POINTS = 8, 96  # of a cord
_SAME_DISTANCE_MM = 0.5  # a point this close to two parts is between them
_SMOOTHING_SHARE = 0.04  # of a cord's length, over which it passes from one part to another


@dataclass(frozen=True)
class Follower:
    """A thing that moves along with parts.

    Attributes:
        kind: One of "cord", "wire", "pin" and "seat".
        name: Name of the thing.
        points: Middle line (p, 3) of a tube, or corners (4, 3) of a flat thing, mm.
        radius: Radius of the tube, mm; 0 for a flat thing.
        facts: Labels and values that the view shows.
    """

    kind: str
    name: str
    points: Float
    radius: float
    facts: tuple[tuple[str, str], ...]

    @property
    def bends(self) -> bool:
        """Whether different points can follow different parts."""
        return self.kind in (CORD, WIRE)


def followers(device: Device, layout: LayoutRecord, manifest: Manifest) -> list[Follower]:
    """Return all followers of a device: cords in the layout's order, wires, pins and seats."""
    cut = {c.sensor: c for c in manifest.cords}
    return [
        *(_cord(s, cut[s.name], device.cord.trace) for s in layout.sensors),
        *(w for c in manifest.cords for w in _wires(c, device.fabrication.wire_diameter / 2)),
        *_pins(manifest),
        *_seats(manifest),
    ]


def _cord(cord: CordRecord, cut: CutCord, trace: TraceSpec | None) -> Follower:
    low, high = cut.range
    thickness = f"{cord.cord_diameter:g} mm thick"
    fixing = (
        "glued along its whole length"
        if cord.prestretch is None
        else f"stretched by {100 * cord.prestretch:.0f} % when it is inserted"
    )
    made = ("cut to", f"{cut.cut_length:.0f} mm, {fixing}")
    if trace is not None:
        thickness = f"{trace.width:g} mm wide, {trace.height:g} mm high"
        made = ("printed in", trace.filament)
    return Follower(
        CORD,
        cord.name,
        _line(cord.points),
        cord.cord_diameter / 2,
        (
            ("path", f"{cord.length:.1f} mm long, {thickness}"),
            made,
            ("strain in use", f"{100 * cord.least_strain:.1f} to {100 * cord.peak_strain:.1f} %"),
            ("resistance at rest", f"{cut.resistance:.0f} Ω"),
            ("resistance in use", f"{low:.0f} to {high:.0f} Ω"),
            ("reference resistor", f"{cut.reference_resistor:g} Ω"),
        ),
    )


def _wires(cord: CutCord, radius: float) -> Iterator[Follower]:
    for end, end_name in zip(cord.ends, ("start", "end"), strict=True):
        line = end.wire.line
        if line is not None:
            facts = (
                ("leaves by", end.wire.leaves),
                ("length in the body", f"{end.wire.length:.1f} mm"),
            )
            yield Follower(WIRE, f"{cord.sensor}, {end_name}", _line(line), radius, facts)


def _pins(manifest: Manifest) -> Iterator[Follower]:
    kinds: Mapping[str, PinRecord] = {p.name: p for p in manifest.pins}
    for step in manifest.assembly:
        for pin in step.pins:
            kind, direction = kinds[pin.name], step.opens / np.linalg.norm(step.opens)
            ends = pin.center + kind.length / 2 * np.array([[-1.0], [1.0]]) * direction
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
    """Resample a line to as many points as a picture of it needs."""
    length = float(arc_lengths(points)[-1])
    return resample(
        points, 0.0, length, int(np.clip(length / _POINT_SPACING_MM, _MIN_POINTS, _MAX_POINTS))
    )


def follower_movements(
    followers: Sequence[Follower], parts: Mapping[str, Surface], part_movements: Float
) -> list[Float]:
    """Return the movement of each follower's points when each joint opens.

    A point moves with the part that contains it, or with the average of the parts around it.

    Args:
        followers: The followers.
        parts: Surfaces of the parts, by name.
        part_movements: Displacement of each part (steps, parts, 3), mm.

    Returns:
        For each follower, displacements (steps, p, 3), mm.
    """
    if not followers:
        return []
    counts = [len(f.points) for f in followers]
    points = np.concatenate([f.points for f in followers])
    squared = [
        igl.point_mesh_squared_distance(points, s.vertices, s.faces)[0] for s in parts.values()
    ]
    distances = np.sqrt(np.maximum(np.transpose(squared), 0))
    shares = (distances <= distances.min(axis=1, keepdims=True) + _SAME_DISTANCE_MM).astype(float)
    shares /= shares.sum(axis=1, keepdims=True)
    pieces = np.split(shares, np.cumsum(counts)[:-1])
    return [
        np.einsum("pn,snj->spj", _smooth_shares(f, piece), part_movements)
        for f, piece in zip(followers, pieces, strict=True)
    ]


def _smooth_shares(follower: Follower, shares: Float) -> Float:
    """Smooth the shares (p, parts) along things that bend; average those of other things."""
    if not follower.bends:
        return np.broadcast_to(shares.mean(axis=0), shares.shape)
    positions = arc_lengths(follower.points)
    weights = np.exp(
        -(
            (
                (positions[:, None] - positions)
                / (_SMOOTHING_SHARE * max(float(positions[-1]), 1e-9))
            )
            ** 2
        )
    )
    return np.asarray(weights @ shares / weights.sum(axis=1, keepdims=True))
