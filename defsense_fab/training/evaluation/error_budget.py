"""Split the mean square error of a trained model by cause, in mm^2.

The shares add up to the mean square error. Two are variances:

- read-out noise: the effect of noise like that of the samples at rest on the decoded positions;
- camera noise: the stated variances of the marker positions, where they are known.

Five are what a correction would gain on frames that it was not fitted to, one after another
(`corrections.py`):

- clocks: one delay for each run, at most twice the standard error of the clock synchronization;
- placement and gain: an offset and a gain for each channel, the same in all runs;
- drift: in addition, an offset for each channel and run that changes linearly in time;
- decoder: products and radial basis functions of the decoder's inputs, within the trained range;
- hysteresis: memories of the signals (`decoding/signal_history.py`), fitted to what remains.

Of the remaining error,

- unseen poses: by how much the mean square beyond the trained range is larger than within, at most
  what the noise does not explain;

and the rest is unexplained. It can be negative if a noise was stated larger than it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Float
from ...decoding.input_decoder import InputFeatures
from ...decoding.signal_history import Past, interpolate_at
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset
from .corrections import (
    RIDGES,
    ChannelCorrection,
    Residual,
    decode_changed,
    fit_features,
    residual_of,
)
from .decoded_frames import DecodedFrames, decode_frames, match_to_model
from .marker_motion import sample_noise, velocities

READ_OUT, CAMERAS, CLOCKS = "read-out noise", "camera noise", "clocks"
PLACEMENT, DRIFT, HYSTERESIS = "placement and gain", "drift", "hysteresis"
DECODER, UNSEEN, UNEXPLAINED = "decoder", "unseen poses", "unexplained"

# Memories for hysteresis, with time constants in s; the shortest one stands for the signal itself.
_MEMORIES = Past((0.1, 0.3, 1.0, 3.0, 10.0), (3.0,))
# Memories are evaluated this much before a frame: with its samples, they would remove their noise.
_MEMORY_LEAD_S = 0.1
_NOISE_DRAWS = 4  # of the read-out noise
_CENTER_COUNT = 60
_MIN_RETURNED_SHARE = 0.2  # of the frames that a correction brings back into the trained range
_MAX_GAIN_CHANGE = 0.5  # no cord that aged or was replaced changes by more
_MAX_SQUARED_INPUTS = 12  # which have 90 squares and products


@dataclass(frozen=True)
class ErrorBudget:
    """A mean square error and its shares by cause.

    Attributes:
        total: Mean square error, mm^2.
        shares: Mean square error by cause, mm^2; they add up to the total.
    """

    total: float
    shares: dict[str, float]

    @staticmethod
    def complete(total: float, shares: dict[str, float]) -> ErrorBudget:
        """Add the unexplained share, so that the shares add up to the total."""
        return ErrorBudget(total, {**shares, UNEXPLAINED: total - sum(shares.values())})


def error_budget(model: TrainedModel, dataset: Dataset, last_share: float = 1.0) -> ErrorBudget:
    """Split the error of a model on the last frames of a dataset.

    Args:
        model: The model.
        dataset: The dataset to test on.
        last_share: Share of the frames to test on, at the end of all runs.

    Returns:
        The shares by cause.

    Raises:
        TrainingError: As `decode_frames`.
    """
    data = match_to_model(model, dataset)
    frames = decode_frames(model, data, last_share)
    variance = np.nan_to_num((frames.sigma**2).sum(axis=2))
    shares = {READ_OUT: _read_out_noise(model, data, frames), CAMERAS: frames.mean(variance)}
    recorded = residual_of(frames)
    total = recorded.square
    synchronized = recorded.reduced_by(_correct_delays(data, frames, recorded))
    shares[CLOCKS] = recorded.square - synchronized.square
    placed, drifted, frames = _correct_channels(model, data, frames, synchronized)
    shares[PLACEMENT] = synchronized.square - placed.square
    shares[DRIFT] = placed.square - drifted.square
    enriched = correct_decoder(model, data, frames, drifted)
    shares[DECODER] = drifted.square - enriched.square
    memories = _memory_features(model, data, frames)
    remaining = _reduce_best(enriched, partial(fit_features, enriched, memories))
    shares[HYSTERESIS] = enriched.square - remaining.square
    # Noise moves frames beyond the range too; it must not count twice.
    noise = shares[READ_OUT] + shares[CAMERAS]
    shares[UNSEEN] = min(unseen_share(frames, remaining), max(remaining.square - noise, 0.0))
    return ErrorBudget.complete(total, shares)


def _read_out_noise(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> float:
    """Return the mean square effect of noise as large as that of the samples at rest."""
    rng = np.random.default_rng(0)
    sigmas = [sample_noise(r) for r in data.recordings]

    def add_noise(k: int, _: Float, signals: Float) -> Float:
        return np.asarray(signals + sigmas[k] * rng.normal(size=signals.shape))

    changes = [
        decode_changed(model, data, frames, add_noise).points - frames.predicted
        for _ in range(_NOISE_DRAWS)
    ]
    return float(np.mean([frames.mean((d**2).sum(axis=2)) for d in changes]))


def _correct_delays(data: Dataset, frames: DecodedFrames, residual: Residual) -> Float:
    """Return the correction (t, m, 3) mm by one delay of the predicted positions for each run."""
    velocity = np.nan_to_num(velocities(frames.time, frames.predicted, frames.run))
    correction = np.zeros_like(residual.error)
    for k, r in enumerate(data.recordings):
        is_in_run = frames.run == k
        if r.sync_error is None or not is_in_run.any():
            continue
        fitting, folds, error = (
            x[is_in_run] for x in (residual.fitting, residual.fold, residual.error)
        )
        for fold in range(int(folds.max()) + 1):
            w = fitting[folds != fold][..., None]
            v, e = velocity[is_in_run][folds != fold], error[folds != fold]
            scale = float((w * v**2).sum())
            delay = float((w * v * e).sum()) / scale if scale > 0 else 0.0
            delay = float(np.clip(delay, -2 * r.sync_error, 2 * r.sync_error))
            test = np.flatnonzero(is_in_run)[folds == fold]
            correction[test] = delay * velocity[test]
    return correction


def _fit_channels(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, residual: Residual
) -> tuple[Residual, Residual, ChannelCorrection]:
    """Return the residuals after placement and gain and after drift, and the correction."""
    channels = ChannelCorrection(model, data, frames)
    placed = residual.reduced_by(channels.correct_gains(residual))
    drifted = placed.reduced_by(channels.correct_drift(placed))
    if np.abs(channels.gains).max() > _MAX_GAIN_CHANGE:
        return residual, residual, channels
    return placed, drifted, channels


def _correct_channels(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, residual: Residual
) -> tuple[Residual, Residual, DecodedFrames]:
    """Return the residuals after placement and gain and after drift, and the frames.

    The frames have the distances of the corrected signals from the trained range.

    Errors in untrained poses must not be attributed to the channels, so corrections are fitted
    within the trained range. But channels that changed may bring all frames out of it. So a
    correction fitted to all frames is used if it brings most frames back. Gains that no cord can
    have are rejected.
    """
    placed, drifted, _ = _fit_channels(model, data, frames, residual)
    inside_share = float(frames.is_inside.mean())
    if inside_share > 1 - _MIN_RETURNED_SHARE:
        return placed, drifted, frames
    all_frames = replace(residual, fitting=residual.weights)
    all_placed, all_drifted, channels = _fit_channels(model, data, frames, all_frames)
    corrected = replace(frames, distance=channels.distance())
    returned = float(corrected.is_inside.mean()) - inside_share
    if returned < _MIN_RETURNED_SHARE or all_drifted.square >= min(drifted.square, residual.square):
        return placed, drifted, frames
    fitting = residual_of(corrected).fitting
    return all_placed, replace(all_drifted, fitting=fitting), corrected


def _history_inputs(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, past: Past, lead_s: float = 0.0
) -> Float:
    """Return signals and their memories (t, c (1 + count)), some seconds before each frame."""
    parts = []
    for k, r in enumerate(data.recordings):
        is_in_run = frames.run == k
        if is_in_run.any():
            history = past(r.sample_time, model.correct(r.signals))
            times = np.maximum(frames.time[is_in_run] - lead_s, r.sample_time[0])
            parts.append(interpolate_at(times, r.sample_time, history))
    return np.concatenate(parts)


def _memory_features(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> Float:
    """Return memories (t, f) of the signals, shortly before each frame."""
    history = _history_inputs(model, data, frames, _MEMORIES, _MEMORY_LEAD_S)
    shortest, *longer = np.split(history[:, len(model.channels) :], _MEMORIES.count, axis=1)
    moved = [h - shortest for h in longer[: len(_MEMORIES.moved) - 1]]
    features = np.concatenate(moved + longer[len(moved) :], axis=1)
    return np.where(np.isfinite(features), features, np.nanmean(features, axis=0))


def _reduce_best(residual: Residual, correct: Callable[[float], Float]) -> Residual:
    """Return the residual after the correction with the best ridge."""
    return min((residual.reduced_by(correct(ridge)) for ridge in RIDGES), key=lambda r: r.square)


def correct_decoder(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, residual: Residual
) -> Residual:
    """Correct errors by a much richer decoder of the same inputs, within the trained range.

    Args:
        model: The model.
        data: The dataset, matched to the model.
        frames: Its decoded frames.
        residual: The errors to explain.

    Returns:
        The remaining errors.
    """
    features = _rich_features(_branch_inputs(model, data, frames))
    is_inside = frames.is_inside[:, None, None]

    def correct(ridge: float) -> Float:
        return np.where(is_inside, fit_features(residual, features, ridge), 0.0)

    return _reduce_best(residual, correct)


def unseen_share(frames: DecodedFrames, residual: Residual) -> float:
    """Return by how much frames beyond the trained range have a larger square than those within."""
    squares = (residual.weights * (residual.error**2).sum(axis=2)).sum(axis=1)
    is_inside = frames.is_inside
    if is_inside.all() or not is_inside.any():
        return 0.0
    return max(float((squares[~is_inside] - squares[is_inside].mean()).sum()), 0.0)


def _branch_inputs(model: TrainedModel, data: Dataset, frames: DecodedFrames) -> Float:
    """Return the decoder's inputs (t, d) at the frames."""
    inputs = _history_inputs(model, data, frames, model.main.past)
    c, channels = len(model.channels), list(model.main.channels)
    columns = [k * c + j for k in range(1 + model.main.past.count) for j in channels]
    return np.asarray(inputs[:, columns])


def _rich_features(inputs: Float) -> Float:
    """Return rich features (t, f) of inputs (t, d).

    They are the inputs, products of pairs if there are few inputs, and radial basis functions
    around inputs evenly spaced over time, wider than the spread of the inputs.
    """
    d = inputs.shape[1]
    center, spread = inputs.mean(axis=0), inputs.std(axis=0)
    scaled = (inputs - center) / np.where(spread > 0, spread, np.inf)
    subset = np.linspace(0, len(inputs) - 1, min(_CENTER_COUNT, len(inputs))).astype(int)
    pairs = np.stack(np.triu_indices(d if d <= _MAX_SQUARED_INPUTS else 0), axis=1)
    return InputFeatures(d, pairs, scaled[subset], np.full(d, np.sqrt(d)))(scaled)
