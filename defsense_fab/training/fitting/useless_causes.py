"""Find the likeliest cause of a useless model from its test frames.

Most causes have a correction: another time shift, another order of channels or labels, a factor, an
offset. The correction that reduces the error most is the likeliest cause, if it explains enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core.arrays import Float
from ...decoding.trained_model import UNTRAINED_DISTANCE, TrainedModel
from ..data.dataset_assembly import select_channel_indices
from ..data.time_alignment import MAX_WIDE_SHIFT_S, find_wide_shift
from ..regression.frames import Frames
from ..regression.simulation_prior import Prior, predict_signals
from .usefulness import (
    MAX_ERROR_SHARE,
    Cause,
    Usefulness,
    decode,
    decode_at,
    measure_usefulness,
    rms_distance,
)

_SHIFT_STEP_S = 0.1
_MAX_FRAMES = 300  # that are compared
_MAX_REMAINING = 0.6  # share of the error that remains after the correction of its cause
_MIN_MOVEMENT_MM = 0.5  # smaller movement is not measured by cameras
_MIN_NOISES = 2.0  # times the cameras' noise, which the movement must exceed
_MAX_DEAD_RANGE = 0.05  # of the range in training, of a channel that no longer changes
_MAX_ALL_ORDERS = 5  # channels whose orders are all tried
_MAX_PAIRED_CHANNELS = 12  # channels whose pairs are exchanged one after the other
_MIN_FACTOR = 3.0  # by which movements are too large or too small
_MAX_WRONG_MARKERS = 0.2  # of the markers
_MAX_CORRELATION = 0.3  # of signals with their prediction, of another device
_MAX_BEYOND_SHARE = 0.5  # of the frames beyond the trained range
_RANGE_PERCENTILES = (1.0, 99.0)  # between which a channel's range is measured
_MAX_EXCHANGE_RATIO = 1.5  # of the errors after exchanging markers, and without them
_EXCHANGED = "markers-exchanged"
_MAX_SHOWN = 3  # markers that are named

#: The error that remains after a correction, mm, and the cause that the correction belongs to.
Candidate = tuple[float, Cause]


def judge_model(model: TrainedModel, frames: Frames, prior: Prior | None = None) -> Usefulness:
    """Judge whether a model is useful; find the likeliest cause if it is not.

    Args:
        model: The model.
        frames: Test frames, with the model's channels and markers in its order.
        prior: Simulated states of the device, if available.

    Returns:
        The judgment; a useless model has a cause.
    """
    judgment = measure_usefulness(model, frames)
    if not judgment.is_useless:
        return judgment
    return replace(judgment, cause=_find_cause(model, frames, judgment, prior))


def _find_cause(
    model: TrainedModel, frames: Frames, judgment: Usefulness, prior: Prior | None
) -> Cause:
    cause = _little_movement(frames, judgment) or _dead_channels(model, frames)
    if cause is not None:
        return cause
    few = _thin(frames, _MAX_FRAMES)
    decoded = decode(model, few)
    error = rms_distance(few.points, decoded)
    corrections = [
        *_time_shifts(model, few),
        *_channel_orders(model, few),
        *_label_orders(model, few, decoded),
        *_factors(model, few, decoded),
        *_offsets(few, decoded),
    ]
    remaining, likeliest = min(corrections, key=lambda candidate: candidate[0])
    if (wrong := _wrong_markers(model, few, decoded)) is not None:
        # Two markers with each other's numbers are also few, and need not be left out.
        is_exchange = likeliest.code == _EXCHANGED
        if not is_exchange or remaining > _MAX_EXCHANGE_RATIO * wrong.data["remaining_mm"]:
            return wrong
    if remaining < _MAX_REMAINING * error:
        unit = frames.dataset.units[0]
        text = f"{likeliest.message} (without it, the error is {remaining:.2f} {unit})"
        data = {**likeliest.data, "remaining_mm": remaining}
        return replace(likeliest, message=text, data=data)
    return (
        _shift_of_all(frames)
        or _other_device(frames, prior)
        or _untrained_movement(model, frames)
        or Cause(
            "signals-tell-nothing",
            "the signals explain little of the movement, at any time shift and in any order",
            "Check that each channel is connected as in the training, and that signals and"
            f" {_targets(frames)} are of one device and time",
        )
    )


def _targets(frames: Frames) -> str:
    return "markers" if frames.dataset.targets is None else "targets"


def _thin(frames: Frames, count: int) -> Frames:
    """Return at most `count` frames, evenly chosen."""
    index = np.linspace(0, len(frames) - 1, min(count, len(frames)))
    return frames.select(np.unique(index.astype(int)))


def _little_movement(frames: Frames, judgment: Usefulness) -> Cause | None:
    known = frames.sigma[np.isfinite(frames.sigma).all(axis=2)]
    noise = float(np.sqrt((known**2).sum(axis=1).mean())) if len(known) else 0.0
    is_device = frames.dataset.targets is None
    least = _MIN_MOVEMENT_MM if is_device else 0.0  # numbers of other units can be of any size
    if judgment.movement > max(least, _MIN_NOISES * noise):
        return None
    unit = frames.dataset.units[0]
    text = f"the {_targets(frames)} hardly move in the test frames ({judgment.movement:.2f} {unit}"
    text += f"; the cameras' noise is {noise:.2f} {unit})" if noise else ")"
    action = "Record all movements until the end"
    return Cause("too-little-movement", text, action, {"noise_mm": noise})


def _dead_channels(model: TrainedModel, frames: Frames) -> Cause | None:
    """Find channels that change in training and not in the test frames."""
    signals = np.concatenate(
        [
            r.signals_at(r.time[frames.frame_index[frames.recording_index == k]])
            for k, r in enumerate(frames.dataset.recordings)
        ]
    )
    used = list(model.main.channels)
    low, high = np.nanpercentile(model.correct(signals)[:, used], _RANGE_PERCENTILES, axis=0)
    trained = model.main.range.high - model.main.range.low
    dead = [model.channels[used[k]] for k in np.flatnonzero(high - low < _MAX_DEAD_RANGE * trained)]
    if not dead:
        return None
    verb = "does" if len(dead) == 1 else "do"
    text = f"{', '.join(dead)} {verb} not change in the test frames"
    return Cause(
        "constant-channel", text, "Check the wires of these cords", {"channels": tuple(dead)}
    )


def _time_shifts(model: TrainedModel, frames: Frames) -> Iterator[Candidate]:
    """Yield the time shift at which the model's positions fit best."""
    shifts = np.arange(-MAX_WIDE_SHIFT_S, MAX_WIDE_SHIFT_S + _SHIFT_STEP_S / 2, _SHIFT_STEP_S)
    squares, counts = np.zeros(len(shifts)), np.zeros(len(shifts))
    for k, r in enumerate(frames.dataset.recordings):
        is_of_recording = frames.recording_index == k
        if not is_of_recording.any():
            continue
        time, points = r.time[frames.frame_index[is_of_recording]], frames.points[is_of_recording]
        start = max(r.sample_time[0], time[0] - MAX_WIDE_SHIFT_S)
        end = min(r.sample_time[-1], time[-1] + MAX_WIDE_SHIFT_S)
        grid = np.arange(start, end, _SHIFT_STEP_S)
        if not len(grid):
            continue
        decoded = decode_at(model, r.sample_time, r.signals, grid)
        for i, shift in enumerate(shifts):
            at = np.rint((time - shift - start) / _SHIFT_STEP_S).astype(int)
            is_inside = (at >= 0) & (at < len(grid))
            distance = ((points[is_inside] - decoded[at[is_inside]]) ** 2).sum(axis=2)
            squares[i] += np.nansum(distance)
            counts[i] += np.isfinite(distance).sum()
    # Shifts that only few frames have in common with the samples prove nothing.
    is_tried = counts > 0.5 * counts.max(initial=0.0)
    with np.errstate(all="ignore"):
        errors = np.where(is_tried, np.sqrt(squares / counts), np.inf)
    k = int(errors.argmin())
    yield float(errors[k]), _time_cause(float(shifts[k]))


def _time_cause(shift: float) -> Cause:
    return Cause(
        "out-of-step",
        f"the signals are {abs(shift):.1f} s {'late' if shift < 0 else 'early'}",
        f"Shift the signals by {shift:+.1f} s, or record with clocks that agree",
        {"shift_s": shift},
    )


def _channel_orders(model: TrainedModel, frames: Frames) -> Iterator[Candidate]:
    """Yield orders of the channels in which the model's error is smaller."""
    c = len(model.channels)

    def error_of(order: Sequence[int]) -> float:
        dataset = select_channel_indices(frames.dataset, order)
        return rms_distance(frames.points, decode(model, replace(frames, dataset=dataset)))

    identity = tuple(range(c))
    if c <= _MAX_ALL_ORDERS:
        for order in permutations(identity):
            if order != identity:
                yield error_of(order), _order_cause(model.channels, order)
        return
    best, order = np.inf, identity
    while c <= _MAX_PAIRED_CHANNELS:  # exchange the pair that reduces the error most
        swapped = [_swap(order, a, b) for a, b in combinations(identity, 2)]
        errors = [error_of(each) for each in swapped]
        k = int(np.argmin(errors))
        if errors[k] >= best:
            return
        best, order = errors[k], swapped[k]
        yield best, _order_cause(model.channels, order)


def _swap(order: Sequence[int], a: int, b: int) -> tuple[int, ...]:
    swapped = list(order)
    swapped[a], swapped[b] = swapped[b], swapped[a]
    return tuple(swapped)


def _order_cause(channels: Sequence[str], order: Sequence[int]) -> Cause:
    matches = {channels[other]: channels[k] for k, other in enumerate(order) if other != k}
    pairs = ", ".join(f"{a} looks like {b}" for a, b in matches.items())
    return Cause(
        "permuted-channels",
        f"the channels are in another order: {pairs}",
        "Check how the cords are plugged in, or rename the columns",
        {"order": matches},
    )


def _label_orders(model: TrainedModel, frames: Frames, decoded: Float) -> Iterator[Candidate]:
    """Yield the order of the markers in which they fit the decoded ones best."""
    m = len(model.ids)
    cost = np.full((m, m), np.inf)
    for k in range(m):
        distance = ((frames.points[:, k, None] - decoded) ** 2).sum(axis=2)
        is_visible = np.isfinite(distance).all(axis=1)
        cost[k] = distance[is_visible].sum(axis=0) if is_visible.any() else 0.0
    order = linear_sum_assignment(cost)[1]
    wrong = np.flatnonzero(order != np.arange(m))
    if len(wrong):
        matches = {int(model.ids[k]): int(model.ids[order[k]]) for k in wrong}
        shown = ", ".join(f"{a} moves like {b}" for a, b in list(matches.items())[:_MAX_SHOWN])
        more = f" and {len(matches) - _MAX_SHOWN} more" if len(matches) > _MAX_SHOWN else ""
        yield (
            rms_distance(frames.points, decoded[:, order]),
            Cause(
                _EXCHANGED,
                f"markers have each other's numbers: {shown}{more}",
                "Check the labels of the tracks",
                {"order": matches},
            ),
        )


def _factors(model: TrainedModel, frames: Frames, decoded: Float) -> Iterator[Candidate]:
    """Yield the factor between measured and decoded movements, if it is that of another unit."""
    measured, moved = frames.points - model.rest_points, decoded - model.rest_points
    is_known = np.isfinite(measured) & np.isfinite(moved)
    a, b = measured[is_known], moved[is_known]
    if not b @ b > 0:
        return
    factor = float(a @ b / (b @ b))
    if factor <= 0 or 1 / _MIN_FACTOR < factor < _MIN_FACTOR:
        return
    yield (
        rms_distance(measured, factor * moved),
        Cause(
            "wrong-unit",
            f"the {_targets(frames)} move {factor:.3g} times as far as the model expects",
            "Check the units of the positions and of the resistances, and R0",
            {"factor": factor},
        ),
    )


def _offsets(frames: Frames, decoded: Float) -> Iterator[Candidate]:
    """Yield a constant offset of the markers."""
    missed = frames.points - decoded
    with np.errstate(all="ignore"):
        offset = np.nansum(missed, axis=0) / np.isfinite(missed).sum(axis=0)
    size, unit = float(np.sqrt(np.nanmean((offset**2).sum(axis=1)))), frames.dataset.units[0]
    yield (
        rms_distance(missed, offset),
        Cause(
            "rest-changed",
            f"the {_targets(frames)} are off by the same {size:.1f} {unit} in all frames",
            "Check the resistances at rest R0, and the frame of the tracks",
            {"offset_mm": size},
        ),
    )


def _wrong_markers(model: TrainedModel, frames: Frames, decoded: Float) -> Cause | None:
    """Find few markers without which the model is useful."""
    squares = ((frames.points - decoded) ** 2).sum(axis=2)
    worst = np.argsort(-np.nansum(squares, axis=0), kind="stable")
    for count in range(1, int(_MAX_WRONG_MARKERS * len(worst)) + 1):
        kept = np.sort(worst[count:])
        error = rms_distance(frames.points[:, kept], decoded[:, kept])
        # The movement about the rest shape: a marker of another object is far from it.
        movement = rms_distance(frames.points[:, kept], model.rest_points[kept])
        if error < _MAX_REMAINING * MAX_ERROR_SHARE * movement:
            markers = sorted(int(model.ids[k]) for k in worst[:count])
            text = ", ".join(map(str, markers))
            subject = f"marker {text} is" if count == 1 else f"markers {text} are"
            return Cause(
                "wrong-markers",
                f"{subject} not where the device moves; without, the error is {error:.2f} mm",
                "Check the labels of the tracks, or leave these markers out",
                {"markers": tuple(markers), "remaining_mm": error},
            )
    return None


def _shift_of_all(frames: Frames) -> Cause | None:
    """Find a time shift of whole recordings, at which the signals explain the movement."""
    for k, r in enumerate(frames.dataset.recordings):
        if not (frames.recording_index == k).any():
            continue
        shift = find_wide_shift(r)
        if shift is not None:
            cause = _time_cause(shift.seconds)
            return replace(cause, data={**cause.data, "explained": shift.match})
    return None


def _other_device(frames: Frames, prior: Prior | None) -> Cause | None:
    """Find signals that do not resemble the simulated ones in any channel."""
    if prior is None:
        return None
    dataset, correlations = frames.dataset, list[float]()
    for r in dataset.recordings:
        predicted, measured = predict_signals(prior, r, dataset.rest_points), r.signals_at(r.time)
        for one, other in zip(measured.T, predicted.T, strict=True):
            is_known = np.isfinite(one) & np.isfinite(other)
            a, b = one[is_known] - one[is_known].mean(), other[is_known] - other[is_known].mean()
            size = float(np.linalg.norm(a) * np.linalg.norm(b))
            if size > 0:
                correlations.append(float(a @ b) / size)
    if not correlations or max(correlations) > _MAX_CORRELATION:
        return None
    return Cause(
        "device-differs",
        "no channel resembles the simulation of the device (correlation at most"
        f" {max(correlations):.2f})",
        "Check that signals, markers and the build are of the same device",
        {"correlation": max(correlations)},
    )


def _untrained_movement(model: TrainedModel, frames: Frames) -> Cause | None:
    inputs = np.concatenate(
        [
            model.main.inputs(r.sample_time, model.correct(r.signals))
            for r in frames.dataset.recordings
        ]
    )
    inputs = inputs[np.isfinite(inputs).all(axis=1)]
    distance = model.main.signal_range.distance(inputs[:, : len(model.main.channels)])
    share = float((distance > UNTRAINED_DISTANCE).mean()) if len(inputs) else 0.0
    if share < _MAX_BEYOND_SHARE:
        return None
    return Cause(
        "untrained-movement",
        f"{share:.0%} of the signals are beyond what the model was trained on",
        "Train on recordings that show these movements",
        {"share": share},
    )
