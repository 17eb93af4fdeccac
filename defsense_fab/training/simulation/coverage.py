"""Which parts of the pose space a recording has shown, and what to show next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ..ridge.frames import Frames
from .prior import Prior

_NEAR = 0.25  # of how far a state is from rest: a picture that is nearer shows it
_LEAST = 1.0  # mm
_REST = 5.0  # s at the end, in which a device at rest shows how cords drifted
_BLOCK = 500  # pictures compared at once
_TOLD = 3  # states that are asked for


@dataclass(frozen=True)
class Coverage:
    """Simulated states by `names` (s,), how near pictures came to each, mm (s,), which were `seen`
    (s,), whether the recording ends at rest, and what to do next."""

    names: tuple[str, ...]
    nearest: Float
    seen: Bool
    ends_at_rest: bool
    advice: tuple[str, ...]

    @property
    def share(self) -> float:
        """Of the states but rest."""
        return float(self.seen[1:].mean()) if len(self.seen) > 1 else 1.0


def coverage(frames: Frames, prior: Prior) -> Coverage:
    """Of the frames' markers against the states of the simulation, rest first."""
    moved = frames.points - frames.dataset.rest_points
    away = np.sqrt((prior.displacements**2).sum(2).mean(1))
    nearest = np.full(len(away), np.inf)
    for k in range(0, len(moved), _BLOCK):
        part = moved[k : k + _BLOCK, None] - prior.displacements
        with np.errstate(all="ignore"):
            off = np.sqrt(np.nanmean((part**2).sum(3), axis=2))
        nearest = np.minimum(nearest, np.nanmin(off, axis=0))
    seen = nearest <= np.maximum(_NEAR * away, _LEAST)
    last = frames.of == frames.of[-1]
    time = frames.time
    end = last & (time > time[last][-1] - _REST)
    with np.errstate(all="ignore"):
        rested = np.sqrt(np.nanmean((moved[end] ** 2).sum(2), axis=1))
    ends = bool(np.median(rested) <= max(_LEAST, 0.1 * float(away.max())))
    return Coverage(prior.names, nearest, seen, ends, _advice(prior, nearest, seen, ends))


def _advice(prior: Prior, nearest: Float, seen: Bool, ends_at_rest: bool) -> tuple[str, ...]:
    missing = np.flatnonzero(~seen[1:]) + 1
    # What is farthest from all that was shown, first.
    order = missing[np.argsort(-nearest[missing])]
    out = [
        f"show {prior.names[k]}: pictures came within {nearest[k]:.1f} mm" for k in order[:_TOLD]
    ]
    if len(order) > _TOLD:
        out.append(f"{len(order) - _TOLD} more states were not shown")
    if not seen[0]:
        out.append("rest for 10 s at the beginning")
    if not ends_at_rest:
        out.append("rest for 10 s at the end: it shows how the cords drifted")
    return tuple(out)
