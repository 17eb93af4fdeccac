"""Pieces of rubber cord that answer to strain as real ones do: late, and not twice alike.

R = R0 (1 + drift) (1 + g (p + y) + noise). p follows the response w(eps) with play, as several
loose gears do (the Prandtl-Ishlinskii operator): hysteresis. y is the resistance that any change of
strain adds, for it tears the filler's network, and that heals, part of it slowly: relaxation; after
release a cord reads too high, too. g is the piece's own gain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.curves.bending import bent_strain
from ...sensing.response import Response

# The cords of a device that moves, as the read-out board's twin reads them.

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


# A bending specimen with three cords, and whole calibration sessions on it.


class SpecimenTwin:
    """A specimen of the cords bottom, neutral and top (in this order), `offset` mm from the faces
    of a bar of this `length` and `thickness`, mm, that can be laid on jigs."""

    channels = ("bottom", "neutral", "top")

    def __init__(
        self,
        traits: CordTraits,
        rng: np.random.Generator,
        length: float = 150.0,
        thickness: float = 15.0,
        offset: float = 2.0,
        misplaced: float = 0.0,
    ) -> None:
        """`misplaced` mm is the standard deviation of the cords' heights."""
        self._thickness = thickness
        self._heights = np.array([offset, thickness / 2, thickness - offset])
        self._heights += misplaced * rng.normal(size=3)
        self.cords = CordTwins(traits, np.full(3, length + 20.0), rng)

    def lay(self, radius: float | None, face: str = "a") -> None:
        """On the jig of this surface radius, mm, or the flat one (None), with the bottom down
        (face a) or the top (face b)."""
        heights = self._heights if face == "a" else self._thickness - self._heights
        strain = [0.0 if radius is None else bent_strain(radius, z, self._thickness)
                  for z in heights]  # fmt: skip
        self.cords.bend(np.array(strain))


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
