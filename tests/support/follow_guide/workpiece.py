"""Locate cords and wires between the parts of a device by rays; no code of the guide is used.

A place of a cord or wire is covered if the parts above and below it belong to one joined piece.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

STEP_MM = 0.5  # distance between places of a cord


@dataclass
class Line:
    """A cord or a wire.

    Attributes:
        pairs: Parts below and above each place; None is outside the body.
        length: Length, mm.
        inserted: Whether each place is in its groove.
    """

    pairs: list[tuple[str | None, str | None]]
    length: float
    inserted: Any = None

    def __post_init__(self) -> None:
        self.inserted = np.zeros(len(self.pairs), bool)

    def between(self, low: set[str], high: set[str]) -> Any:
        """Return which places are between two groups of parts."""
        return np.array(
            [(a in low and b in high) or (a in high and b in low) for a, b in self.pairs]
        )


@dataclass
class Cord:
    """A cord and its state.

    Attributes:
        name: Its name.
        record: Its entry in the manifest.
        line: Its places.
        wires: The wires of its ends; None if an end has no path of a wire.
    """

    name: str
    record: dict[str, Any]
    line: Line
    wires: list[Line | None]
    cut: float | None = None
    marked: bool = False
    trimmed: bool = False
    stretched: bool = False
    crimped: list[bool] = field(default_factory=lambda: [False, False])
    out: list[bool] = field(default_factory=lambda: [False, False])
    let_in: list[bool] = field(default_factory=lambda: [False, False])
    glued: list[bool] = field(default_factory=lambda: [False, False])
    end_set: list[bool] = field(default_factory=lambda: [False, False])
    measured: int = -1

    @property
    def held(self) -> bool:
        """Whether the cord must be stretched between its ends."""
        return bool(self.record["prestretch"])

    def end(self, which: int) -> dict[str, Any]:
        """Return the record of an end."""
        record: dict[str, Any] = self.record["ends"][which]
        return record


def cords_of(
    manifest: dict[str, Any], layout: dict[str, Any], parts: dict[str, Any]
) -> dict[str, Cord]:
    """Return the cords of a manifest and a layout; `parts` are triangles (m, 3, 3) by name."""
    sensors = {s["name"]: s for s in layout["sensors"]}
    out = {}
    for record in manifest["cords"]:
        sensor = sensors[record["sensor"]]
        normal = np.asarray(sensor["plane"]["normal"], float)
        line = line_of(np.asarray(sensor["points"], float), normal, parts)
        wires = [
            None
            if (path := e["wire"].get("path")) is None
            else line_of(np.asarray(path, float), normal, parts)
            for e in record["ends"]
        ]
        out[record["sensor"]] = Cord(record["sensor"], record, line, wires)
    return out


def line_of(points: Any, normal: Any, parts: dict[str, Any]) -> Line:
    """Return the places of a line, with the parts that rays up and down enter first."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    places = np.arange(0.5 * STEP_MM, max(at[-1], STEP_MM), STEP_MM)
    samples = np.stack([np.interp(places, at, points[:, k]) for k in range(3)], axis=1)
    ups, downs = [_entered(samples, sign * normal, parts) for sign in (1, -1)]
    pairs = list(zip(downs, ups, strict=True))
    # Where a ray leaves through a mouth or a hole, the nearest certain place is taken.
    certain = [k for k, (a, b) in enumerate(pairs) if a and b and a != b]
    if certain:
        pairs = [
            p if p[0] and p[1] and p[0] != p[1] else pairs[min(certain, key=lambda n: abs(n - k))]
            for k, p in enumerate(pairs)
        ]
    return Line(pairs, float(at[-1]))


def _entered(samples: Any, direction: Any, parts: dict[str, Any]) -> list[str | None]:
    """Return the part that a ray from each sample enters first."""
    across = np.linalg.svd(direction[None])[2][1:]
    flat, high = samples @ across.T, samples @ direction
    nearest = np.full(len(samples), np.inf)
    entered: list[str | None] = [None] * len(samples)
    for name, corners in parts.items():
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = corners[normal @ direction < 0]  # the ray enters through facets that face it
        xy, z = facing @ across.T, facing @ direction
        low, top = xy.min(1), xy.max(1)
        for k, (p, start) in enumerate(zip(flat, high, strict=True)):
            candidates = np.flatnonzero(
                ((low <= p) & (p <= top)).all(1) & (z.max(1) >= start - 1e-3)
            )
            if not len(candidates):
                continue
            a, b, c = (xy[candidates, i] for i in range(3))
            whole = _area(a, b, c)
            u, v = _area(p, b, c) / whole, _area(a, p, c) / whole
            hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
            heights = u * z[candidates, 0] + v * z[candidates, 1] + (1 - u - v) * z[candidates, 2]
            heights = heights[hit & (heights >= start - 1e-3)]
            if len(heights) and heights.min() < nearest[k]:
                nearest[k], entered[k] = heights.min(), name
    return entered


def _area(a: Any, b: Any, c: Any) -> Any:
    """Return twice the signed area of triangles (..., 2)."""
    one, two = b - a, c - a
    area = one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]
    return np.where(area == 0, 1e-30, area)
