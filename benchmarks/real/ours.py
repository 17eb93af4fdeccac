"""Errors and intervals of the trained model on the frames of a task."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.real.recordings import Task
from defsense_fab.core.arrays import Bool, Float
from defsense_fab.decoding.trained_model import Branch
from defsense_fab.training.fitting.decoder_selection import FittedCandidate
from defsense_fab.training.fitting.train_model import Training, train
from defsense_fab.training.regression.candidates import Candidate, parse_form
from defsense_fab.training.regression.frames import Frames
from defsense_fab.training.regression.weighted_ridge import (
    Whitening,
    accumulate_sums,
    cross_validate,
)

GROWN_RATIO = 1.0001  # of an interval to that at the center of the training


@dataclass(frozen=True)
class Coverage:
    """How many test values are within intervals, and how wide these are.

    Attributes:
        share: Share of the values within their intervals; without an interval, they are left out.
        by_tenth: The same in each tenth of the test in time; NaN where there are none.
        median_width: Median half width, over values.
    """

    share: float
    by_tenth: list[float]
    median_width: float

    @property
    def worst_tenth(self) -> float:
        """Smallest share in a tenth."""
        return float(np.nanmin(self.by_tenth))

    @staticmethod
    def measure(task: Task, error: Float, radius: Float) -> Coverage:
        """Measure intervals with half widths (t, m) for errors (t, m); NaN in gaps."""
        is_used = np.isfinite(error) & np.isfinite(radius)

        def share(rows: Float | slice) -> float:
            inside = (error <= radius)[rows][is_used[rows]]
            return float(inside.mean()) if len(inside) else float("nan")

        widths = radius[is_used]
        return Coverage(
            share(slice(None)),
            [share(rows) for rows in task.test_tenths],
            float(np.median(widths)) if len(widths) else float("nan"),
        )


@dataclass(frozen=True)
class OurResult:
    """Errors and intervals of the trained model.

    Attributes:
        kind: Name of the chosen decoder.
        cross_validated: Its error on the folds left out, measured like that of the peers.
        test: Error on the test frames; of several units, scaled.
        by_unit: Error on the test frames for each unit.
        candidates: Name, and errors on folds and test, of every candidate, as `train` reports them.
        coverage: Of the model's intervals.
        plain: Of the quantile of the errors on the folds left out, for each target.
        grown: Share of the frames whose intervals are wider than in the training's center.
        withheld: Share of the frames without an interval.
        without: Error on the test frames without each channel.
        cpu_s: CPU seconds of `train`.
    """

    kind: str
    cross_validated: float
    test: float
    by_unit: dict[str, float]
    candidates: list[tuple[str, float, float]]
    coverage: Coverage
    plain: Coverage
    grown: float
    withheld: float
    without: dict[str, float]
    cpu_s: float


@dataclass(frozen=True)
class Curves:
    """Decoded test frames, for pictures.

    Attributes:
        points: Decoded targets, shape (t, m, r).
        radius: Half widths of their intervals, shape (t, m).
    """

    points: Float
    radius: Float


def measure_ours(task: Task) -> tuple[OurResult, Curves]:
    """Train a model and measure it on the test frames."""
    start = time.process_time()
    training = train(task.dataset, task.options)
    cpu_s = time.process_time() - start
    model = training.model
    points, radius = decode(training, task.test)
    error = np.linalg.norm(points - task.test.points, axis=2)
    left_out = decode_folds(training, task)
    errors = np.linalg.norm(left_out - task.train.points, axis=2)
    errors[training.wrong_markers] = np.nan
    level = task.options.level
    plain = np.broadcast_to(np.nanquantile(errors, level, axis=0), radius.shape)
    least = np.full(radius.shape[1], np.inf)
    if model.main.intervals is not None:
        least = model.main.intervals(np.zeros(1))[0]
    is_withheld = ~np.isfinite(radius).any(axis=1)
    is_grown = (radius > GROWN_RATIO * least).any(axis=1) & ~is_withheld
    without = {n: task.rmse(decode(training, task.test, n)[0], task.test) for n in model.without}
    result = OurResult(
        training.selected,
        task.rmse(left_out, task.train),
        task.rmse(points, task.test),
        task.rmse_by_unit(points),
        [
            (c.name, c.cross_validated, float("nan") if c.test is None else c.test.rmse)
            for c in training.candidates
        ],
        Coverage.measure(task, error, radius),
        Coverage.measure(task, error, plain),
        float(is_grown.mean()),
        float(is_withheld.mean()),
        without,
        cpu_s,
    )
    return result, Curves(points, radius)


def decode(training: Training, frames: Frames, lost: str | None = None) -> tuple[Float, Float]:
    """Return decoded targets (t, m, r) and half widths (t, m) at frames.

    Args:
        training: The training.
        frames: The frames.
        lost: Name of a channel that is not used.
    """
    points, radius = np.empty(frames.points.shape), np.empty(frames.points.shape[:2])
    for k, r in enumerate(frames.dataset.recordings):
        index = np.flatnonzero(frames.recording_index == k)
        if len(index):
            at = frames.time[index]
            decoded = training.model.decode(r.sample_time, r.signals, at, lost)
            points[index], radius[index] = decoded.points, decoded.radius
    return points, radius


def decode_folds(training: Training, task: Task) -> Float:
    """Decode each fold by the chosen decoder, fitted to the other folds.

    Returns:
        Targets at the frames to train on, shape (t, m, r).
    """
    main: Branch = training.model.main
    chosen = next(c for c in training.candidates if c.name == training.selected)
    frames, rest = task.train, task.dataset.rest_points
    z = frames.inputs(main.past, main.channels)
    features = main.decoder.features
    whitening, x = Whitening.fit(features, z)
    outputs = (frames.points - rest) / task.scale[:, None]
    weights: Bool = frames.visible & ~training.wrong_markers
    sums = accumulate_sums(x, outputs, weights.astype(float), task.fold)
    path = cross_validate(sums, np.array([chosen.noise]))
    candidate = Candidate(parse_form(training.selected), main.past)
    fitted = FittedCandidate(candidate, features, path, whitening, sums)
    decoded = np.empty(outputs.shape)
    for k in range(task.options.folds):
        test = task.fold == k
        decoded[test] = fitted.displacements(z[test], k).reshape(-1, *outputs.shape[1:])
    return decoded * task.scale[:, None] + rest


def mean_error(task: Task) -> float:
    """Return the error on the test frames of the mean of the training."""
    mean = np.nanmean(task.train.points, axis=0)
    return task.rmse(np.broadcast_to(mean, task.test.points.shape), task.test)


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean; NaN without values."""
    return float(np.exp(np.mean(np.log(values)))) if len(values) else float("nan")
