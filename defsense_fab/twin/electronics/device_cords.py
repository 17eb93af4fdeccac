"""The cords of a device that moves, as the read-out board's twin reads them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...sensing.response import Response
from .cord_twin import CordTraits, CordTwins

_READ = 1e-3  # of a step: the reading itself


class DeviceCords:
    """c cords whose signals, (R - R0)/R0 of an ideal cord, are `signals_at` (c,) a time, s: they
    answer late, and with noise, as the `traits` say."""

    def __init__(
        self, channels: tuple[str, ...], lengths: Float, signals_at: Callable[[float], Float],
        traits: CordTraits, rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self.channels = channels
        self._signals_at = signals_at
        # What bends them is the ideal signal itself: the response is in it already.
        self._cords = CordTwins(replace(traits, response=Response.line(1.0)), lengths, rng)
        self.rest = self._cords.rest
        self.now = 0.0

    @property
    def cords(self) -> DeviceCords:
        """As a specimen has them."""
        return self

    def hold(self, duration: float, rate: float) -> tuple[Float, Float]:
        """Go on for `duration` s and read at `rate` Hz: times (t,) s, resistances (t, c) ohm."""
        count = max(round(duration * rate), 1)
        step = duration / count
        rows = []
        for _ in range(count):
            self.now += step
            self._cords.bend(self._signals_at(self.now), step * (1 - _READ))
            rows.append(self._cords.hold(step * _READ, 1 / (step * _READ))[1][0])
        return np.asarray(step * np.arange(1, count + 1), float), np.array(rows)
