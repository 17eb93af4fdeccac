"""Detect channels without information, and channels that differ from those of other recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core.arrays import Bool, Float
from .dataset import Dataset, Recording
from .problems import Problem

MAX_INVALID_S = 1.0  # without a valid resistance, at once
_FATAL_SHARE = 0.5  # of the samples
MIN_CLIPPED_SHARE = 0.02  # of the samples, at the end of the converter's range
MAX_STUCK_S = 3.0  # without a change, while others move
_MIN_MOVEMENT = 0.3  # of its own range, by which another channel moves meanwhile
MIN_RANGE = 1e-5  # (R - R0)/R0; a channel with a smaller range does not change
_MAX_REST_CHANGE = 0.15  # of R0, by which the same cord changes at most
_MAX_REST_DEVIATIONS = 6.0  # times the usual change of R0 between sessions
_MAX_GAIN_RATIO = 1.35  # by which the same cord is more or less sensitive
_MIN_CORRELATION = 0.6  # of a channel with its expected signal
_MIN_CORRELATION_GAIN = 0.15  # by which the mean correlation is higher in another order
_RIDGE = 1e-3
_MIN_FRAMES = 100
_MIN_VISIBLE_SHARE = 0.5  # of the frames, for a marker to be used
#: What signals are compared with, by its code.
_REFERENCES = {"prediction": "the prediction", "sessions": "the other sessions"}


def check_channels(dataset: Dataset, predicted: Mapping[str, Float] | None = None) -> list[Problem]:
    """Check the channels of each recording, and compare those of different recordings.

    Args:
        dataset: The dataset.
        predicted: Predicted signals (R - R0)/R0 at the frames of recordings, shape (t, c), by the
            recordings' names, where known.

    Returns:
        The problems found.
    """
    problems = [p for r in dataset.recordings for p in _check_range(dataset, r)]
    constant = [
        name
        for k, name in enumerate(dataset.channels)
        if all(
            np.isfinite(r.signals[:, k]).any() and range_of(r.signals[:, k]) < MIN_RANGE
            for r in dataset.recordings
        )
    ]
    if constant:
        problems.append(
            Problem(
                "constant-channel",
                True,
                f"{', '.join(constant)} does not change in any recording",
                "Check whether its cord is connected, and record again",
                data={"channels": tuple(constant)},
            )
        )
    problems += [p for r in dataset.recordings for p in _check_stuck(dataset, r, constant)]
    return [*problems, *_check_rest(dataset), *_check_expected(dataset, predicted or {})]


def longest_run(flags: Bool) -> tuple[int, int]:
    """Return the start and end (exclusive) of the longest run of true flags (n,); 0, 0 if none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    if not len(edges):
        return 0, 0
    start, end = edges[::2], edges[1::2]
    k = int(np.argmax(end - start))
    return int(start[k]), int(end[k])


def _check_range(dataset: Dataset, r: Recording) -> Iterator[Problem]:
    """Find channels that are open, shorted, or at an end of the converter's range."""
    step = float(np.median(np.diff(r.sample_time))) if len(r.sample_time) > 1 else 0.0
    for k, name in enumerate(dataset.channels):
        R, R0 = r.ohm[:, k], r.rest[k]
        is_bad = ~np.isfinite(R) | (R <= 0)
        if is_bad.all() or not np.isfinite(R0):
            yield Problem(
                "missing-channel",
                True,
                f"{r.name}: {name} has no resistance",
                "Leave the recording out, or record it again",
                recordings=(r.name,),
                data={"channels": (name,)},
            )
            continue
        is_shorted = 2 * (R <= 0).sum() > is_bad.sum()
        state = "shorted" if is_shorted else "open"
        description = "shorted" if is_shorted else "open or out of range"
        longest, share = step * run_length(is_bad), float(is_bad.mean())
        if not (longest > MAX_INVALID_S or share > _FATAL_SHARE):
            is_bad, state, description = is_at_end(R), "clipped", "at the end of its range"
            longest, share = step * run_length(is_bad), float(is_bad.mean())
            # A channel that never changes is at both ends of its range; it is reported as constant.
            has_changes = range_of(r.signals[:, k]) >= MIN_RANGE
            is_clipped = has_changes and share > MIN_CLIPPED_SHARE and longest > MAX_INVALID_S / 2
            if not (is_clipped and do_others_move(r, k, *longest_run(is_bad))):
                continue
        yield Problem(
            "saturated-channel",
            share > _FATAL_SHARE,
            f"{r.name}: {name} is {description} for {share:.0%} of the samples,"
            f" {longest:.1f} s at once",
            "Check its wires and reference resistor; these samples hold no information",
            share,
            (r.name,),
            {"channel": name, "state": state, "longest_s": longest},
        )


def is_at_end(R: Float) -> Bool:
    """Return which samples (n,) equal the largest or the smallest value, the more frequent."""
    known = R[np.isfinite(R)]
    ends = [np.asarray(end == R) for end in (known.max(), known.min())]
    return max(ends, key=lambda flags: int(flags.sum()))


def do_others_move(r: Recording, k: int, start: int, end: int) -> bool:
    """Return whether a channel other than `k` moves between two samples."""
    others = [column for j, column in enumerate(r.signals.T) if j != k]
    return any(
        range_of(s[start:end]) > _MIN_MOVEMENT * range_of(s) > _MIN_MOVEMENT * MIN_RANGE
        for s in others
    )


def _check_stuck(dataset: Dataset, r: Recording, constant: Sequence[str]) -> Iterator[Problem]:
    """Find channels that do not change while others move, except those that never change."""
    if len(r.sample_time) < 2:
        return
    step = float(np.median(np.diff(r.sample_time)))
    for k, name in enumerate(dataset.channels):
        if name in constant:
            continue
        R = r.ohm[:, k]
        is_repeated = np.append(False, (R[1:] == R[:-1]) & np.isfinite(R[1:]))
        start, end = longest_run(is_repeated)
        start = max(start - 1, 0)
        duration = step * (end - start)
        if duration > MAX_STUCK_S and do_others_move(r, k, start, end):
            is_fatal = (end - start) / len(R) > _FATAL_SHARE
            yield Problem(
                "stuck-channel",
                is_fatal,
                f"{r.name}: {name} stays the same for {duration:.1f} s, from"
                f" {r.sample_time[start]:.1f} s on, while others move",
                "Check its wires, and leave the recording out"
                if is_fatal
                else "Check its wires; leave the recording out if this lasts long",
                duration,
                (r.name,),
                {"channel": name, "start_s": float(r.sample_time[start])},
            )


def _check_rest(dataset: Dataset) -> Iterator[Problem]:
    """Find sessions in which R0 of one channel differs from the unit's other sessions."""
    for unit, sessions in _sessions_by_unit(dataset).items():
        names = list(sessions)
        if len(names) < 2:
            continue
        R0 = np.array([np.median([r.rest for r in sessions[n]], axis=0) for n in names])
        with np.errstate(all="ignore"):
            change = np.log(R0) - np.median(np.log(R0), axis=0)
        for k, name in enumerate(names):
            # Of two sessions, either could be the odd one: the later one is reported.
            if len(names) == 2 and k == 0:
                continue
            relative = change[k] - change[0] if len(names) == 2 else change[k]
            usual = (
                np.median(relative[np.isfinite(relative)]) if np.isfinite(relative).any() else 0.0
            )
            spread = 1.48 * float(np.nanmedian(np.abs(relative - usual)))
            for c, channel in enumerate(dataset.channels):
                deviation = float(relative[c] - usual)
                if abs(deviation) > max(np.log1p(_MAX_REST_CHANGE), _MAX_REST_DEVIATIONS * spread):
                    ratio = float(np.exp(deviation))
                    yield Problem(
                        "replaced-cord",
                        False,
                        f"{name}: R0 of {channel} is {ratio:.2f} times that of the other"
                        f" sessions of {unit}; its cord or wires may have been replaced",
                        "Train on the sessions since then, or give later sessions another unit"
                        " name",
                        ratio,
                        tuple(r.name for r in sessions[name]),
                        {"session": name, "channel": channel},
                    )


def _check_expected(dataset: Dataset, predicted: Mapping[str, Float]) -> Iterator[Problem]:
    """Find sessions whose channels are permuted or scaled.

    Their signals are compared with predicted ones, or with those that the unit's other sessions
    have at similar marker positions.
    """
    for sessions in _sessions_by_unit(dataset).values():
        names = list(sessions)
        for k, name in enumerate(names):
            others = [r for n in names if n != name for r in sessions[n]]
            measured, expected, source = [], [], "prediction"
            for r in sessions[name]:
                signals = r.signals_at(r.time)
                if r.name in predicted:
                    reference: Float | None = predicted[r.name]
                elif others and (k > 0 or len(names) > 2):
                    reference, source = _signals_of_others(others, r), "sessions"
                else:
                    reference = None
                if reference is not None:
                    measured.append(signals)
                    expected.append(reference)
            if measured:
                yield from _compare_signals(
                    dataset.channels,
                    name,
                    tuple(r.name for r in sessions[name]),
                    np.concatenate(measured),
                    np.concatenate(expected),
                    source,
                )


def _compare_signals(
    channels: Sequence[str],
    session: str,
    recordings: tuple[str, ...],
    measured: Float,
    expected: Float,
    source: str,
) -> list[Problem]:
    """Compare measured and expected signals (t, c) of a session."""
    is_known = np.isfinite(measured).all(axis=1) & np.isfinite(expected).all(axis=1)
    m, e = measured[is_known], expected[is_known]
    if len(m) < _MIN_FRAMES or (m.std(axis=0) == 0).any() or (e.std(axis=0) == 0).any():
        return []
    c = len(channels)
    correlation = np.corrcoef(m.T, e.T)[:c, c:]
    order = linear_sum_assignment(-correlation)[1]
    current = float(np.diag(correlation).mean())
    best = float(correlation[np.arange(c), order].mean())
    wrong = np.flatnonzero(order != np.arange(c))
    if (
        len(wrong)
        and best - current > _MIN_CORRELATION_GAIN
        and correlation[wrong, order[wrong]].min() > _MIN_CORRELATION
    ):
        matches = {channels[k]: channels[order[k]] for k in wrong.tolist()}
        pairs = ", ".join(f"{a} looks like {b}" for a, b in matches.items())
        return [
            Problem(
                "permuted-channels",
                True,
                f"{session}: by {_REFERENCES[source]}, {pairs}; its channels may be in"
                " another order",
                "Check how the cords are plugged in, or rename the columns",
                best - current,
                recordings,
                {"session": session, "source": source, "order": matches},
            )
        ]
    gain = np.diag(correlation) * m.std(axis=0) / e.std(axis=0)  # slopes of lines that are fitted
    is_certain = np.diag(correlation) > _MIN_CORRELATION
    # Predictions use the response of some cord, measurements have that of this device's cords.
    ratio = gain / (float(np.median(gain)) if source == "prediction" else 1.0)
    return [
        Problem(
            "changed-gain",
            False,
            f"{session}: {channels[k]} changes {ratio[k]:.2f} times as much as expected by"
            f" {_REFERENCES[source]}; its cord may have been replaced",
            "Train on the sessions since then, or give later sessions another unit name",
            float(ratio[k]),
            recordings,
            {"session": session, "channel": channels[k]},
        )
        for k in range(c)
        if is_certain[k] and ratio[k] > 0 and abs(np.log(ratio[k])) > np.log(_MAX_GAIN_RATIO)
    ]


def _signals_of_others(others: Sequence[Recording], r: Recording) -> Float | None:
    """Predict signals (t, c) at the frames of a recording from its marker positions.

    The prediction is a ridge regression of the other recordings' signals on their markers; None if
    too few markers are visible in all.
    """
    is_used = r.visible.mean(axis=0) > _MIN_VISIBLE_SHARE
    for other in others:
        is_used &= other.visible.mean(axis=0) > _MIN_VISIBLE_SHARE
    if not is_used.any():
        return None

    def inputs(of: Recording) -> Float:
        return of.points[:, is_used].reshape(len(of.time), -1)

    x = np.concatenate([inputs(other) for other in others])
    y = np.concatenate([other.signals_at(other.time) for other in others])
    is_known = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if is_known.sum() < _MIN_FRAMES:
        return None
    x, y = x[is_known], y[is_known]
    center, mean = x.mean(axis=0), y.mean(axis=0)
    size = float(x.std()) or 1.0
    z = (x - center) / size
    normal = z.T @ z + _RIDGE * len(z) * np.eye(z.shape[1])
    return np.asarray(
        (inputs(r) - center) / size @ np.linalg.solve(normal, z.T @ (y - mean)) + mean
    )


def _sessions_by_unit(dataset: Dataset) -> dict[str, dict[str, list[Recording]]]:
    """Return the recordings by unit and session."""
    units: dict[str, dict[str, list[Recording]]] = {}
    for r in dataset.recordings:
        units.setdefault(r.unit, {}).setdefault(r.session, []).append(r)
    return units


def range_of(values: Float) -> float:
    """Return the difference of the 99th and first percentile of the known values."""
    known = values[np.isfinite(values)]
    return float(np.subtract(*np.percentile(known, [99, 1]))) if len(known) else 0.0


def run_length(flags: Bool) -> int:
    """Return the length of the longest run of true flags (n,)."""
    start, end = longest_run(flags)
    return end - start
