"""Name the fault of each channel from readings at rest, while wires are moved, and in poses.

The order of the tests is that of causes: a channel that is not read, or is at an end of the
converter's range, says nothing else. Limits follow from the cords' expected noise, from the
tolerances of the resistances, and from the number of samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float
from ...sensing.serial_frames import MAX_COUNT
from .assignment import Assignment, Evidence, assign_cords, wire_reactions
from .channel_texts import finding
from .mains import Hum, fit_hum
from .records import BoardSetup, Code, ExpectedCord, Finding, Phase

#: Shares of the supply's voltage below and above which a circuit is shorted or open. A converter
#: with an internal reference (ADS1115) also sees the tolerance of the supply, 1.5 % for a usual
#: 3.3 V regulator (LP2985), and its own gain error of 0.15 %.
_SHORT_SHARE, _OPEN_SHARE = 0.002, (0.998, 0.982)
_SUPPLY_RTOL = 0.018
#: Range of the logarithms of sound channels' voltages relative to the expected ones: a divider
#: halves the tolerances of cords and resistors, 20 % either way.
_SUPPLY_SCATTER = 0.2
#: Ratios from 10^1.5 on are no wrong resistor of a kit's neighboring decade, but an end of the
#: converter's range: a step of it is then several percent of a cord's signal.
_SATURATED_DECADES = 1.5
#: Relative tolerance of a wrong resistor about a whole decade, in addition to that of the cord:
#: resistors of 5 % (E24).
_RESISTOR_RTOL = 0.05
#: Share of samples without a value from which a channel counts as not read; a damaged frame is
#: dropped as a whole, so that a sound channel has none.
_MAX_MISSING_SHARE = 0.01
#: A channel is noisy above this multiple of the expected noise: errors of the decoder by noise
#: are then twice as large.
_NOISE_FACTOR = 2.0
#: Hum matters from this share of the expected noise of a sample; below, noise dominates.
_HUM_SHARE, _HUM_FALSE_ALARM = 0.5, 1e-6
#: Steps between samples beyond this many standard deviations are jumps: one in 5e8 by chance.
_JUMP_SIGMAS, _MIN_JUMPS = 6.0, 3
#: Standard deviation of one conversion, counts: the noise of the converter and of rounding.
_CONVERSION_NOISE = float(np.hypot(0.5, np.sqrt(1 / 12)))
_REACTION_S = 0.05  # blocks of samples whose means show slow changes
#: Connected channels differ by less than this share of the supply: half a count of 10 bits, which
#: averages resolve.
_EQUAL_SHARE = 0.0005
_EQUAL_CORRELATION = 0.8  # of the noise of two channels that are connected


def diagnose(
    cords: Sequence[ExpectedCord], board: BoardSetup, phases: Sequence[Phase]
) -> list[Finding]:
    """Return one finding for each channel.

    Args:
        cords: What the build expects, in the order of the channels.
        board: How the board measured.
        phases: The readings; the first phase is at rest, the others are optional.
    """
    return _Diagnosis(cords, board, phases).findings()


def rest_deviation(cords: Sequence[ExpectedCord]) -> Float:
    """Return the standard deviations of the logarithms of sound cords' resistances (k,).

    The limits of a sound cord are taken as three of them.
    """
    return np.array([np.log(c.high / c.low) / 6 for c in cords])


class _Diagnosis:
    """The steps of the diagnosis of one check."""

    def __init__(
        self, cords: Sequence[ExpectedCord], board: BoardSetup, phases: Sequence[Phase]
    ) -> None:
        self._cords, self._board = list(cords), board
        self._rest = phases[0]
        self._wiggles = [p for p in phases if p.kind == "wiggle"]
        self._poses = [p for p in phases if p.kind == "pose"]
        self._count = len(cords)
        self._share = self._rest.medians / board.full_scale
        share = np.clip(self._share, 1e-9, 1 - 1e-9)
        self._ohm = board.reference * share / (1 - share)
        self._slope = share * (1 - share)  # of the share by the logarithm of the resistance
        noise = np.array([c.noise for c in cords])
        steps = _CONVERSION_NOISE / np.sqrt(board.averages) / board.full_scale
        self._noise = np.hypot(self._slope * noise, steps)
        self._hum: list[Hum | None] = [self._fit_hum(c) for c in range(self._count)]
        self._end = [self._find_end(c) for c in range(self._count)]
        self._jumps = [self._count_jumps(c) for c in range(self._count)]
        self._supply = self._find_supply()

    def findings(self) -> list[Finding]:
        """Return the finding of each channel."""
        bridges = self._find_bridges()
        assignment = self._assign(bridges)
        return [self._finding(c, bridges, assignment) for c in range(self._count)]

    def _finding(
        self, c: int, bridges: dict[int, tuple[int, ...]], assignment: Assignment
    ) -> Finding:
        cord, data = self._cords[c], {"ohm": float(self._ohm[c]), "expected": self._cords[c].ohm}
        end = self._end[c]
        if end is not None and (self._supply == 1.0 or end in ("not-read", "short")):
            return finding(c, cord, end, self._board.reference[c], data)
        if self._supply != 1.0:
            data["supply"] = self._supply
            return finding(c, cord, "saturated", self._board.reference[c], data)
        if c in bridges:
            others = tuple(self._cords[i].name for i in bridges[c])
            return finding(c, cord, "short", self._board.reference[c], data, others)
        jumps = self._jumps[c]
        if jumps:
            data["jumps"] = jumps
            return finding(c, cord, "loose", self._board.reference[c], data)
        actual = self._cords[int(assignment.cords[c])]
        if actual is not cord:
            data["ratio"] = assignment.ratio
            return finding(c, cord, "swapped", self._board.reference[c], data, (actual.name,))
        if self._is_decade_off(c):
            return finding(c, cord, "reference-wrong", self._board.reference[c], data)
        hum = self._hum[c]
        if hum is not None and self._is_hum(c, hum):
            data |= {"hertz": hum.frequency, "rms": hum.rms / self._slope[c]}
            return finding(c, cord, "hum", self._board.reference[c], data)
        noise = self._measured_noise(c)
        if noise > _NOISE_FACTOR * self._noise[c]:
            data |= {"noise": noise / self._slope[c], "limit": self._noise[c] / self._slope[c]}
            return finding(c, cord, "noisy", self._board.reference[c], data)
        if not cord.low <= self._ohm[c] <= cord.high:
            data |= {"low": cord.low, "high": cord.high}
            return finding(c, cord, "rest-off", self._board.reference[c], data)
        return finding(c, cord, "ok", self._board.reference[c], data)

    def _find_end(self, c: int) -> Code | None:
        """Return the code of a channel that is not read or at an end of the range, or None."""
        counts = self._rest.counts[:, c]
        missing = [np.isnan(p.counts[:, c]).mean() for p in (self._rest, *self._wiggles)]
        if max(missing) > _MAX_MISSING_SHARE or not np.isfinite(counts).any():
            return "not-read"
        full, share = self._board.full_scale, self._share[c]
        if share > 1 + _SUPPLY_RTOL:
            return "saturated"
        if share >= _OPEN_SHARE[self._board.converter] or full > MAX_COUNT <= np.nanmedian(counts):
            return "open"
        if share <= _SHORT_SHARE:
            return "short"
        decades = np.log10(self._ohm[c] / self._cords[c].ohm)
        return "saturated" if abs(decades) > _SATURATED_DECADES else None

    def _find_supply(self) -> float:
        """Return the factor by which the voltages of all channels are off; 1 if they are not.

        One wrong supply explains them better than a wrong cord or resistor on every channel, unless
        each is off by a decade.
        """
        read = [c for c in range(self._count) if self._end[c] not in ("not-read", "short")]
        inside = [c for c in read if self._end[c] != "open"]
        ohm = np.array([c.ohm for c in self._cords])
        is_off = [not self._cords[c].low <= self._ohm[c] <= self._cords[c].high for c in read]
        if len(inside) < 2 or not all(is_off) or all(self._is_decade_off(c) for c in inside):
            return 1.0
        ratios = (self._share * (ohm + self._board.reference) / ohm)[inside]
        factor = float(np.median(ratios))
        is_common = np.ptp(np.log(ratios)) <= _SUPPLY_SCATTER < abs(np.log(factor))
        return factor if is_common else 1.0

    def _is_sound(self, c: int) -> bool:
        return not self._end[c]

    def _is_decade_off(self, c: int) -> bool:
        cord = self._cords[c]
        decades = abs(np.log(self._ohm[c] / cord.ohm)) / np.log(10)
        tolerance = np.log(cord.high / cord.low) / 2 + _RESISTOR_RTOL
        return bool(abs(decades - 1) * np.log(10) <= tolerance)

    def _fit_hum(self, c: int) -> Hum | None:
        values = self._rest.counts[:, c] / self._board.full_scale
        is_read = np.isfinite(values)
        if is_read.mean() < 1 - _MAX_MISSING_SHARE:
            return None
        return fit_hum(self._rest.time[is_read], values[is_read])

    def _is_hum(self, c: int, hum: Hum) -> bool:
        is_large = hum.rms > _HUM_SHARE * self._noise[c]
        return is_large and hum.false_alarm < _HUM_FALSE_ALARM

    def _measured_noise(self, c: int) -> float:
        """Return the standard deviation of a sample at rest, without hum and drift."""
        hum = self._hum[c]
        return 0.0 if hum is None else _robust_deviation(hum.residual)

    def _count_jumps(self, c: int) -> int:
        """Return the number of jumps while wires were moved; 0 if there are as many at rest."""
        steps = np.diff(self._rest.counts[:, c]) / self._board.full_scale
        scale = max(_robust_deviation(steps), np.sqrt(2) * self._noise[c])
        limit = _JUMP_SIGMAS * scale
        at_rest = int((np.abs(steps) > limit).sum())
        moved = [np.diff(p.counts[:, c]) / self._board.full_scale for p in self._wiggles]
        counts = [int((np.abs(m) > limit).sum()) for m in moved]
        most = max(counts, default=0)
        expected = at_rest * max((len(m) for m in moved), default=0) / max(len(steps), 1)
        # A Poisson count scatters by its root.
        if most >= _MIN_JUMPS and most > expected + 3 * np.sqrt(expected + 1):
            return most
        return at_rest if at_rest >= _MIN_JUMPS and not self._is_noisy_throughout(steps) else 0

    @staticmethod
    def _is_noisy_throughout(steps: Float) -> bool:
        """Return whether large steps are spread evenly over the rest, as those of noise are."""
        tenths = np.array_split(np.abs(steps), 10)
        spread = [float(np.percentile(t, 90)) for t in tenths if len(t)]
        return min(spread) > 0.5 * max(spread)

    def _find_bridges(self) -> dict[int, tuple[int, ...]]:
        """Return the channels that are connected to others, with these."""
        out: dict[int, tuple[int, ...]] = {}
        sound = [c for c in range(self._count) if self._is_sound(c)]
        for i in sound:
            others = tuple(j for j in sound if j != i and self._are_connected(i, j))
            if others:
                out[i] = others
        return out

    def _are_connected(self, i: int, j: int) -> bool:
        """Return whether two channels have the same voltage in every phase, and must not."""
        if abs(self._share[i] - self._share[j]) > _EQUAL_SHARE:
            return False
        tells_apart = False
        for pose in self._poses:
            shares = pose.medians / self._board.full_scale
            if not abs(shares[i] - shares[j]) <= _EQUAL_SHARE:
                return False
            a, b = (self._cords[k].changes[pose.subject] for k in (i, j))
            expected = abs(self._slope[i] * a.mean - self._slope[j] * b.mean)
            deviation = self._slope[i] * np.hypot(a.deviation, b.deviation)
            tells_apart |= bool(expected - 2 * deviation > 2 * _EQUAL_SHARE)
        hums = self._hum[i], self._hum[j]
        if hums[0] is None or hums[1] is None or len(hums[0].residual) != len(hums[1].residual):
            return tells_apart
        noise = np.array([h.residual for h in hums if h is not None])
        correlation = float(np.corrcoef(noise)[0, 1]) if noise.std(axis=1).min() > 0 else 0.0
        return tells_apart or correlation > _EQUAL_CORRELATION

    def _assign(self, bridges: dict[int, tuple[int, ...]]) -> Assignment:
        """Return which cord each channel reads."""
        usable = np.array(
            [
                self._is_sound(c) and c not in bridges and not self._jumps[c]
                for c in range(self._count)
            ]
        )
        ohm = np.where(usable, self._ohm, np.nan)
        changes = {}
        for pose in self._poses:
            share = pose.medians / self._board.full_scale
            is_inside = (share > _SHORT_SHARE) & (share < _OPEN_SHARE[self._board.converter])
            with np.errstate(divide="ignore", invalid="ignore"):
                held = self._board.reference * share / (1 - share)
                change = held / self._ohm - 1
            changes[pose.subject] = np.where(usable & is_inside, change, np.nan)
        evidence = Evidence(ohm, changes, self._reactions(usable), rest_deviation(self._cords))
        return assign_cords(self._cords, evidence, usable)

    def _reactions(self, usable: Bool) -> Float:
        """Return the evidence (k, c) of the wires that were moved."""
        out = np.zeros((self._count, self._count))
        if not self._wiggles:
            return out
        at_rest = _slow_spread(self._rest)
        names = [c.name for c in self._cords]
        for phase in self._wiggles:
            moved = _slow_spread(phase)
            blocks = (phase.time[-1] - phase.time[0]) / _REACTION_S / 2
            evidence = wire_reactions(at_rest[usable], moved[None, usable], blocks)
            out[names.index(phase.subject), usable] = evidence[0]
        return out


def _robust_deviation(values: Float) -> float:
    """Return the standard deviation of most values, by their median distance from the median."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _slow_spread(phase: Phase) -> Float:
    """Return the standard deviations (c,) of means of short blocks, without a linear drift."""
    step = float(np.median(np.diff(phase.time)))
    size = max(round(_REACTION_S / step), 1)
    count = len(phase.counts) // size
    blocks = phase.counts[: count * size].reshape(count, size, -1).mean(axis=1)
    x = np.stack([np.ones(count), np.linspace(-1, 1, count)], axis=1)
    filled = np.nan_to_num(blocks)
    rest = filled - x @ np.linalg.lstsq(x, filled, rcond=None)[0]
    return np.array([_robust_deviation(r) for r in rest.T])
