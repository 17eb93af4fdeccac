"""Where the error of a trained model comes from: its mean square split by cause, mm^2.

The shares add up to the mean square error. Two are variances:

- read-out noise: what noise like that of the samples at rest does to the decoded positions;
- camera noise: the cameras' own variances of the markers' positions, where they are known;

and five are what a correction would gain on frames that it was not fitted to, one after another
(`cross_fitting.py`):

- clocks: one delay for each run, at most twice the standard error of the clocks' comparison;
- placement and gain: an offset and a gain for each channel, the same in all runs;
- drift: with these, an offset for each channel and run that moves in a straight line of time;
- decoder: products and radial basis functions of what the decoder sees, within the trained range;
  fitted to what the decoder leaves of its own training data where those are given;
- hysteresis: memories of the signals (`decoding/signal_history.py`), fitted to what is left;

In what is left then,

- unseen poses: by how much the mean square beyond the trained range is larger than within, at most
  what noise leaves;

and the rest is unexplained. It can be less than 0, where a noise was stated larger than it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...decoding.input_decoder import InputFeatures
from ...decoding.signal_history import Past, at_times
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset
from .corrections import (
    RIDGES,
    ChannelCorrection,
    Residual,
    by_features,
    decoded_again,
    fitted_elsewhere,
    residual_of,
)
from .decoded_frames import DecodedFrames, decode_frames, matched
from .marker_motion import sample_noise, velocities

READ_OUT, CAMERAS, CLOCKS = "read-out noise", "camera noise", "clocks"
PLACEMENT, DRIFT, HYSTERESIS = "placement and gain", "drift", "hysteresis"
DECODER, UNSEEN, UNEXPLAINED = "decoder", "unseen poses", "unexplained"

# s, of the memories that hysteresis is looked for with; the first stands for the signal itself.
_MEMORIES = Past((0.1, 0.3, 1.0, 3.0, 10.0), (3.0,))
_BEFORE = 0.1  # s before a picture: memories that know its samples would take out their noise
_DRAWS = 4  # of the read-out's noise
_CENTERS = 60
_BACK = 0.2  # share of the frames that a correction brings back into the trained range
_GAINS = 0.5  # more than this is no cord that aged or was replaced
_MOST_SQUARED = 12  # inputs: they have 90 squares and products


@dataclass(frozen=True)
class ErrorBudget:
    """Mean square error, mm^2, and its share by cause, which add up to it."""

    total: float
    shares: dict[str, float]


def error_budget(
    model: TrainedModel, dataset: Dataset, last_share: float = 1.0,
    training: Dataset | None = None,
) -> ErrorBudget:  # fmt: skip
    """Of the last share of the pictures; `training` is what the model was trained on.
    Raises TrainingError as `decode_frames` does."""
    data = matched(model, dataset)
    frames = decode_frames(model, data, last_share)
    variance = np.nan_to_num((frames.sigma**2).sum(axis=2))
    shares = {READ_OUT: _read_out(model, data, frames), CAMERAS: frames.mean(variance)}
    left = residual_of(frames)
    total = left.square
    before, left = left, left.less(_delays(data, frames, left))
    shares[CLOCKS] = before.square - left.square
    placed, drifted, frames = _channels(model, data, frames, left)
    shares[PLACEMENT] = left.square - placed.square
    shares[DRIFT] = placed.square - drifted.square
    after = _richer(model, data, frames, drifted, training)
    shares[DECODER] = drifted.square - after.square
    left = _best(after, partial(by_features, after, _memories(model, data, frames)))
    shares[HYSTERESIS] = after.square - left.square
    # Noise moves frames beyond the range too; it is not to count twice.
    noise = shares[READ_OUT] + shares[CAMERAS]
    shares[UNSEEN] = min(_beyond(frames, left), max(left.square - noise, 0.0))
    return _added_up(total, shares)


def by_substitution(
    model: TrainedModel, stages: Sequence[tuple[str, Dataset]], last_share: float = 1.0
) -> ErrorBudget:
    """The same where the truth is known, as of a twin: the first dataset is what was recorded, and
    each after it has one cause more taken out, which its name is (true positions, signals without
    noise, without drift, ...). Its share is what the error loses by that, and can be less than 0.
    What is left at the end is the decoder's, unseen poses', and unexplained."""
    if len(stages) < 2:
        raise TrainingError(
            "give the recorded data, and at least one cause taken out of them",
            code="too-few-stages",
        )
    data = [matched(model, d) for _, d in stages]
    frames = [decode_frames(model, d, last_share) for d in data]
    keys = [list(zip(f.run.tolist(), f.time.tolist(), strict=True)) for f in frames]
    common = set(keys[0]).intersection(*keys[1:])
    if not common:
        raise TrainingError(
            f"{stages[0][1].device}: the datasets have no pictures in common",
            code="no-common-frames",
        )
    frames = [
        only(f, np.array([key in common for key in own]))
        for f, own in zip(frames, keys, strict=True)
    ]
    seen = np.logical_and.reduce([f.visible for f in frames])
    frames = [
        only(replace(f, measured=np.where(seen[..., None], f.measured, np.nan)), seen.any(axis=1))
        for f in frames
    ]
    squares = [f.mean(f.miss**2) for f in frames]
    shares = {
        cause: before - after
        for (cause, _), before, after in zip(stages[1:], squares, squares[1:], strict=False)
    }
    left = residual_of(frames[-1])
    after = _richer(model, data[-1], frames[-1], left, None)
    shares[DECODER] = left.square - after.square
    shares[UNSEEN] = _beyond(frames[-1], after)
    return _added_up(squares[0], shares)


def only(frames: DecodedFrames, which: Bool) -> DecodedFrames:
    """Those frames of a mask (t,)."""
    per_frame = ("run", "pose", "time", "elapsed", "predicted", "measured", "sigma", "radius",
                 "distance")  # fmt: skip
    return replace(frames, **{name: getattr(frames, name)[which] for name in per_frame})


def _added_up(total: float, shares: dict[str, float]) -> ErrorBudget:
    return ErrorBudget(total, {**shares, UNEXPLAINED: total - sum(shares.values())})


def _read_out(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> float:
    """Mean square of what noise as that of the samples at rest does, drawn a few times."""
    rng = np.random.default_rng(0)
    sizes = [sample_noise(r) for r in data.recordings]

    def noisy(k: int, _: Float, signals: Float) -> Float:
        return np.asarray(signals + sizes[k] * rng.normal(size=signals.shape))

    moved = [
        decoded_again(model, data, frames, noisy).points - frames.predicted for _ in range(_DRAWS)
    ]
    return float(np.mean([frames.mean((d**2).sum(axis=2)) for d in moved]))


def _delays(data: Dataset, frames: DecodedFrames, residual: Residual) -> Float:
    """What is predicted, later or earlier by one delay for each run."""
    speed = np.nan_to_num(velocities(frames.time, frames.predicted, frames.run))
    correction = np.zeros_like(residual.error)
    for k, r in enumerate(data.recordings):
        own = frames.run == k
        if r.sync_error is None or not own.any():
            continue
        fitting, folds, error = (x[own] for x in (residual.fitting, residual.fold, residual.error))
        for fold in range(int(folds.max()) + 1):
            w = fitting[folds != fold][..., None]
            v, e = speed[own][folds != fold], error[folds != fold]
            scale = float((w * v**2).sum())
            delay = float((w * v * e).sum()) / scale if scale > 0 else 0.0
            delay = float(np.clip(delay, -2 * r.sync_error, 2 * r.sync_error))
            here = np.flatnonzero(own)[folds == fold]
            correction[here] = delay * speed[here]
    return correction


def _corrected(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, left: Residual
) -> tuple[Residual, Residual, ChannelCorrection]:
    """After placement and gain, after drift, and what was corrected."""
    channels = ChannelCorrection(model, data, frames)
    placed = left.less(channels.placed(left))
    drifted = placed.less(channels.drifted(placed))
    if np.abs(channels.gains).max() > _GAINS:
        return left, left, channels
    return placed, drifted, channels


def _channels(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, left: Residual
) -> tuple[Residual, Residual, DecodedFrames]:
    """After placement and gain, and after drift; and the frames, which lie within the trained range
    if the corrected signals do.

    Poses that were not trained are not to be put down to the channels, so that corrections are
    fitted within the range. But channels that changed may bring all frames out of it: where those
    fitted to all frames bring most back, they are believed. Gains that no cord can have are not."""
    placed, drifted, _ = _corrected(model, data, frames, left)
    within = float((frames.distance <= 1).mean())
    if within > 1 - _BACK:
        return placed, drifted, frames
    every = replace(left, fitting=left.weights)
    moved, all_moved, channels = _corrected(model, data, frames, every)
    corrected = replace(frames, distance=channels.distance())
    back = float((corrected.distance <= 1).mean()) - within
    if back < _BACK or all_moved.square >= min(drifted.square, left.square):
        return placed, drifted, frames
    fitting = residual_of(corrected).fitting
    return moved, replace(all_moved, fitting=fitting), corrected


def _inputs(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, past: Past, before: float = 0.0
) -> Float:
    """Corrected signals and memories of them (t, c (1 + count)), some s before each frame."""
    parts = []
    for k, r in enumerate(data.recordings):
        own = frames.run == k
        if own.any():
            seen = past(r.sample_time, model.corrected(r.signals))
            at = np.maximum(frames.time[own] - before, r.sample_time[0])
            parts.append(at_times(at, r.sample_time, seen))
    return np.concatenate(parts)


def _memories(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> Float:
    """Memories (t, f) of the signals, as they were shortly before each frame."""
    seen = _inputs(model, data, frames, _MEMORIES, _BEFORE)[:, len(model.channels) :]
    shortest, *longer = np.split(seen, _MEMORIES.count, axis=1)
    moved = [h - shortest for h in longer[: len(_MEMORIES.moved) - 1]]
    out = np.concatenate(moved + longer[len(moved) :], axis=1)
    return np.where(np.isfinite(out), out, np.nanmean(out, axis=0))


def _best(residual: Residual, correction: Callable[[float], Float]) -> Residual:
    """After the correction of that ridge which helps most."""
    return min((residual.less(correction(ridge)) for ridge in RIDGES), key=lambda r: r.square)


def _richer(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, left: Residual,
    training: Dataset | None,
) -> Residual:  # fmt: skip
    """After what a far richer decoder makes of the same inputs, within the trained range."""
    inputs = _branch_inputs(model, data, frames)
    source, trained = left, inputs
    if training is not None:
        own = matched(model, training)
        learned = decode_frames(model, own, 1.0)
        source, trained = residual_of(learned), _branch_inputs(model, own, learned)
    basis = _basis(trained)
    within = (frames.distance <= 1)[:, None, None]

    def richer(ridge: float) -> Float:
        found = fitted_elsewhere(
            left, source, basis(inputs), basis(trained), ridge, same=training is None
        )
        return np.where(within, found, 0.0)

    return _best(left, richer)


def _beyond(frames: DecodedFrames, left: Residual) -> float:
    """What the frames beyond the trained range have more of than as many within it."""
    squares = (left.weights * (left.error**2).sum(axis=2)).sum(axis=1)
    within = frames.distance <= 1
    if within.all() or not within.any():
        return 0.0
    return max(float((squares[~within] - squares[within].mean()).sum()), 0.0)


def _branch_inputs(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> Float:
    """What the decoder sees (t, d) of the frames."""
    inputs = _inputs(model, data, frames, model.main.past)
    c, own = len(model.channels), list(model.main.channels)
    pick = [k * c + j for k in range(1 + model.main.past.count) for j in own]
    return np.asarray(inputs[:, pick])


def _basis(inputs: Float) -> Callable[[Float], Float]:
    """Features of inputs (t, d): themselves, products of pairs of few, and radial basis functions
    about inputs (n, d) evenly spread over time, wider than these are spread."""
    d = inputs.shape[1]
    middle, spread = inputs.mean(axis=0), inputs.std(axis=0)
    scale = np.where(spread > 0, spread, np.inf)
    some = np.linspace(0, len(inputs) - 1, min(_CENTERS, len(inputs))).astype(int)
    centers = (inputs[some] - middle) / scale
    pairs = np.stack(np.triu_indices(d if d <= _MOST_SQUARED else 0), axis=1)
    features = InputFeatures(d, pairs, centers, np.full(d, np.sqrt(d)))
    return lambda z: features((z - middle) / scale)
