"""Pieces of rubber cord that answer to strain as real ones do: late, and not twice alike.

R = R0 (1 + drift) (1 + g (p + y) + noise). p follows the response w(eps) with play, as several
loose gears do (the Prandtl-Ishlinskii operator): hysteresis. y is the resistance that any change of
strain adds, for it tears the filler's network, and that heals, part of it slowly: relaxation; after
release a cord reads too high, too. g is the piece's own gain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...sensing.response import Response


@dataclass(frozen=True)
class CordTraits:
    """What pieces of one cord have in common: the `response`; `noise`, the standard deviation of
    one reading of (R - R0)/R0; half the `play` of hysteresis, in the same unit; `healing`, the
    fraction of any change that is added at first, and the time constant `time`, s, by which most of
    it heals; `spread`, the standard deviation of the pieces' gains; R0 per mm; `drift` of R per
    hour."""

    response: Response
    noise: float = 0.002
    play: float = 0.003
    healing: float = 0.1
    time: float = 8.0
    spread: float = 0.02
    ohm_per_mm: float = 14.5
    drift: float = 0.0


#: Of the gears: their play, in that of the cord; of the healing: time constants, in that of the
#: cord, and shares.
_PLAYS = np.array([0.5, 1.0, 1.5])[:, None]
_TIMES, _SHARES = np.array([1.0, 6.0])[:, None], np.array([0.8, 0.2])[:, None]


class CordTwins:
    """c pieces of cord: their strains change with time, their resistances follow."""

    def __init__(self, traits: CordTraits, lengths: Float, rng: np.random.Generator) -> None:
        """`lengths` (c,) mm."""
        self._traits, self._rng = traits, rng
        count = len(lengths)
        self.gain = 1 + traits.spread * rng.normal(size=count)
        self.rest = (
            traits.ohm_per_mm * np.asarray(lengths, float) * (1 + 0.05 * rng.normal(size=count))
        )
        self.now = 0.0
        self._strain = np.zeros(count)
        self._play, self._added = np.zeros((3, count)), np.zeros((2, count))

    def bend(self, strain: Float, within: float = 1.0) -> None:
        """Go to the strains (c,) steadily, in so many s."""
        t = self._traits
        before, after = t.response(self._strain), t.response(strain)
        play = _PLAYS * t.play
        self._play = np.clip(self._play, after - play, after + play)
        # y' = rate - y / time, for the rate that tears `healing` of the whole change.
        time = _TIMES * t.time
        keep = np.exp(-within / time)
        rate = _SHARES * t.healing * np.abs(after - before) / within
        self._added = self._added * keep + rate * time * (1 - keep)
        self._strain = np.asarray(strain, float)
        self.now += within

    def hold(self, duration: float, rate: float) -> tuple[Float, Float]:
        """Readings at `rate` Hz for `duration` s: times since now (t,) s, resistances (t, c)
        ohm."""
        t = self._traits
        time = np.arange(1, max(round(duration * rate), 1) + 1) / rate
        added = self._added * np.exp(-time[:, None, None] / (_TIMES * t.time))
        noise = t.noise * self._rng.normal(size=(len(time), len(self.rest)))
        drift = 1 + t.drift * (self.now + time[:, None]) / 3600
        answer = self._play.mean(0) + added.sum(1)
        ohm = self.rest * drift * (1 + self.gain * answer + noise)
        self.now += float(time[-1])
        self._added = added[-1]
        return time, ohm
