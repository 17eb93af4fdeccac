"""Check a dataset before training: identity, times, frames, rest pose, channels and units."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ...core.arrays import Bool, Float
from .channel_checks import check_channels, longest_run
from .dataset import Dataset, Recording
from .problems import Problem, raise_fatal
from .reading_checks import MIN_DURATION_S, MIN_FRAMES, check_readings, check_values
from .time_alignment import MAX_SHIFT_S, TimeShift, find_time_shift, find_time_shifts
from .unit_checks import check_units

_FRAMES_PER_WEIGHT = 10  # for each weight of a decoder
_MIN_REST_S = 0.5
_MAX_REST_DISTANCE_MM = 3.0  # median distance of the markers from their rest positions, at rest
_MAX_SHARE_WITHOUT_SAMPLES = 0.05  # of the frames
_MAX_SHARE_WITHOUT_MARKERS = 0.5  # of the frames
_FATAL_EXPLAINED = 0.05  # of the movements' variance; signals that explain less forbid training
_MIN_CORRELATION = 0.4  # of a channel's signal with its prediction
_UNINFORMATIVE, _OUT_OF_STEP, _UNKNOWN = "signals-tell-nothing", "out-of-step", "clocks-unknown"
#: Codes of warnings on the clocks.
CLOCK_CODES = _OUT_OF_STEP, _UNKNOWN
_ALIGNMENT_CODES = _UNINFORMATIVE, _OUT_OF_STEP, _UNKNOWN


_ENDS = ((min, "low"), (max, "high"))  # of an interval


def check_dataset(
    dataset: Dataset, predicted: Mapping[str, Float] | None = None
) -> tuple[Problem, ...]:
    """Find all problems of a dataset.

    Args:
        dataset: The dataset.
        predicted: Predicted signals (R - R0)/R0 at the frames of recordings, shape (t, c), by the
            recordings' names, where known.

    Returns:
        The problems; those that forbid training come first.
    """
    is_device = dataset.readings is None
    problems = [
        *_check_devices(dataset),
        *_check_copies(dataset),
        *_check_numbers(dataset),
        *check_units(dataset),
        *_check_overlap(dataset),
    ]
    if not any(p.is_fatal for p in problems):  # the remaining checks compute with these values
        # Causes come first: missing signals or markers lead to too few frames.
        problems += [
            *(check_channels(dataset, predicted) if is_device else check_readings(dataset)),
            *_check_gaps(dataset),
            *_check_amount(dataset),
            *_check_rest_pose(dataset),
            *_check_alignment(dataset, predicted or {}),
        ]
    return tuple(sorted(problems, key=lambda p: not p.is_fatal))


def require_trainable(
    dataset: Dataset,
    predicted: Mapping[str, Float] | None = None,
    is_synchronized: bool = False,
) -> tuple[Problem, ...]:
    """Check a dataset, and raise an error if it cannot be trained on.

    Args:
        dataset: The dataset.
        predicted: As in `check_dataset`.
        is_synchronized: Whether signals and markers are known to be in step, as those of a twin
            are. If so, uninformative and seemingly shifted signals do not forbid training.

    Returns:
        All problems that do not forbid training.

    Raises:
        TrainingError: If a problem forbids training; it has the code of the first one.
    """
    problems = check_dataset(dataset, predicted)
    raise_fatal(p for p in problems if not (is_synchronized and p.code in _ALIGNMENT_CODES))
    return problems


def _usable_frames(r: Recording) -> Bool:
    """Return which frames (t,) have a visible marker and a signal of every channel."""
    signals = r.signals_at(r.time)
    return np.asarray(np.isfinite(signals).all(axis=1) & r.visible.any(axis=1))


def _check_devices(dataset: Dataset) -> Iterator[Problem]:
    """Find sessions of different devices or layouts."""
    for key, noun, code in (
        ("device", "devices", "different-devices"),
        ("layout", "layouts of cords", "different-layouts-of-cords"),
    ):
        folders = {
            str(s[key]): str(s.get("folder", "?"))
            for s in dataset.provenance.get("sessions", ())
            if s.get(key)
        }
        if len(folders) > 1:
            values = ", ".join(f"{value} ({folder})" for value, folder in folders.items())
            yield Problem(
                code,
                True,
                f"the sessions have different {noun}: {values}",
                "Train a model for each",
                data={"folders": folders},
            )


def _check_copies(dataset: Dataset) -> list[Problem]:
    """Find copies of a recording: the model would be tested on what it was trained on."""
    return [
        Problem(
            "same-recording",
            True,
            f"{r.name} is a copy of {other.name}",
            "Give each recording once",
            recordings=(r.name, other.name),
        )
        for k, r in enumerate(dataset.recordings)
        for other in dataset.recordings[:k]
        if np.array_equal(r.time, other.time) and _are_equal(r.signals, other.signals)
    ]


def _are_equal(a: Float, b: Float) -> bool:
    return a.shape == b.shape and np.allclose(a, b, rtol=0, atol=1e-5, equal_nan=True)


def _check_numbers(dataset: Dataset) -> Iterator[Problem]:
    """Find markers without a rest position, and positions that are partly not a number."""
    unknown = dataset.ids[~np.isfinite(dataset.rest_points).all(axis=1)]
    if len(unknown):
        yield Problem(
            "no-number",
            True,
            f"markers {', '.join(map(str, unknown.tolist()))} have no rest position",
            "Give their markers.json, or leave them out",
            data={"markers": tuple(unknown.tolist())},
        )
    for r in dataset.recordings:
        is_partial = np.isfinite(r.points).any(axis=2) != np.isfinite(r.points).all(axis=2)
        is_invalid = is_partial | np.isinf(r.points).any(axis=2)
        if is_invalid.any():
            frame, k = (int(i) for i in np.argwhere(is_invalid)[0])
            yield Problem(
                "no-number",
                True,
                f"{r.name}: the position of marker {dataset.ids[k]} at {r.time[frame]:.2f} s is"
                " not three finite numbers",
                "Write three numbers, or none",
                recordings=(r.name,),
                data={"markers": (int(dataset.ids[k]),), "time_s": float(r.time[frame])},
            )


def _check_overlap(dataset: Dataset) -> Iterator[Problem]:
    """Find recordings whose samples and frames have no time in common."""
    for r in dataset.recordings:
        if not (len(r.time) and len(r.sample_time)):
            continue
        (a, b), (c, d) = r.sample_time[[0, -1]], r.time[[0, -1]]
        if b < c or a > d:
            yield Problem(
                "out-of-step",
                True,
                f"{r.name}: samples ({a:.1f} to {b:.1f} s) and frames ({c:.1f} to {d:.1f} s)"
                " have no time in common",
                "Process the session again, or give the shift between the clocks",
                recordings=(r.name,),
            )


def _check_amount(dataset: Dataset) -> list[Problem]:
    """Check the number and duration of usable frames."""
    counts = {r.name: int(_usable_frames(r).sum()) for r in dataset.recordings}
    total, c = sum(counts.values()), len(dataset.channels)
    needed = max(MIN_FRAMES, _FRAMES_PER_WEIGHT * (1 + c))
    if dataset.readings is not None:
        return check_values(dataset, counts, needed)
    duration = sum(
        counts[r.name] * float(np.median(np.diff(r.time)))
        for r in dataset.recordings
        if len(r.time) > 1
    )
    if total < needed:
        return [
            Problem(
                "too-few-frames",
                True,
                f"{total} of {dataset.frame_count} frames have markers and all signals, and"
                f" {c} channels need {needed}",
                "Record for longer",
                total,
                data={"needed": needed},
            )
        ]
    if duration < MIN_DURATION_S:
        return [
            Problem(
                "few-frames",
                False,
                f"frames with markers and all signals last {duration:.0f} s in total",
                f"Record {MIN_DURATION_S:.0f} s or more, with all movements of the device",
                duration,
            )
        ]
    return []


def _check_gaps(dataset: Dataset) -> Iterator[Problem]:
    """Find frames outside of the samples, frames without markers, and markers never visible."""
    for r in dataset.recordings:
        is_outside = (r.time < r.sample_time[0]) | (r.time > r.sample_time[-1])
        if is_outside.mean() > _MAX_SHARE_WITHOUT_SAMPLES:
            yield Problem(
                "frames-without-samples",
                False,
                f"{r.name}: {is_outside.mean():.0%} of the frames are before or after all"
                f" samples (samples {r.sample_time[0]:.1f} to {r.sample_time[-1]:.1f} s, frames"
                f" {r.time[0]:.1f} to {r.time[-1]:.1f} s)",
                "Check whether the file of the signals is truncated",
                float(is_outside.mean()),
                (r.name,),
            )
        share = float((~r.visible.any(axis=1)).mean()) if len(r.time) else 1.0
        if share > _MAX_SHARE_WITHOUT_MARKERS and dataset.targets is not None:
            yield Problem(
                "times-without-targets",
                False,
                f"{r.name}: {share:.0%} of the times have no target",
                "Check whether the file of the targets is complete",
                share,
                (r.name,),
            )
        elif share > _MAX_SHARE_WITHOUT_MARKERS:
            yield Problem(
                "frames-without-markers",
                share == 1,
                f"{r.name}: {share:.0%} of the frames show no marker",
                "Move the cameras, or the hands that cover the markers, and record again"
                if share < 1
                else "Leave the recording out",
                share,
                (r.name,),
            )
    never = dataset.ids[~np.any([r.visible.any(axis=0) for r in dataset.recordings], axis=0)]
    if len(never) and dataset.targets is None:
        yield Problem(
            "markers-never-seen",
            False,
            f"markers {', '.join(map(str, never.tolist()))} were never visible and cannot be"
            " decoded",
            "Turn the device so that the cameras see them",
            len(never),
            data={"markers": tuple(never.tolist())},
        )


def _check_rest_pose(dataset: Dataset) -> list[Problem]:
    """Find recordings in which the device is never at rest; other sensors need no rest."""
    if dataset.targets is not None:
        return []
    lacking = [r.name for r in dataset.recordings if _rest_duration(dataset, r) < _MIN_REST_S]
    if not lacking:
        return []
    return [
        Problem(
            "no-rest-pose",
            len(lacking) == len(dataset.recordings),
            f"{', '.join(lacking)}: the markers are never within {_MAX_REST_DISTANCE_MM:.0f} mm of"
            f" their rest positions for {_MIN_REST_S} s",
            "Start with some seconds in which nothing touches the device, and check that the tracks"
            " are in its frame",
            recordings=tuple(lacking),
        )
    ]


def _rest_duration(dataset: Dataset, r: Recording) -> float:
    """Return the longest time in s during which the moving markers are at their rest positions.

    Frames without a visible marker do not interrupt it.
    """
    spread = np.zeros(len(dataset.ids))
    for k, is_visible in enumerate(r.visible.T):
        if is_visible.any():
            spread[k] = np.sqrt(r.points[is_visible, k].var(axis=0).sum())
    is_moving = spread > _MAX_REST_DISTANCE_MM / 3
    is_used = is_moving if is_moving.any() else np.ones_like(is_moving)
    visible = r.visible & is_used
    # The median over the markers of a frame: some may be wrong.
    distance = np.where(visible, np.linalg.norm(r.points - dataset.rest_points, axis=2), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without a marker
        median = np.nanmedian(distance, axis=1)
    frames = np.flatnonzero(visible.any(axis=1))
    is_at_rest = median[frames] <= _MAX_REST_DISTANCE_MM
    start, end = longest_run(np.asarray(is_at_rest))
    return float(r.time[frames[end - 1]] - r.time[frames[start]]) if end > start else 0.0


def _is_layout_uninformative(r: Recording, predicted: Float | None) -> bool:
    """Return whether the layout is the reason why signals explain little of the movement.

    This is so if the predicted signals (t, c) explain little too, and a channel correlates with its
    prediction, so that signals and markers are in step.
    """
    if predicted is None:
        return False
    expected = replace(r, sample_time=r.time, ohm=1 + predicted, rest=np.ones(predicted.shape[1]))
    shift = find_time_shift([expected])
    if shift is None or shift.is_informative:
        return False
    signals = r.signals_at(r.time)
    for one, other in zip(signals.T, predicted.T, strict=True):
        is_known = np.isfinite(one) & np.isfinite(other)
        a, b = one[is_known] - one[is_known].mean(), other[is_known] - other[is_known].mean()
        norms = _MIN_CORRELATION * np.linalg.norm(a) * np.linalg.norm(b)
        if is_known.sum() >= MIN_FRAMES and a @ b > norms > 0:
            return True
    return False


def _check_alignment(dataset: Dataset, predicted: Mapping[str, Float]) -> Iterator[Problem]:
    """Find recordings whose signals are not in step with the targets, or may not be."""
    shifts, unknown = find_time_shifts(dataset), list[str]()
    for r in dataset.recordings:
        shift = shifts.get(r.name)
        if shift is None:
            continue
        if not shift.is_informative:
            yield _uninformative(r, shift, predicted.get(r.name))
        elif shift.is_significant:
            yield _out_of_step(r, shift)
        elif not shift.is_known:
            unknown.append(r.name)
    if unknown:
        low, high = (f([getattr(shifts[n], key) for n in unknown]) for f, key in _ENDS)
        yield Problem(
            _UNKNOWN,
            False,
            f"{', '.join(unknown)}: the data do not show whether signals and markers are in step"
            f" (shifts of {low:+.2f} to {high:+.2f} s explain them as well)",
            "If their clocks agree, state that they are in step; else include some fast movements",
            recordings=tuple(unknown),
            data={"low_s": low, "high_s": high},
        )


def _uninformative(r: Recording, shift: TimeShift, predicted: Float | None) -> Problem:
    """Return the problem that signals and movement have little in common."""
    message = f"{r.name}: the signals explain {max(shift.match, 0):.0%} of the markers' movement"
    if _is_layout_uninformative(r, predicted):
        return Problem(
            "cords-tell-little",
            False,
            f"{message}, as the simulation predicts for this layout",
            "Improve the layout of the cords; a build reports its expected error",
            shift.match,
            (r.name,),
        )
    return Problem(
        _UNINFORMATIVE,
        shift.match < _FATAL_EXPLAINED,
        f"{message}, at any shift of up to {MAX_SHIFT_S:.1f} s",
        "Check whether the clocks are further apart, and whether signals and markers are of one"
        " device and time",
        shift.match,
        (r.name,),
    )


def _out_of_step(r: Recording, shift: TimeShift) -> Problem:
    """Return the warning that signals are early or late, even with a memory in the model."""
    direction = "late" if shift.seconds < 0 else "early"
    future = (
        " Only if the clocks are wrong: this shift uses samples from after each frame."
        if shift.seconds < 0
        else ""
    )
    return Problem(
        _OUT_OF_STEP,
        False,
        f"{r.name}: signals are {abs(shift.seconds):.2f} s {direction} ({shift.range_text}): with"
        f" a memory, {shift.fit:.0%} of their changes follow from the movement when shifted by"
        f" {shift.seconds:+.2f} s, and {max(shift.fit_before, 0):.0%} as they are",
        f"Shift the signals automatically, or by {shift.seconds:.2f} s; or state that they are in"
        f" step.{future}".rstrip("."),
        shift.seconds,
        (r.name,),
        {"low_s": shift.low, "high_s": shift.high, "is_future": shift.seconds < 0},
    )
