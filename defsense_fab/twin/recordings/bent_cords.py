"""Cords of a simulated session, which a person can also bend by the poses of the device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import numpy as np

from ...core.arrays import Float
from ..electronics.cords import CordFault, ReplayedCords
from ..electronics.rubber_cords import RubberPieces, RubberState
from .twin_recordings import Truth

FOLLOW_S = 0.12  # time constant with which the body follows a person's hand
MAX_TOTAL_LEVEL = 1.05  # of all poses together, as in simulated sessions
_MIN_REST_SAMPLES = 20  # of which the noise is estimated
_SEED = 1  # of the noise


class BentCords(ReplayedCords):
    """Cords that repeat a session, or that follow levels of poses which a person sets.

    Bent by a person, the pieces of cord remember what the session and the person did to them; they
    have the noise of the session's rest, and neither drift nor warm up. During the rest with which
    the session begins, in which resistances at rest are measured, nobody bends them.

    Args:
        channels: Names of the channels (c).
        truth: The truth about the session, which began with new cords.
        poses: Names of the poses that can be set, the first of the d poses of the session.
        signals_at: Returns the signals (n, c) without memory at levels (n, d) of the poses.
        pieces: The pieces of cord.
        faults: Faults by time.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        truth: Truth,
        poses: tuple[str, ...],
        signals_at: Callable[[Float], Float],
        pieces: RubberPieces,
        faults: tuple[CordFault, ...] = (),
    ) -> None:
        super().__init__(channels, truth.sample_time, truth.ohm, faults)
        self.poses = poses
        self._truth, self._signals_at, self._pieces = truth, signals_at, pieces
        moving = np.flatnonzero(truth.weights.any(axis=1))
        moves_from = int(moving[0]) if len(moving) else len(truth.weights)
        self._rest_end = float(truth.sample_time[: moves_from + 1][-1])
        steps = np.diff(truth.ohm[: max(moves_from, _MIN_REST_SAMPLES)], axis=0)
        self._noise, self._rng = steps.std(axis=0) / np.sqrt(2), np.random.default_rng(_SEED)
        self._lock = threading.Lock()
        self._shown: Float = truth.weights[0]
        self._target: Float | None = None
        self._hand: _Hand | None = None

    @property
    def levels(self) -> Float:
        """Levels (d,) of the session's poses at the last sample."""
        with self._lock:
            return self._shown

    def bend(self, levels: Mapping[str, float] | None) -> None:
        """Bend the device to levels of poses, 0 to 1, or let the session continue with None."""
        target = None
        if levels is not None:
            target = np.zeros(self._truth.weights.shape[1])
            for k, name in enumerate(self.poses):
                target[k] = np.clip(levels.get(name, 0.0), 0.0, 1.0)
            target *= min(1.0, MAX_TOTAL_LEVEL / max(float(target.sum()), 1e-9))
        with self._lock:
            self._target = target

    def _replay(self, time: float) -> Float:
        with self._lock:
            if self._target is None or time < self._rest_end:
                self._hand = None
                self._shown = self._truth.weights[self._sample_at(time)]
                return super()._replay(time)
            if self._hand is None:
                self._hand = self._take_in_hand(time)
            ohm = self._hand.move(self._target, time)
            self._shown = self._hand.levels
            return np.asarray(ohm + self._noise * self._rng.normal(size=len(self._noise)))

    def _sample_at(self, time: float) -> int:
        """Return the index of the session's sample at a time, s."""
        times = self._truth.sample_time
        return min(int(np.searchsorted(times, self._position(time))), len(times) - 1)

    def _take_in_hand(self, time: float) -> _Hand:
        """Return the device as the session has left it at a time, s."""
        t, pieces = self._truth, self._pieces
        count = self._sample_at(time) + 1
        past, state = t.signals[:count], RubberState.new(pieces.traits, len(pieces.ohm)).memory
        _, state = pieces.respond(t.sample_time[:count], past, state)
        return _Hand(
            pieces, self.rest, self._signals_at, t.weights[:count][-1], past[-1], state, time
        )


class _Hand:
    """A device that a person holds, at levels (d,) of poses, with the memory of its cords."""

    def __init__(
        self,
        pieces: RubberPieces,
        rest: Float,
        signals_at: Callable[[Float], Float],
        levels: Float,
        signals: Float,
        state: tuple[Float, ...],
        time: float,
    ) -> None:
        self._pieces, self._rest, self._signals_at = pieces, rest, signals_at
        self.levels, self._signals, self._state, self._time = levels, signals, state, time

    def move(self, target: Float, time: float) -> Float:
        """Move on towards levels (d,) of the poses; return the resistances (c,) ohm."""
        passed = max(time - self._time, 0.0)
        self.levels = self.levels - np.expm1(-passed / FOLLOW_S) * (target - self.levels)
        signals = self._signals_at(self.levels[None])[0]
        step = np.array([0.0, passed])
        change = np.array([self._signals, signals])
        response, self._state = self._pieces.respond(step, change, self._state)
        self._signals, self._time = signals, time
        return np.asarray(self._rest * (1 + response[-1]))
