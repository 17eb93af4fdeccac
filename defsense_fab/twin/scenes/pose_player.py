"""The hands that move a device's twin: told which pose to show, they show it."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from .device_motion import Motion, Ramp, wander

REST, FREE = "rest", "free"
_CYCLE = 4.0  # s, for a pose from rest to full and back
_REACT = 0.4  # s, until hands move, and by which they are back before the time is over


@dataclass(frozen=True)
class _Show:
    start: float
    end: float
    name: str
    reach: float
    motion: Motion | None


class PosePlayer:
    """Levels of poses by time, s; each show begins and ends at rest."""

    def __init__(self, ramps: Sequence[Ramp], seed: int = 0) -> None:
        self._ramps, self._rng = tuple(ramps), np.random.default_rng(seed)
        self._names = [r.name for r in ramps]
        self._shows: list[_Show] = []
        self._lock = threading.Lock()

    def perform(self, name: str, start: float, seconds: float) -> None:
        """Show a pose, `rest`, or a `free` mixture of them, for so long from `start`, s."""
        first, last = start + _REACT, start + max(seconds - _REACT, 2 * _REACT)
        motion = None
        if name == FREE:
            motion = wander(self._ramps, last - first, self._rng, pace=0.9, pause=0.2)
        with self._lock:
            self._shows.append(_Show(first, last, name, self._rng.uniform(0.9, 1.0), motion))

    def levels(self, time: float) -> Mapping[str, float]:
        """Of each pose, 0 to 1."""
        with self._lock:
            show = next((s for s in reversed(self._shows) if s.start <= time < s.end), None)
        out = dict.fromkeys(self._names, 0.0)
        if show is None or show.name == REST:
            return out
        into, left = time - show.start, show.end - time
        if show.motion is not None:
            found = show.motion.levels(into)
            near = min(1.0, left / 0.8)  # back to rest at the end
            calm = near * near * (3 - 2 * near)
            return {n: float(v) * calm for n, v in zip(self._names, found, strict=True)}
        if show.name in out:
            cycles = max(1, round((show.end - show.start) / _CYCLE))
            phase = np.pi * cycles * into / (show.end - show.start)
            out[show.name] = show.reach * float(np.sin(phase)) ** 2
        return out

    def weights(self, time: float) -> Float:
        """Of the simulated states (s,)."""
        size = 1 + max((int(r.states.max()) for r in self._ramps), default=-1)
        out = np.zeros(size)
        levels = self.levels(time)
        for ramp in self._ramps:
            level = levels[ramp.name]
            if level:
                out[ramp.states] += ramp.weights(np.array(level))
        return out
