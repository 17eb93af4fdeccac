"""Find and correct the time shift between the signals and the targets of recordings.

Hysteresis is not a clock error. Signals are caused by the movement up to their time, so at each
shift the signals are predicted from the movement, its exponential memories and its unsigned travel.
A causal memory explains signals that follow the movement slowly; it explains neither a pure delay
of fast changes nor signals that lead the movement.

The shift has an interval: all shifts at which the signals are not predicted significantly worse
than at the best one. It is found for the signals themselves, and for their changes within 0.8 s,
which slow memories hardly affect. The latter counts if its interval is much narrower; if the two
contradict each other, the shift is unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.arrays import Float, Int
from ...decoding.signal_history import interpolate_at
from .dataset import Dataset, Recording
from .shift_curve import Pair, compare_shifts

#: Largest shift that is found, in either direction.
MAX_SHIFT_S = 1.5
#: Largest shift that is tried if signals and movement have little in common within that.
MAX_WIDE_SHIFT_S = 30.0

_SHIFT_STEP_S, _WIDE_STEP_S = 0.04, 0.2  # between the shifts that are tried
_MIN_FRAMES = 100
_MIN_KNOWN_SHARE = 0.5  # of the frames or samples, for a marker or channel to be compared
_MOVEMENT_COUNT, _SIGNAL_COUNT = 3, 8  # main movements and signals that are compared
_MAX_INVERSE_SIGNALS = 16  # that movements are explained with
_MIN_MOVEMENT_MM = 0.5  # standard deviation of the largest movement of markers
_CHANGE_S = 0.8  # time within which changes of the signals are compared
_MUCH_NARROWER = 0.6  # ratio of intervals, below which that of the changes counts
# Signals are out of step if their interval is beyond the first number, and the best shift beyond
# the second one. Late signals need more: filters, boards and slipping fabric delay by up to 0.1 s.
_EARLY_S, _LATE_S = (0.05, 0.085), (0.08, 0.12)
_MAX_DOUBT_S = 0.11  # clocks agree if the whole interval is within it
_MAX_HALF_WIDTH_S = 0.25  # of the interval of a shift that is applied automatically
_MIN_GAIN = 0.1  # of what is not predicted in step, which a shift must predict
_MIN_EXPLAINED = 0.2  # of the variance
_MIN_MATCH = 0.45  # of signals that are certainly out of step
_MIN_WIDE_EXPLAINED = 0.6  # at the best of many shifts; others reach 0.45 by chance
_MIN_WIDE_GAIN = 0.3  # of the explained share, against no shift


@dataclass(frozen=True)
class TimeShift:
    """The time shift at which signals and movement match best.

    Attributes:
        seconds: Seconds to add to the times of the samples.
        low: Smallest shift that is not significantly worse, s.
        high: Largest shift that is not significantly worse, s.
        fit: Share of the signals' variance that the movement and its memories predict after the
            shift.
        fit_before: The same share without a shift.
        explained: Share of the movements' variance that the signals explain without memories, at
            the best shift for that.
        explained_before: The same share without a shift.
        explained_at: The best shift for that, s.
        limit: Largest shift that was tried, s.
    """

    seconds: float
    low: float
    high: float
    fit: float
    fit_before: float
    explained: float
    explained_before: float
    explained_at: float
    limit: float

    @property
    def match(self) -> float:
        """Share that signals and movement have in common: the larger one of both directions."""
        return max(self.explained, self.fit)

    @property
    def is_informative(self) -> bool:
        """Whether signals and movement have enough in common to compare their clocks."""
        return self.match >= _MIN_EXPLAINED

    @property
    def is_significant(self) -> bool:
        """Whether the signals are certainly out of step, even with a memory in the model."""
        is_late = self.high < -_LATE_S[0] and self.seconds < -_LATE_S[1]
        is_early = self.low > _EARLY_S[0] and self.seconds > _EARLY_S[1]
        is_gain = 1 - self.fit < (1 - _MIN_GAIN) * (1 - self.fit_before)
        return self.match >= _MIN_MATCH and is_gain and (is_late or is_early)

    @property
    def is_known(self) -> bool:
        """Whether the clocks certainly agree, or certainly do not."""
        return self.is_significant or max(-self.low, self.high) < _MAX_DOUBT_S

    @property
    def is_at_limit(self) -> bool:
        """Whether the best shift is the largest one tried, so that the true one may be larger."""
        return abs(self.seconds) > 0.97 * self.limit

    @property
    def is_applicable(self) -> bool:
        """Whether the shift is certain and exact enough to be applied."""
        is_exact = self.high - self.low <= 2 * _MAX_HALF_WIDTH_S
        return self.is_significant and is_exact and not self.is_at_limit

    @property
    def range_text(self) -> str:
        """The interval in words, such as `+0.26 to +0.34 s`."""
        return f"{self.low:+.2f} to {self.high:+.2f} s"


def find_time_shift(
    recordings: Sequence[Recording], max_shift: float = MAX_SHIFT_S, step: float = _SHIFT_STEP_S
) -> TimeShift | None:
    """Find the one time shift between the signals and the targets of recordings.

    Args:
        recordings: Recordings with the same channels and targets, whose clocks differ equally.
        max_shift: Largest shift that is tried, s.
        step: Step between the shifts, s.

    Returns:
        The best shift; None if nothing moves, or too few frames are complete.
    """
    plain = _pair_series(recordings, _SIGNAL_COUNT)
    if plain is None:
        return None
    count = round(max_shift / step)
    shifts: Float = np.asarray(step * np.arange(-count, count + 1), np.float64)
    duration = float(np.median([np.ptp(pair.cause_time) for pair in plain]))
    pairs = [pair.with_memories(duration) for pair in plain]
    levels = compare_shifts(pairs, shifts)
    whole = _pair_series(recordings, _MAX_INVERSE_SIGNALS) or plain
    inverse = compare_shifts([p.reversed().with_squares() for p in whole], -shifts)
    if levels is None or inverse is None:
        return None
    seconds, low, high = levels.interval()
    fit = levels.explained
    changes = compare_shifts(pairs, shifts, _CHANGE_S)
    if changes is not None:
        other, other_low, other_high = changes.interval()
        if max(low, other_low) > min(high, other_high):  # they contradict each other
            low, high = min(low, other_low), max(high, other_high)
        elif other_high - other_low < _MUCH_NARROWER * (high - low):
            seconds, low, high, fit = other, other_low, other_high, changes.explained
    k = int(np.abs(shifts - seconds).argmin())
    explained = inverse.explained
    at = int(explained.argmax())
    return TimeShift(
        seconds,
        low,
        high,
        fit=float(fit[k]),
        fit_before=float(fit[count]),
        explained=float(explained[at]),
        explained_before=float(explained[count]),
        explained_at=float(shifts[at]),
        limit=max_shift,
    )


def find_wide_shift(recording: Recording) -> TimeShift | None:
    """Find a time shift of up to 30 s, or a quarter of a recording.

    Args:
        recording: The recording.

    Returns:
        The shift; None if signals and movement match at none, or the match may be chance.
    """
    largest = min(MAX_WIDE_SHIFT_S, float(np.ptp(recording.time)) / 4)
    shift = find_time_shift([recording], largest, _WIDE_STEP_S)
    if shift is None or shift.match < _MIN_WIDE_EXPLAINED:
        return None
    if shift.is_significant:
        return shift
    # Memories need many frames. No memory of a map that works well lasts for that long.
    at, gain = shift.explained_at, shift.explained - shift.explained_before
    if abs(at) <= MAX_SHIFT_S or gain < _MIN_WIDE_GAIN or shift.explained < _MIN_WIDE_EXPLAINED:
        return None
    return replace(
        shift,
        seconds=at,
        low=at - _WIDE_STEP_S,
        high=at + _WIDE_STEP_S,
        fit=shift.explained,
        fit_before=shift.explained_before,
    )


def find_time_shifts(dataset: Dataset) -> dict[str, TimeShift]:
    """Find the time shifts of all recordings of a dataset.

    Recordings that are too short, or move too little, to know it alone are judged together. Larger
    shifts are tried where signals and movement have little in common.

    Args:
        dataset: The dataset.

    Returns:
        The shifts by the recordings' names, of those that can be compared.
    """
    found = {r.name: find_time_shift([r]) for r in dataset.recordings}
    for r in dataset.recordings:
        one = found[r.name]
        if one is not None and (one.match < _MIN_WIDE_EXPLAINED or one.is_at_limit):
            found[r.name] = find_wide_shift(r) or one
    doubtful = [r for r in dataset.recordings if (s := found[r.name]) is None or not s.is_known]
    joint = find_time_shift(doubtful) if len(doubtful) > 1 else None
    if joint is not None and joint.is_informative:
        found |= dict.fromkeys((r.name for r in doubtful), joint)
    return {name: shift for name, shift in found.items() if shift is not None}


def align_samples(dataset: Dataset, shift: float | Literal["auto"]) -> tuple[Dataset, list[str]]:
    """Shift the samples so that they are in step with the targets.

    Args:
        dataset: The dataset.
        shift: Seconds to add to the times of the samples, or "auto" to find them for the
            recordings that are certainly out of step.

    Returns:
        The dataset, whose provenance has the `shifts` that are not 0, and notes on the shifts that
        were found, and on those that use samples from after a frame.
    """
    if shift != "auto":
        shifts = {r.name: float(shift) for r in dataset.recordings} if shift else {}
        notes = (
            [f"signals were shifted by {shift:+.2f} s{_future_note(shift)}"] if shift < 0 else []
        )
        return _shift(dataset, shifts), notes
    found = {n: s for n, s in find_time_shifts(dataset).items() if s.is_significant}
    shifts = {name: s.seconds for name, s in found.items() if s.is_applicable}
    notes = [
        f"{name}: signals were shifted by {s:+.2f} s ({found[name].range_text}){_future_note(s)}"
        for name, s in shifts.items()
    ]
    notes += [
        f"{name}: signals were not shifted: the shift is not exactly known ({s.range_text}); give"
        " the time between the clocks as a number"
        for name, s in found.items()
        if name not in shifts
    ]
    return _shift(dataset, shifts), notes


def _future_note(shift: float) -> str:
    """Return what a shift into the future means for a model, as the end of a note."""
    if shift >= 0:
        return ""
    return (
        f", into the future: the model uses samples from {-shift:.2f} s after each frame. If the"
        " clocks did agree, its positions are late by as much when live"
    )


def _shift(dataset: Dataset, shifts: Mapping[str, float]) -> Dataset:
    """Add shifts in s to the times of the samples of recordings, by their names."""
    if not shifts:
        return dataset
    recordings = tuple(
        replace(r, sample_time=r.sample_time + shifts.get(r.name, 0.0)) for r in dataset.recordings
    )
    provenance = {**dataset.provenance, "shifts": dict(shifts)}
    return replace(dataset, recordings=recordings, provenance=provenance)


def _pair_series(recordings: Sequence[Recording], signal_count: int) -> list[Pair] | None:
    """Return main movements, as causes, and main signals, as effects, of each recording."""
    is_compared = np.mean([r.visible.mean(axis=0) for r in recordings], axis=0) > _MIN_KNOWN_SHARE
    if not is_compared.any():
        return None
    dimensions = recordings[0].points.shape[2]
    points = [_fill_gaps(r, np.flatnonzero(is_compared)) for r in recordings]
    complete = [np.isfinite(p).all(axis=1) for p in points]
    movements = [p[k] for p, k in zip(points, complete, strict=True)]
    if sum(map(len, movements)) < _MIN_FRAMES:
        return None
    if dimensions == 1:  # scalars of several units
        movements = _standardize(movements)
    scores, size = _principal_scores(movements, _MOVEMENT_COUNT)
    if size == 0 or (dimensions > 1 and size < _MIN_MOVEMENT_MM):
        return None
    signals = [r.signals for r in recordings]
    known = np.mean([np.isfinite(s).mean(axis=0) for s in signals], axis=0) > _MIN_KNOWN_SHARE
    sampled = [np.isfinite(s[:, known]).all(axis=1) for s in signals]
    signals = [s[k][:, known] for s, k in zip(signals, sampled, strict=True)]
    if not known.any() or sum(map(len, signals)) < _MIN_FRAMES:
        return None
    effects, size = _principal_scores(_standardize(signals), signal_count)
    if size == 0:
        return None
    return [
        Pair(r.time[frames], y, r.sample_time[samples], s)
        for r, frames, y, samples, s in zip(
            recordings, complete, scores, sampled, effects, strict=True
        )
        if len(y) > 1 and len(s) > 1
    ]


def _fill_gaps(r: Recording, markers: Int) -> Float:
    """Return coordinates (t, k) of markers, with short gaps filled linearly."""
    columns = []
    for k in markers:
        is_visible = r.visible[:, k]
        columns.append(interpolate_at(r.time, r.time[is_visible], r.points[is_visible, k]))
    return np.concatenate(columns, axis=1)


def _standardize(series: Sequence[Float]) -> list[Float]:
    """Return series (n, d) with joint mean 0 and deviation 1; constant columns are 0."""
    joined = np.concatenate(series)
    deviation = joined.std(axis=0)
    is_constant = deviation < 1e-12 * np.abs(joined).max(axis=0, initial=1e-300)
    return [(s - joined.mean(axis=0)) / np.where(is_constant, np.inf, deviation) for s in series]


def _principal_scores(series: Sequence[Float], count: int) -> tuple[list[Float], float]:
    """Return the largest principal components, scaled to deviations up to 1, and the scale."""
    joined = np.concatenate(series)
    mean = joined.mean(axis=0)
    covariance = np.cov(joined, rowvar=False).reshape(len(mean), len(mean))
    variances, directions = np.linalg.eigh(covariance)
    size = float(np.sqrt(max(variances[-1], 0.0)))
    kept = directions[:, ::-1][:, : min(count, int((variances > 1e-9 * size**2).sum()))]
    return [(s - mean) @ kept / (size or 1.0) for s in series], size
