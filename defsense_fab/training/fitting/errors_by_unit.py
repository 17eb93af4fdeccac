"""Errors, coverage and scales of targets on frames, for each of their units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...decoding.signal_history import interpolate_at
from ...decoding.trained_model import TrainedModel, decode_inputs
from ..data.dataset_assembly import select_targets
from ..regression.frames import Frames

_BATCH_FRAMES = 1000  # features of more frames at once would take much memory
_TENTHS = 10


@dataclass(frozen=True)
class UnitErrors:
    """Errors of a model on test frames, of the targets in one unit.

    Attributes:
        unit: The unit; empty if it is unknown.
        rmse: Root mean square error over all values.
        coverage: Share of the values within their intervals; None if the model has none.
        worst_tenth: Smallest such share in a tenth of the test in time; None if there are none.
        level: The share that is intended; None if the model has no intervals.
        count: Number of the values.
        by_target: Root mean square error of each target, by its name.
    """

    unit: str
    rmse: float
    coverage: float | None
    worst_tenth: float | None
    level: float | None
    count: int
    by_target: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """Return the numbers in plain values."""
        return {
            "unit": self.unit,
            "rmse": self.rmse,
            "coverage": self.coverage,
            "worst_tenth": self.worst_tenth,
            "level": self.level,
            "values": self.count,
            "by_target": self.by_target,
        }


def errors_to_json(errors: Sequence[UnitErrors]) -> dict[str, Any] | None:
    """Return the errors of the first unit, with those of all units if there are several.

    Args:
        errors: The errors for each unit.

    Returns:
        Plain values with `rmse` and `coverage`; None without errors.
    """
    if not errors:
        return None
    first = errors[0].to_json()
    return (
        first if len(errors) == 1 else {**first, "by_unit": {e.unit: e.to_json() for e in errors}}
    )


def measure_test(model: TrainedModel, frames: Frames) -> tuple[UnitErrors, ...]:
    """Measure the errors on frames, whose channels and targets are in the model's order.

    Args:
        model: The model.
        frames: The frames.

    Returns:
        The errors for each unit that has values.
    """
    if not len(frames):
        return ()
    predicted, radius = _decode(model, frames)
    return unit_errors(model, frames.points, predicted, radius)


def unit_errors(
    model: TrainedModel, measured: Float, predicted: Float, radius: Float
) -> tuple[UnitErrors, ...]:
    """Compute the errors for each unit.

    Args:
        model: The model.
        measured: True targets in time, shape (t, m, r); NaN in gaps.
        predicted: Decoded targets, shape (t, m, r).
        radius: Half widths of the intervals, shape (t, m).

    Returns:
        The errors for each unit that has values.
    """
    error = np.linalg.norm(predicted - measured, axis=2)
    is_known = np.isfinite(error)
    level = None if model.main.intervals is None else model.main.intervals.level
    units, results = np.array(model.units), []
    for unit in dict.fromkeys(model.units):
        of_unit = np.flatnonzero(units == unit)
        known = is_known[:, of_unit]
        if not known.any():
            continue
        values = error[:, of_unit]
        by_target = {
            model.target_names[k]: float(np.sqrt((error[is_known[:, k], k] ** 2).mean()))
            for k in of_unit.tolist()
            if is_known[:, k].any()
        }
        coverage = worst = None
        if level is not None:
            is_inside = values <= radius[:, of_unit]
            coverage = float(is_inside[known].mean())
            tenths = np.array_split(np.arange(len(values)), _TENTHS)
            worst = min(float(is_inside[t][known[t]].mean()) for t in tenths if known[t].any())
        rmse = float(np.sqrt((values[known] ** 2).mean()))
        results.append(UnitErrors(unit, rmse, coverage, worst, level, int(known.sum()), by_target))
    return tuple(results)


def select_unit(model: TrainedModel, frames: Frames, unit: str) -> tuple[TrainedModel, Frames]:
    """Return a model and frames with the targets of one unit only; the same if all have it.

    Args:
        model: The model.
        frames: The frames, with the model's targets in its order.
        unit: The unit.
    """
    which = np.array([u == unit for u in model.units])
    if which.all():
        return model, frames
    chosen = replace(
        frames,
        dataset=select_targets(frames.dataset, which),
        points=frames.points[:, which],
        sigma=frames.sigma[:, which],
    )
    is_used = np.isfinite(chosen.points[..., 0]).any(axis=1)
    return model.select_targets(which), chosen.select(np.asarray(is_used))


def target_scale(frames: Frames) -> Float:
    """Return what outputs are divided by, shape (m,), so that several units count alike.

    It is 1 for a single unit, otherwise the root mean square deviation of the unit's targets.

    Args:
        frames: The frames of the training.
    """
    units = np.array(frames.dataset.units)
    scale = np.ones(len(units))
    if len(set(units.tolist())) > 1:
        for unit in set(units.tolist()):
            spread = spread_of(frames.points[:, units == unit])
            scale[units == unit] = np.sqrt((spread**2).mean()) or 1.0
    return scale


def spread_of(points: Float) -> Float:
    """Return the root mean square distance of each target from its mean, shape (m,).

    Args:
        points: Targets, shape (t, m, r); NaN in gaps.
    """
    spread = np.zeros(points.shape[1])
    for k in range(len(spread)):
        known: Float = points[np.isfinite(points[:, k, 0]), k]
        spread[k] = np.sqrt(known.var(axis=0).sum()) if len(known) else 0.0
    return spread


def _decode(model: TrainedModel, frames: Frames) -> tuple[Float, Float]:
    """Return decoded targets (t, m, r) and the half widths of their intervals (t, m)."""
    points, radius = np.empty(frames.points.shape), np.empty(frames.points.shape[:2])
    for k, r in enumerate(frames.dataset.recordings):
        index = np.flatnonzero(frames.recording_index == k)
        if not len(index):
            continue
        z = model.main.inputs(r.sample_time, model.correct(r.signals))
        for part in np.array_split(index, len(index) // _BATCH_FRAMES + 1):
            at = r.time[frames.frame_index[part]]
            decoded = decode_inputs(
                model.main, interpolate_at(at, r.sample_time, z), len(model.ids)
            )
            points[part], radius[part] = decoded.points, decoded.radius
    return points, radius
