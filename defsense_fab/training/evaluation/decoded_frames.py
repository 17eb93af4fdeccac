"""What a trained model says of the pictures that it is tested on, beside what the cameras saw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.signal_history import at_times
from ...decoding.trained_model import Decoded, TrainedModel, decoded
from ..data.dataset import Dataset, Recording

ALL, BEFORE = "all", "before the first pose"
_AT_ONCE = 1000  # frames: features of more would take much memory


_MOVED = 5.0  # mm, by which a marker at rest may be elsewhere: pairs of files know it by its tracks


@dataclass(frozen=True)
class DecodedFrames:
    """The t pictures of all `runs` (names) in which markers were seen and there were samples, one
    run after another. `run` (t,) and `pose` (t,) are indices into `runs` and `poses`; `time` (t,) s
    on each run's clock, `elapsed` (t,) s of the tested time, runs laid end to end. `predicted` and
    `measured` (t, m, 3) mm, NaN where a marker was not seen; `sigma` (t, m, 3) mm; `radius` (t, m)
    mm of the intervals and the `distance` (t,) from the trained range. Of the pictures,
    `without_samples` and `without_markers` were left out."""

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
    without_samples: int
    without_markers: int

    @cached_property
    def error(self) -> Float:
        """Predicted less measured (t, m, 3) mm; NaN in gaps."""
        return np.asarray(self.predicted - self.measured)

    @cached_property
    def visible(self) -> Bool:
        """(t, m)."""
        return np.asarray(np.isfinite(self.measured).all(axis=2))

    @cached_property
    def miss(self) -> Float:
        """Distance (t, m) mm of each marker from where it was said to be; NaN in gaps."""
        return np.asarray(np.linalg.norm(self.error, axis=2))

    @cached_property
    def weights(self) -> Float:
        """(t, m), 0 in gaps, their sum 1: frames count alike, and the markers seen in a frame."""
        return np.asarray(
            self.visible / self.visible.sum(axis=1, keepdims=True) / len(self.visible)
        )

    def mean(self, squares: Float) -> float:
        """Mean of squares (t, m) over frames and their markers; those that are NaN count as 0."""
        return float((self.weights * np.where(self.visible, np.nan_to_num(squares), 0.0)).sum())

    @cached_property
    def per_frame(self) -> Float:
        """Root mean square (t,) mm over the markers seen in each frame."""
        return np.asarray(np.sqrt(np.nanmean(self.miss**2, axis=1)))


def decode_frames(model: TrainedModel, dataset: Dataset, last_share: float) -> DecodedFrames:
    """What `model` says of the last share of all pictures that can be tested, one run after another
    as they are divided for training (`splits.py`). Raises TrainingError where the model is not of
    this device's layout, or nothing can be tested."""
    if not 0 < last_share <= 1:
        raise TrainingError(
            f"the last {last_share:g} of the frames: give a share above 0, up to 1",
            code="share-out-of-range",
            share=last_share,
        )
    data = matched(model, dataset)
    runs = data.recordings
    told = [decode_signals(model, r.sample_time, r.signals, r.time) for r in runs]
    points = [_whole(r.points) for r in runs]
    run = np.repeat(np.arange(len(runs)), [len(r.time) for r in runs])
    time = np.concatenate([r.time for r in runs])
    measured = np.concatenate(points)
    predicted = np.concatenate([d.points for d in told])
    seen = np.asarray(np.isfinite(measured).any(axis=(1, 2)))
    known = np.asarray(np.isfinite(predicted).all(axis=(1, 2)))
    own = np.flatnonzero(seen & known)
    own = own[len(own) - round(last_share * len(own)) :]
    if not len(own):
        raise TrainingError(
            f"{data.device}: none of {len(time)} pictures has both markers and samples of all"
            " channels; record the session again, or test on another",
            code="no-frames",
            count=len(time),
        )
    names = [_pose(runs[k], t) for k, t in zip(run[own], time[own], strict=True)]
    poses = tuple(dict.fromkeys(names))
    first = 0 if last_share == 1 else int(own[0])
    return DecodedFrames(
        runs=tuple(r.name for r in runs),
        poses=poses,
        run=run[own],
        pose=np.array([poses.index(name) for name in names], int),
        time=time[own],
        elapsed=_laid_end_to_end([time[own][run[own] == k] for k in range(len(runs))]),
        predicted=predicted[own],
        measured=measured[own],
        sigma=np.concatenate([r.sigma for r in runs])[own],
        radius=np.concatenate([d.radius for d in told])[own],
        distance=np.concatenate([d.distance for d in told])[own],
        without_samples=int((seen & ~known)[first:].sum()),
        without_markers=int((~seen)[first:].sum()),
    )


def matched(model: TrainedModel, dataset: Dataset) -> Dataset:
    """The dataset with the model's channels and markers, in the model's order. Raises
    TrainingError where it lacks some, or is of another layout."""
    if model.layout and dataset.layout and model.layout != dataset.layout:
        raise TrainingError(
            f"{dataset.device}: recorded with the layout {dataset.layout}, and the model was"
            f" trained on {model.layout}; test it on a device with its own cords",
            code="layouts-differ",
            layouts=(model.layout, dataset.layout),
        )
    if model.device != dataset.device:
        raise TrainingError(
            f"the recordings are of {dataset.device}, and the model is of {model.device}; test it"
            " on its own device",
            code="devices-differ",
            devices=(model.device, dataset.device),
        )
    lacking = [c for c in model.channels if c not in dataset.channels]
    lacking += [f"marker {i}" for i in model.ids if i not in dataset.ids]
    if lacking:
        raise TrainingError(
            f"{dataset.device}: the recordings have no {', '.join(lacking)}, which the model was"
            " trained on; record them, or train on what there is",
            code="channels-or-markers-missing",
            missing=tuple(lacking),
        )
    c = [dataset.channels.index(name) for name in model.channels]
    m = np.array([int(np.flatnonzero(dataset.ids == i)[0]) for i in model.ids], int)
    off = np.linalg.norm(dataset.rest_points[m] - model.rest_points, axis=1)
    if off.max() > _MOVED:
        k = int(off.argmax())
        raise TrainingError(
            f"{dataset.device}: marker {model.ids[k]} is {off[k]:.1f} mm from where the model has"
            " it at rest; the tracks are in another frame, or the markers are glued elsewhere",
            code="markers-moved",
            marker=int(model.ids[k]),
            distance_mm=float(off[k]),
        )
    recordings = tuple(
        replace(r, ohm=r.ohm[:, c], rest=r.rest[c], points=r.points[:, m], sigma=r.sigma[:, m])
        for r in dataset.recordings
    )
    return replace(
        dataset, channels=model.channels, ids=dataset.ids[m], rest_points=dataset.rest_points[m],
        recordings=recordings,
    )  # fmt: skip


def decode_signals(model: TrainedModel, time: Float, signals: Float, at: Float) -> Decoded:
    """What `model.decode` gives, with the memory that some frames need at a time."""
    z = at_times(at, time, model.main.inputs(time, model.corrected(signals)))
    return decode_inputs(model, z)


def decode_inputs(model: TrainedModel, inputs: Float) -> Decoded:
    """Of inputs (t, d) of the main branch."""
    parts = [
        decoded(model.main, inputs[k : k + _AT_ONCE], len(model.ids))
        for k in range(0, max(len(inputs), 1), _AT_ONCE)
    ]
    return Decoded(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.radius for p in parts]),
        np.concatenate([p.distance for p in parts]),
    )


def _pose(recording: Recording, time: float) -> str:
    if not recording.poses:
        return ALL
    return next((name for since, name in reversed(recording.poses) if since <= time), BEFORE)


def _whole(points: Float) -> Float:
    """A marker of which any coordinate is missing was not seen."""
    return np.where(np.isfinite(points).all(axis=2, keepdims=True), points, np.nan)


def _laid_end_to_end(times: list[Float]) -> Float:
    """Seconds since the first, without the time between runs."""
    out, since = [], 0.0
    for time in filter(len, times):
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        out.append(since + time - time[0])
        since = float(out[-1][-1]) + step
    return np.concatenate(out)
