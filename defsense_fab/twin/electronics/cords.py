"""Simulated cords that a board reads: of a specimen, of a moving device, or of a recording.

Cords of specimens and moving devices have hysteresis and relaxation:

R = R0 (1 + drift) (1 + g (p + y) + noise)

- p follows the response w(eps) with play, as several loose gears do (the Prandtl-Ishlinskii
  operator): hysteresis.
- y is the resistance that any change of strain adds, because it tears the network of the filler.
  It heals, part of it slowly: relaxation. A cord also reads too high after it was released.
- g is the gain of the piece of cord.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Float
from ...core.response import (
    CORD_OFFSET_MM,
    SPECIMEN_LENGTH_MM,
    SPECIMEN_THICKNESS_MM,
    bent_strain,
)

if TYPE_CHECKING:  # it imports SciPy; options records read the defaults of `CordTraits`
    from ...sensing.response import Response

# Play of the gears, relative to the play of the cord.
RELATIVE_PLAYS = np.array([0.5, 1.0, 1.5])[:, None]
# Time constants of the healing, relative to that of the cord, and the shares that heal with them.
RELATIVE_TIMES, HEALING_SHARES = np.array([1.0, 6.0])[:, None], np.array([0.8, 0.2])[:, None]
READING_SHARE = 1e-3  # of a time step, for the reading itself
SPECIMEN_EXTRA_MM = 20.0  # length of a specimen's cords beyond the specimen
CUT, SHORT, STUCK, SWAP = "cut", "short", "stuck", "swap"
FAULT_KINDS = (CUT, SHORT, STUCK, SWAP)
OPEN_OHM, SHORTED_OHM = 1e9, 1e-3
REST_SHARE = 200  # the first 1/200 of a recording is at rest


@dataclass(frozen=True)
class CordTraits:
    """Properties that pieces of one cord have in common.

    Attributes:
        response: The response w(eps).
        noise: Standard deviation of one reading of (R - R0)/R0.
        play: Half of the play, in units of (R - R0)/R0.
        healing: Share of any change that is added at first and heals.
        time: Time constant of most of the healing, s.
        spread: Standard deviation of the gains of the pieces.
        rest_spread: Standard deviation of R0 of pieces of one length, relative.
        ohm_per_mm: Resistance at rest per length, ohm/mm.
        drift: Relative drift of R per hour.
    """

    response: Response
    noise: float = 0.002
    play: float = 0.003
    healing: float = 0.1
    time: float = 8.0
    spread: float = 0.02
    rest_spread: float = 0.05
    ohm_per_mm: float = 14.5
    drift: float = 0.0


class CordTwins:
    """c pieces of cord whose strains change with time.

    Args:
        traits: Properties of the cord.
        lengths: Lengths of the pieces (c,) mm.
        rng: Random generator.

    Attributes:
        gain: Gains (c,) of the pieces.
        rest: Resistances at rest (c,) ohm.
        time: Time since the start, s.
    """

    def __init__(self, traits: CordTraits, lengths: Float, rng: np.random.Generator) -> None:
        self._traits, self._rng = traits, rng
        count = len(lengths)
        self.gain = 1 + traits.spread * rng.normal(size=count)
        nominal = traits.ohm_per_mm * np.asarray(lengths, float)
        self.rest = nominal * (1 + traits.rest_spread * rng.normal(size=count))
        self.time = 0.0
        self._strain = np.zeros(count)
        self._play, self._added = np.zeros((3, count)), np.zeros((2, count))

    def stretch(self, strain: Float, duration: float = 1.0) -> None:
        """Change the strains steadily to `strain` (c,) within `duration` s."""
        t = self._traits
        before, after = t.response(self._strain), t.response(strain)
        play = RELATIVE_PLAYS * t.play
        self._play = np.clip(self._play, after - play, after + play)
        # y' = rate - y / time, for the rate that tears `healing` of the whole change.
        time = RELATIVE_TIMES * t.time
        remaining = np.exp(-duration / time)
        rate = HEALING_SHARES * t.healing * np.abs(after - before) / duration
        self._added = self._added * remaining + rate * time * (1 - remaining)
        self._strain = np.asarray(strain, float)
        self.time += duration

    def measure(self, duration: float, rate: float) -> tuple[Float, Float]:
        """Hold the strains and measure.

        Args:
            duration: Duration, s.
            rate: Sample rate, Hz.

        Returns:
            Times (t,) s from now on, and resistances (t, c) ohm.
        """
        t = self._traits
        time = np.arange(1, max(round(duration * rate), 1) + 1) / rate
        added = self._added * np.exp(-time[:, None, None] / (RELATIVE_TIMES * t.time))
        noise = t.noise * self._rng.normal(size=(len(time), len(self.rest)))
        drift = 1 + t.drift * (self.time + time[:, None]) / 3600
        signal = self._play.mean(0) + added.sum(1)
        ohm = self.rest * drift * (1 + self.gain * signal + noise)
        self.time += float(time[-1])
        self._added = added[-1]
        return time, ohm


class DeviceCords:
    """c cords of a device that moves.

    Args:
        channels: Names of the channels (c).
        lengths: Lengths of the cords (c,) mm.
        signals_at: Returns the signals (R - R0)/R0 (c,) of ideal cords at a time, s.
        traits: Properties of the cord; its response is not used.
        rng: Random generator.

    Attributes:
        rest: Resistances at rest (c,) ohm.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        lengths: Float,
        signals_at: Callable[[float], Float],
        traits: CordTraits,
        rng: np.random.Generator,
    ) -> None:
        from ...sensing.response import Response

        self.channels = channels
        self._signals_at = signals_at
        # The ideal signal takes the place of the strain: it contains the response already.
        self._cords = CordTwins(replace(traits, response=Response.line(1.0)), lengths, rng)
        self.rest = self._cords.rest

    def sample(self, start: float, step: float) -> Float:
        """Let the device move on; return the resistances (c,) ohm, `step` s after `start`, s."""
        self._cords.stretch(self._signals_at(start + step), step * (1 - READING_SHARE))
        _, ohm = self._cords.measure(step * READING_SHARE, 1 / (step * READING_SHARE))
        return np.asarray(ohm[0])


class SpecimenTwin:
    """A calibration specimen: a bar with three cords that is placed on jigs.

    Args:
        traits: Properties of the cord.
        rng: Random generator.
        length: Length of the bar, mm.
        thickness: Thickness of the bar, mm.
        offset: Distance of the outer cords from the faces, mm.
        misplaced: Standard deviation of the cords' heights, mm.

    Attributes:
        cords: The cords `bottom`, `neutral` and `top`, in this order.
    """

    channels = ("bottom", "neutral", "top")

    def __init__(
        self,
        traits: CordTraits,
        rng: np.random.Generator,
        length: float = SPECIMEN_LENGTH_MM,
        thickness: float = SPECIMEN_THICKNESS_MM,
        offset: float = CORD_OFFSET_MM,
        misplaced: float = 0.0,
    ) -> None:
        self._thickness = thickness
        self._heights = np.array([offset, thickness / 2, thickness - offset])
        self._heights += misplaced * rng.normal(size=3)
        self.cords = CordTwins(traits, np.full(3, length + SPECIMEN_EXTRA_MM), rng)

    def place(self, radius: float | None, face: str = "a") -> None:
        """Place the specimen on a jig.

        Args:
            radius: Surface radius of the jig, mm; None for the flat jig.
            face: `a` with the bottom down, `b` with the top down.
        """
        heights = self._heights if face == "a" else self._thickness - self._heights
        strain = [
            0.0 if radius is None else bent_strain(radius, z, self._thickness) for z in heights
        ]
        self.cords.stretch(np.array(strain))

    def sample(self, start: float, step: float) -> Float:  # noqa: ARG002 - it stands still
        """Return the resistances (3,) ohm, `step` s later."""
        _, ohm = self.cords.measure(step, 1 / step)
        return np.asarray(ohm[0])


@dataclass(frozen=True)
class CordFault:
    """A fault of cords, plugs or wires.

    Attributes:
        kind: `cut`, `short`, `stuck` (the reading stays as it was at the start), `swap`, or a kind
            of `wiring.WIRING_KINDS`.
        channels: Indices of the channels: two for `swap` and `bridge`, else one.
        begin: Start, s.
        end: End, s.
        amount: Size of the fault in the unit of its kind; None for the usual one.
    """

    kind: str
    channels: tuple[int, ...]
    begin: float
    end: float = np.inf
    amount: float | None = None

    def is_present(self, time: float) -> bool:
        """Return whether the fault is present at a time, s."""
        return self.begin <= time < self.end


class ReplayedCords:
    """Cords that repeat a recording forwards and backwards without end.

    Args:
        channels: Names of the channels (c).
        time: Times of the recording (n,) s, from 0 on.
        ohm: Resistances (n, c) ohm; interpolated linearly.
        faults: Faults by time.

    Attributes:
        rest: Resistances at rest (c,) ohm.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        time: Float,
        ohm: Float,
        faults: tuple[CordFault, ...] = (),
    ) -> None:
        self.channels = channels
        self.rest = ohm[: max(len(ohm) // REST_SHARE, 1)].mean(axis=0)
        self._recorded_time, self._recorded_ohm, self._faults = time, ohm, faults
        self._stuck = dict[CordFault, Float]()  # resistances at the start of a fault

    def sample(self, start: float, step: float) -> Float:
        """Return the resistances (c,) ohm, with the faults, `step` s after `start`, s."""
        time = start + step
        ohm = self._replay(time)
        for fault in self._faults:
            if not fault.is_present(time):
                continue
            channels = np.array(fault.channels)
            if fault.kind == SWAP:
                ohm[channels] = ohm[channels[::-1]]
            elif fault.kind == STUCK:
                ohm[channels] = self._stuck.setdefault(fault, ohm[channels])
            else:
                ohm[channels] = OPEN_OHM if fault.kind == CUT else SHORTED_OHM
        return ohm

    def _position(self, time: float) -> float:
        """Return the time in the recording, s."""
        end = float(self._recorded_time[-1])
        phase = time % (2 * end)
        return 2 * end - phase if phase > end else phase

    def _replay(self, time: float) -> Float:
        position = self._position(time)
        return np.array([np.interp(position, self._recorded_time, c) for c in self._recorded_ohm.T])
