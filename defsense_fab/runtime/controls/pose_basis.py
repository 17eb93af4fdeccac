"""How a device's markers move in each of its poses, from rest to the full pose and beyond."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import ControlError

_OPPOSITE = -0.5  # cosine between two poses' first movements below which one undoes the other


@dataclass(frozen=True)
class PoseRamp:
    """One pose at several amplitudes (k,), which rise, 1 being the full pose: displacements
    (k, m, 3) mm of the markers from rest. Rest itself may be left out."""

    amplitudes: Float
    displacements: Float

    def __post_init__(self) -> None:
        a, u = self.amplitudes, self.displacements
        if a.ndim != 1 or u.ndim != 3 or u.shape[::2] != (len(a), 3) or not len(a):
            raise ControlError(
                "a pose needs displacements (k, m, 3) at k amplitudes, not of shapes"
                f" {a.shape} and {u.shape}",
                code="shape-mismatch",
            )
        if not (np.isfinite(a).all() and np.isfinite(u).all()):
            raise ControlError(
                "a pose's amplitudes and displacements must be finite", code="not-finite"
            )
        if a[0] < 0 or (np.diff(a) <= 0).any() or a[-1] <= 0:
            raise ControlError(
                "a pose's amplitudes must be positive and strictly increasing",
                code="not-increasing",
            )
        if a[0] == 0 and u[0].any():
            raise ControlError(
                "at amplitude 0 a pose must not move its markers", code="rest-displaced"
            )


@dataclass(frozen=True)
class PoseBasis:
    """Poses by their names. Between its amplitudes a pose runs along parabolas that meet smoothly
    (cubic Hermite, slopes of the parabola through three neighbours), beyond its last one straight
    on.

    Packed for compiled functions: `knots` (p, k), of which the first `counts` (p,) of each pose are
    used, `values` and `slopes` (p, k, m, 3). `opposites` (p, p) are the pairs of which one undoes
    the other, such as bending up and down."""

    names: tuple[str, ...]
    ramps: tuple[PoseRamp, ...]
    knots: Float = field(init=False, repr=False)
    counts: Int = field(init=False, repr=False)
    values: Float = field(init=False, repr=False)
    slopes: Float = field(init=False, repr=False)
    opposites: Bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) != len(self.names):
            raise ControlError("poses need different names, at least one", code="names-not-unique")
        if len(self.names) != len(self.ramps):
            raise ControlError(
                f"{len(self.names)} names for {len(self.ramps)} poses", code="counts-differ"
            )
        markers = {ramp.displacements.shape[1] for ramp in self.ramps}
        if len(markers) != 1 or not max(markers):
            raise ControlError(
                "all poses must move the same markers, at least one", code="markers-differ"
            )
        begun = [_from_rest(ramp) for ramp in self.ramps]
        counts = np.array([len(a) for a, _ in begun])
        shape = (len(begun), int(counts.max()))
        knots = np.zeros(shape)
        values, slopes = np.zeros((2, *shape, *begun[0][1].shape[1:]))
        for p, (a, u) in enumerate(begun):
            knots[p, : len(a)], values[p, : len(a)] = a, u
            slopes[p, : len(a)] = _slopes(a, u)
        for name, value in (
            ("knots", knots),
            ("counts", counts),
            ("values", values),
            ("slopes", slopes),
            ("opposites", _opposites(slopes[:, 0])),
        ):
            object.__setattr__(self, name, value)

    def displacements(self, amplitudes: Sequence[float] | Float) -> Float:
        """(m, 3) mm: the poses' displacements at these amplitudes (p,), added up."""
        from .least_squares import add_poses

        jacobian = np.empty((len(self.names), *self.values.shape[2:]))
        total = np.zeros(self.values.shape[2:])
        a = np.asarray(amplitudes, float)
        add_poses(a, self.knots, self.counts, self.values, self.slopes, total, jacobian)
        return total


def _from_rest(ramp: PoseRamp) -> tuple[Float, Float]:
    a, u = ramp.amplitudes, ramp.displacements
    if a[0] == 0:
        return a, u
    return np.insert(a, 0, 0.0), np.concatenate([np.zeros_like(u[:1]), u])


def _slopes(a: Float, u: Float) -> Float:
    """(k, m, 3) mm per amplitude, at each of k."""
    step = np.diff(a)[:, None, None]
    chord = np.diff(u, axis=0) / step
    if len(chord) == 1:
        return np.concatenate([chord, chord])
    inner = (step[1:] * chord[:-1] + step[:-1] * chord[1:]) / (step[:-1] + step[1:])
    first, last = 2 * chord[0] - inner[0], 2 * chord[-1] - inner[-1]
    return np.concatenate([first[None], inner, last[None]])


def _opposites(first: Float) -> Bool:
    """(p, p) of the poses' movements (p, m, 3) as they begin."""
    flat = first.reshape(len(first), -1)
    size = np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    cosine = (flat / size) @ (flat / size).T
    return np.asarray(cosine < _OPPOSITE)
