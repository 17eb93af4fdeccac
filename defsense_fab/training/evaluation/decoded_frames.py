"""Decode the frames that a trained model is tested on, for comparison with measured positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.quantities import Readings
from ...decoding.signal_history import interpolate_at
from ...decoding.trained_model import UNTRAINED_DISTANCE, Decoded, TrainedModel, decode_inputs
from ..data.dataset import Dataset, Recording
from ..data.dataset_assembly import select_channel_indices, select_targets, use_readings

ALL_FRAMES, BEFORE_FIRST_POSE = "all", "before the first pose"

_BATCH_FRAMES = 1000  # features of more frames at once would take much memory
# Rest positions from pairs of files are estimated from their tracks, and so inexact.
_MAX_REST_MISMATCH_MM = 5.0


@dataclass(frozen=True)
class OmittedFrames:
    """Numbers of frames that cannot be tested.

    Attributes:
        without_samples: Frames without samples of all channels.
        without_markers: Frames without a visible marker.
    """

    without_samples: int
    without_markers: int


@dataclass(frozen=True)
class DecodedFrames:
    """The t frames of all runs that have visible markers and samples, one run after another.

    Attributes:
        runs: Names of the runs.
        poses: Names of the requested poses.
        run: Index of each frame's run, shape (t,).
        pose: Index of each frame's pose, shape (t,).
        time: Times on each run's clock, shape (t,), s.
        elapsed: Tested time, without the time between runs, shape (t,), s.
        predicted: Decoded marker positions, shape (t, m, 3), mm, rest frame.
        measured: Measured marker positions, shape (t, m, 3), mm; NaN where not visible.
        sigma: Standard deviations of the measured positions, shape (t, m, 3), mm.
        radius: Radius of the intervals, shape (t, m), mm.
        distance: Distance of the signals from the trained range, shape (t,).
        omitted: Frames that were left out.
    """

    runs: tuple[str, ...]
    poses: tuple[str, ...]
    run: Int
    pose: Int
    time: Float
    elapsed: Float
    predicted: Float
    measured: Float
    sigma: Float
    radius: Float
    distance: Float
    omitted: OmittedFrames

    @cached_property
    def is_inside(self) -> Bool:
        """Whether each frame is within the trained range, shape (t,), as in a live run."""
        return np.asarray(self.distance <= UNTRAINED_DISTANCE)

    @cached_property
    def error(self) -> Float:
        """Predicted minus measured positions, shape (t, m, 3), mm; NaN in gaps."""
        return np.asarray(self.predicted - self.measured)

    @cached_property
    def visible(self) -> Bool:
        """Whether each marker is visible in each frame, shape (t, m)."""
        return np.asarray(np.isfinite(self.measured).all(axis=2))

    @cached_property
    def marker_error(self) -> Float:
        """Distance of each marker from its predicted position, shape (t, m), mm; NaN in gaps."""
        return np.asarray(np.linalg.norm(self.error, axis=2))

    @cached_property
    def frame_error(self) -> Float:
        """Root mean square error over the visible markers of each frame, shape (t,), mm."""
        return np.asarray(np.sqrt(np.nanmean(self.marker_error**2, axis=1)))

    @cached_property
    def weights(self) -> Float:
        """Weights of the markers, shape (t, m), with sum 1 and 0 in gaps.

        All frames count alike, and so do the visible markers of a frame.
        """
        visible = self.visible
        return np.asarray(visible / visible.sum(axis=1, keepdims=True) / len(visible))

    def mean(self, squares: Float) -> float:
        """Return the weighted mean of squares (t, m); NaN counts as 0."""
        return float((self.weights * np.where(self.visible, np.nan_to_num(squares), 0.0)).sum())

    def select(self, which: Bool) -> DecodedFrames:
        """Return the frames of a mask (t,)."""
        return replace(
            self,
            run=self.run[which],
            pose=self.pose[which],
            time=self.time[which],
            elapsed=self.elapsed[which],
            predicted=self.predicted[which],
            measured=self.measured[which],
            sigma=self.sigma[which],
            radius=self.radius[which],
            distance=self.distance[which],
        )


def decode_frames(model: TrainedModel, dataset: Dataset, last_share: float) -> DecodedFrames:
    """Decode the last frames of a dataset.

    Args:
        model: The model.
        dataset: The dataset, of the model's device and layout.
        last_share: Share of the usable frames to decode, at the end of all runs, above 0 to 1;
            frames are divided as for training (`regression/frames.py`).

    Returns:
        The decoded frames.

    Raises:
        TrainingError: If the model does not match the dataset, or no frame can be tested.
    """
    if not 0 < last_share <= 1:
        raise TrainingError(
            f"must be above 0 and at most 1, not {last_share:g}",
            code="out-of-range",
            where="last_share",
            share=last_share,
        )
    data = match_to_model(model, dataset)
    runs = data.recordings
    outputs = [decode_signals(model, r.sample_time, r.signals, r.time) for r in runs]
    run = np.repeat(np.arange(len(runs)), [len(r.time) for r in runs])
    time = np.concatenate([r.time for r in runs])
    measured = np.concatenate([_drop_partial(r.points) for r in runs])
    predicted = np.concatenate([d.points for d in outputs])
    has_markers = np.asarray(np.isfinite(measured).any(axis=(1, 2)))
    has_samples = np.asarray(np.isfinite(predicted).all(axis=(1, 2)))
    index = np.flatnonzero(has_markers & has_samples)
    index = index[len(index) - round(last_share * len(index)) :]
    if not len(index):
        raise TrainingError(
            f"none of {len(time)} frames has both markers and samples of all channels",
            code="no-frames",
            where=data.device,
            action="Record the session again, or test on another",
            count=len(time),
        )
    names = [_pose_at(runs[k], t) for k, t in zip(run[index], time[index], strict=True)]
    poses = tuple(dict.fromkeys(names))
    first = 0 if last_share == 1 else int(index[0])
    return DecodedFrames(
        runs=tuple(r.name for r in runs),
        poses=poses,
        run=run[index],
        pose=np.array([poses.index(name) for name in names], int),
        time=time[index],
        elapsed=_elapsed([time[index][run[index] == k] for k in range(len(runs))]),
        predicted=predicted[index],
        measured=measured[index],
        sigma=np.concatenate([r.sigma for r in runs])[index],
        radius=np.concatenate([d.radius for d in outputs])[index],
        distance=np.concatenate([d.distance for d in outputs])[index],
        omitted=OmittedFrames(
            without_samples=int((has_markers & ~has_samples)[first:].sum()),
            without_markers=int((~has_markers)[first:].sum()),
        ),
    )


def select_common(decoded: Sequence[DecodedFrames]) -> list[DecodedFrames]:
    """Select the frames that several decodings of one dataset have in common.

    Args:
        decoded: The decoded frames, at least one.

    Returns:
        Each decoding with only the frames, by run and time, that are in all of them.
    """
    keys = [list(zip(f.run.tolist(), f.time.tolist(), strict=True)) for f in decoded]
    common = set(keys[0]).intersection(*keys[1:])
    return [
        f.select(np.array([key in common for key in frame_keys], bool))
        for f, frame_keys in zip(decoded, keys, strict=True)
    ]


def match_to_model(model: TrainedModel, dataset: Dataset) -> Dataset:
    """Select the model's channels and markers, in the model's order.

    Args:
        model: The model.
        dataset: The dataset.

    Returns:
        The dataset with the model's channels and markers only.

    Raises:
        TrainingError: If the dataset is of another device or layout, lacks a channel or marker, or
            has a marker at another rest position.
    """
    _require_same_device(model, dataset)
    _require_same_targets(model, dataset)
    known = dataset.ids.tolist() if dataset.targets is None else list(dataset.targets.names)
    names = model.ids.tolist() if model.targets is None else list(model.targets.names)
    missing = [c for c in model.channels if c not in dataset.channels]
    kind = "marker " if model.targets is None else ""
    missing += [f"{kind}{name}" for name in names if name not in known]
    if missing:
        raise TrainingError(
            f"the recordings have no {', '.join(missing)}, which the model was trained on",
            code="channels-or-markers-missing",
            where=dataset.device,
            action="Record them, or train on what the recordings have",
            missing=tuple(missing),
        )
    m = np.array([known.index(name) for name in names], int)
    if dataset.targets is not None:
        _require_same_units(model, dataset, m)
        selected = select_targets(match_channels(model, dataset), m)
        return replace(selected, ids=model.ids, rest_points=model.rest_points)
    distance = np.linalg.norm(dataset.rest_points[m] - model.rest_points, axis=1)
    if distance.max() > _MAX_REST_MISMATCH_MM:
        k = int(distance.argmax())
        raise TrainingError(
            f"the rest position of marker {model.ids[k]} is {distance[k]:.1f} mm from the model's",
            code="markers-moved",
            where=dataset.device,
            action="Check the frame of the tracks, and whether markers were glued elsewhere",
            marker=int(model.ids[k]),
            distance_mm=float(distance[k]),
        )
    return select_targets(match_channels(model, dataset), m)


def match_channels(model: TrainedModel, dataset: Dataset) -> Dataset:
    """Select the model's channels, in its order, with the reference of its readings.

    Args:
        model: The model.
        dataset: The dataset, which has these channels.

    Returns:
        The dataset with the model's channels only.

    Raises:
        TrainingError: If the model was trained on channels in other units.
    """
    index = [dataset.channels.index(name) for name in model.channels]
    selected = select_channel_indices(dataset, index)
    mine, others = model.readings, selected.readings
    trained = ("ohm",) * len(index) if mine is None else mine.units
    present = ("ohm",) * len(index) if others is None else others.units
    if trained != present or (mine is None) != (others is None):
        k = next((k for k, u in enumerate(trained) if u != present[k]), 0)
        raise TrainingError(
            f"{model.channels[k]} is in {_reading_unit(others, k)}, but the model was trained on"
            f" {_reading_unit(mine, k)}",
            code="units-differ",
            where=dataset.recordings[0].name,
            action="Give the signals in the units of the training",
            channel=model.channels[k],
            units=(present[k], trained[k]),
        )
    return use_readings(selected, mine)


def _reading_unit(readings: Readings | None, k: int) -> str:
    return "ohm, with a rest" if readings is None else readings.units[k]


def _require_same_targets(model: TrainedModel, dataset: Dataset) -> None:
    """Raise an error if one has markers and the other has other targets."""
    if (model.targets is None) == (dataset.targets is None):
        return
    action = "Give them as targets" if model.targets is not None else "Give them as tracks"
    raise TrainingError(
        f"the model decodes {', '.join(model.target_names)}, not markers"
        if dataset.targets is None
        else "the model decodes markers, not other targets",
        code="targets-differ",
        where=dataset.recordings[0].name,
        action=action,
    )


def _require_same_units(model: TrainedModel, dataset: Dataset, index: Int) -> None:
    """Raise an error if a target of the model, by its index in the dataset, has another unit."""
    for name, trained, k in zip(model.target_names, model.units, index.tolist(), strict=True):
        if dataset.units[k] != trained:
            raise TrainingError(
                f"{name} is in {dataset.units[k] or 'no stated unit'}, but the model was trained on"
                f" {trained or 'no stated unit'}",
                code="units-differ",
                where=dataset.recordings[0].name,
                action="Give the targets in the units of the training",
                target=name,
                units=(dataset.units[k], trained),
            )


def _require_same_device(model: TrainedModel, dataset: Dataset) -> None:
    if model.layout and dataset.layout and model.layout != dataset.layout:
        raise TrainingError(
            f"was recorded with the layout {dataset.layout}, but the model was trained on"
            f" {model.layout}",
            code="layouts-differ",
            where=dataset.device,
            action="Test the model on a device with the same layout of cords",
            layouts=(model.layout, dataset.layout),
        )
    if model.device != dataset.device:
        raise TrainingError(
            f"the recordings are of {dataset.device}, but the model is of {model.device}",
            code="devices-differ",
            action="Test the model on its own device",
            devices=(model.device, dataset.device),
        )


def decode_signals(model: TrainedModel, time: Float, signals: Float, at: Float) -> Decoded:
    """Decode signals as `model.decode` does, with the memory of few frames at once.

    Args:
        model: The model.
        time: Times of the samples, shape (n,), s.
        signals: Signals (R - R0)/R0, shape (n, c).
        at: Times to decode at, shape (t,), s.

    Returns:
        Positions, intervals and distances at these times.
    """
    z = interpolate_at(at, time, model.main.inputs(time, model.correct(signals)))
    return _decode_batches(model, z)


def _decode_batches(model: TrainedModel, inputs: Float) -> Decoded:
    """Decode inputs (t, d) of the model's main branch, in batches.

    The distances are those of the signals alone. Slow memories of a later part of a recording are
    always beyond those of its first part.
    """
    main = model.main
    parts = [
        decode_inputs(main, inputs[k : k + _BATCH_FRAMES], len(model.ids))
        for k in range(0, max(len(inputs), 1), _BATCH_FRAMES)
    ]
    return Decoded(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.radius for p in parts]),
        main.signal_range.distance(inputs[:, : len(main.channels)]),
    )


def _pose_at(recording: Recording, time: float) -> str:
    if not recording.poses:
        return ALL_FRAMES
    return next(
        (name for start, name in reversed(recording.poses) if start <= time), BEFORE_FIRST_POSE
    )


def _drop_partial(points: Float) -> Float:
    """Set markers to NaN of which any coordinate is missing."""
    return np.where(np.isfinite(points).all(axis=2, keepdims=True), points, np.nan)


def _elapsed(times: list[Float]) -> Float:
    """Return seconds since the first frame, without the time between runs."""
    parts, start = [], 0.0
    for time in filter(len, times):
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        parts.append(start + time - time[0])
        start = float(parts[-1][-1]) + step
    return np.concatenate(parts)
