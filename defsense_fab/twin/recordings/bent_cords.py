"""Cords of a simulated session, which a person can also bend by the poses of the device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import numpy as np

from ...core.arrays import Float
from ..electronics.cords import CordFault, ReplayedCords
from .twin_recordings import Truth

FOLLOW_S = 0.12  # time constant with which the body follows a person's hand
MAX_TOTAL_LEVEL = 1.05  # of all poses together, as in simulated sessions
_MIN_REST_SAMPLES = 20  # of which the noise is estimated
_SEED = 1  # of the noise
_MIN_SIGNAL = 1e-9  # a cord whose signals vary less is not stretched


class BentCords(ReplayedCords):
    """Cords that repeat a session, or that follow levels of poses which a person sets.

    Bent by a person, they have no memory: their resistances rise from rest with the signals, as
    steeply as they do in the session on average, with the noise of its rest. During the rest with
    which the session begins, in which resistances at rest are measured, nobody bends them.

    Args:
        channels: Names of the channels (c).
        truth: The truth about the session.
        poses: Names of the poses that can be set, the first of the d poses of the session.
        signals_at: Returns the signals (n, c) at levels (n, d) of the poses.
        faults: Faults by time.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        truth: Truth,
        poses: tuple[str, ...],
        signals_at: Callable[[Float], Float],
        faults: tuple[CordFault, ...] = (),
    ) -> None:
        super().__init__(channels, truth.sample_time, truth.ohm, faults)
        self.poses = poses
        self._count = truth.weights.shape[1]
        self._signals_at = signals_at
        fits = zip(truth.signals.T, truth.ohm.T, strict=True)
        self._slopes = np.array([_fit_slope(signal, ohm) for signal, ohm in fits])
        moving = np.flatnonzero(truth.weights.any(axis=1))
        moves_from = int(moving[0]) if len(moving) else len(truth.weights)
        self._rest_end = float(truth.sample_time[: moves_from + 1][-1])
        steps = np.diff(truth.ohm[: max(moves_from, _MIN_REST_SAMPLES)], axis=0)
        self._noise, self._rng = steps.std(axis=0) / np.sqrt(2), np.random.default_rng(_SEED)
        self._lock = threading.Lock()
        self._target: Float | None = None
        self._levels, self._time = np.zeros(self._count), 0.0

    def bend(self, levels: Mapping[str, float] | None) -> None:
        """Bend the device to levels of poses, 0 to 1, or let the session continue with None."""
        target = None
        if levels is not None:
            target = np.zeros(self._count)
            for k, name in enumerate(self.poses):
                target[k] = np.clip(levels.get(name, 0.0), 0.0, 1.0)
            target *= min(1.0, MAX_TOTAL_LEVEL / max(float(target.sum()), 1e-9))
        with self._lock:
            if self._target is None:
                self._levels = np.zeros(self._count)
            self._target = target

    def _replay(self, time: float) -> Float:
        with self._lock:
            if self._target is None or time < self._rest_end:
                self._time = time
                return super()._replay(time)
            passed = max(time - self._time, 0.0)
            self._levels += (1 - np.exp(-passed / FOLLOW_S)) * (self._target - self._levels)
            self._time = time
            signals = self._signals_at(self._levels[None])[0]
            noise = self._noise * self._rng.normal(size=len(self._noise))
        return np.asarray(self.rest + self._slopes * signals + noise)


def _fit_slope(signal: Float, ohm: Float) -> float:
    """Return the change of the resistance with the signal, ohm."""
    if np.ptp(signal) < _MIN_SIGNAL:
        return float(ohm.mean())
    return float(np.polyfit(signal, ohm, 1)[0])
