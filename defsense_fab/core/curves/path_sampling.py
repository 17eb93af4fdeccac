"""Points along the paths of cords: how many there are, and where along the length they lie.

A path is a planar Hermite curve. Its points lie at a uniform curve parameter, the same number in
every span, so that they depend linearly on control points and tangents: the optimiser's derivatives
rest on that. How many are needed depends on the use: a number in all for signals, a spacing for
distances, a sag for solids. What has to lie evenly along the length is resampled from them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..arrays import Float
from .curve import Hermite, Plane, hermite_basis

#: A path has at least this many points for its signal, and in `layout.json`.
SAMPLES = 120


class PlanarPath(Protocol):
    """What has a path: a curve in a plane, as a device's sensors are."""

    @property
    def plane(self) -> Plane: ...

    @property
    def curve(self) -> Hermite: ...


def per_span_for_signal(curve: Hermite) -> int:
    """Points of each span, for at least `SAMPLES` in all."""
    return int(np.ceil(SAMPLES / (len(curve.points) - 1)))


def per_span_for_spacing(curve: Hermite, spacing: float) -> int:
    """Points of each span, 32 to 2000, for neighbours at most about `spacing` mm apart."""
    coarse = curve.sample(16)
    longest = np.linalg.norm(np.diff(coarse, axis=0), axis=1).max() * 16
    return int(np.clip(longest / spacing, 32, 2000))


def per_span_for_sag(curve: Hermite, sag: float) -> int:
    """Points of each span, 8 to 400, for chords that lie within `sag` mm of the curve."""
    second = hermite_basis(len(curve.points), 4)[2]
    bend = np.linalg.norm(second @ np.concatenate([curve.points, curve.tangents]), axis=1).max()
    return int(np.clip(np.ceil(np.sqrt(bend / (8 * sag))), 8, 400))


def sample_path(path: PlanarPath, per_span: int | None = None) -> Float:
    """The path's points (p, 3) mm in the rest frame, `per_span` of each span of the curve; by
    default those of its signal and of `layout.json`, p > 100."""
    count = per_span_for_signal(path.curve) if per_span is None else per_span
    return path.plane.to_world(path.curve.sample(count))


def arc_lengths(points: Float) -> Float:
    """Length along polylines (..., p, d) from their first point to each point: (..., p), mm."""
    step = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    return np.concatenate([np.zeros((*step.shape[:-1], 1)), np.cumsum(step, axis=-1)], axis=-1)


def resample(points: Float, start: float, end: float, count: int) -> Float:
    """`count` points (count, d) of a polyline (p, d), evenly along its length between the arc
    lengths `start` and `end` mm from its first point."""
    along, at = arc_lengths(points), np.linspace(start, end, count)
    return np.stack([np.interp(at, along, column) for column in points.T], axis=1)
