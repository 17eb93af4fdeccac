"""Convert an evaluation to plain values for JSON, and to CSV tables."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from ...decoding.quantities import MARKER_UNIT
from ...training.evaluation.evaluate import Evaluation, Measures
from ...training.evaluation.evaluate_models import Evaluated, SessionEvaluation
from ...training.evaluation.model_comparison import Comparison, PairedTest
from ...training.evaluation.predicted_error import PredictedError
from ...training.fitting.errors_by_unit import UnitErrors, errors_to_json

#: DefSense (CHI 2016), Table 1: a bar with 3 cords, 2,040 test frames, mm.
PAPER = {
    "manual": Measures(4.46, 1.76, 21.78, 8.98, 2040),
    "visual": Measures(3.66, 1.33, 17.13, 7.12, 2040),
    "full": Measures(1.17, 0.71, 10.13, 2.16, 2040),
}
SOURCE = "DefSense, CHI 2016, Table 1"
_PAPER_DEVICE = "bar"  # name of its device, also with an ending

#: Columns of the tables, by file name.
_COLUMNS = {
    "table-1.csv": (
        "model,rmse_mm,standard_deviation_mm,peak_mm,average_peak_mm,frames,"
        "camera_noise_mm,rmse_without_camera_noise_mm"
    ),
    "markers.csv": "model,marker,x_mm,y_mm,z_mm,rmse_mm,peak_mm",
    "poses.csv": (
        "model,pose,rmse_mm,standard_deviation_mm,peak_mm,average_peak_mm,"
        "frames,coverage,coverage_standard_error"
    ),
    "coverage.csv": "model,tenth_of_the_time,coverage,level",
    "speed.csv": "model,speed_from_mm_s,speed_to_mm_s,frames,rmse_mm,too_far_out_mm",
    "error-budget.csv": "model,cause,mean_square_mm2,share,how",
    "predicted.csv": "model,cause,mean_square_mm2,rmse_mm,ratio_to_measured",
    "frames.csv": (
        "model,run,pose,time_s,error_mm,largest_mm,radius_mm,speed_mm_s,too_far_out_mm,distance"
    ),
}

Rows = list[list[Any]]


def as_data(result: SessionEvaluation) -> dict[str, Any]:
    """Return an evaluation without the values of single frames, for JSON.

    Args:
        result: The evaluation.

    Returns:
        Plain values: lengths in mm, squares in mm^2, None for unknown values.
    """
    data = {
        "device": result.device,
        "sessions": result.sessions,
        "last_share": result.last_share,
        "notes": result.notes,
        "models": {m.name: _model(m) for m in result.models},
        "comparison": None if result.comparison is None else asdict(result.comparison),
        "cords": None if result.likeness is None else result.likeness.to_json(),
        "paper": {name: asdict(row) for name, row in published_errors(result).items()},
        "test": errors_to_json(_first_errors(result)),
    }
    plain = _plain(data)
    assert isinstance(plain, dict)
    return plain


def published_errors(result: SessionEvaluation) -> dict[str, Measures]:
    """Return the published errors of the paper's device; none for other devices and sensors.

    Args:
        result: The evaluation.

    Returns:
        Errors by the way in which the cords were placed.
    """
    first = result.models[0].model
    is_bar = result.device.partition("-")[0] == _PAPER_DEVICE
    return PAPER if is_bar and first.targets is None and len(first.channels) == 3 else {}


def _first_errors(result: SessionEvaluation) -> list[UnitErrors]:
    """Return the errors of the first model, for each unit of its targets."""
    kind = result.models[0].model.metadata
    return [m.errors for m in result.models if m.model.metadata is kind and m.errors is not None]


def csv_files(result: SessionEvaluation) -> dict[str, str]:
    """Return the CSV files of an evaluation.

    Args:
        result: The evaluation.

    Returns:
        Texts by file name: a header line, then numbers; unknown values are empty.
    """
    tables = {
        "table-1.csv": _table_1(result),
        "markers.csv": _by_marker(result.models),
        "poses.csv": _by_pose(result.models),
        "coverage.csv": _coverage(result.models),
        "speed.csv": _by_speed(result.models),
        "error-budget.csv": _budget(result.models),
        "predicted.csv": _predicted(result.models),
        "frames.csv": _frames(result.models),
    }
    header = _columns_of(result.models)
    tables = {name: [header[name].split(","), *rows] for name, rows in tables.items()}
    if result.models[0].model.targets is not None:
        tables["values.csv"] = _values(result.models)
    if result.comparison is not None:
        tables["comparison.csv"] = _comparison(result.comparison)
    return {name: _text(rows) for name, rows in tables.items()}


def _columns_of(models: Sequence[Evaluated]) -> dict[str, str]:
    """Return the columns with the unit of the targets; without, if there are several or none."""
    units = {m.unit for m in models}
    if units == {MARKER_UNIT}:
        return _COLUMNS
    unit = "_".join(units) if len(units) == 1 else ""
    changes = {"_mm2": f"_{unit}2", "_mm_s": f"_{unit}_s", "_mm": f"_{unit}"}
    if not unit:
        changes = {"_mm2": "", "_mm_s": "_per_s", "_mm": ""}
    out = dict(_COLUMNS)
    if models[0].model.rest_points.shape[1] == 1:
        out["markers.csv"] = out["markers.csv"].replace("x_mm,y_mm,z_mm", "reference")
    for old, new in changes.items():
        out = {name: columns.replace(old, new) for name, columns in out.items()}
    return out


def _model(m: Evaluated) -> dict[str, Any]:
    e = m.evaluation
    c = e.coverage
    return {
        "decoder": m.model.kind,
        "errors": asdict(e.total),
        "camera_noise": e.camera_noise,
        "rmse_without_camera_noise": e.rmse_without_noise,
        "poses": {p: asdict(row) for p, row in zip(e.frames.poses, e.by_pose, strict=True)},
        **_marker_errors(m),
        "within_trained_range": None if e.inside is None else asdict(e.inside),
        "beyond_trained_range": None if e.outside is None else asdict(e.outside),
        "intervals": None if c is None else asdict(c),
        "by_speed": asdict(e.by_speed),
        "error_budget": {"total": m.budget.total, **m.budget.shares},
        "error_budget_by_truth": (
            None if m.by_truth is None else {"total": m.by_truth.total, **m.by_truth.shares}
        ),
        "predicted": None if m.predicted is None else _predicted_error(m.predicted),
        "usefulness": (
            None if m.usefulness is None else {**m.usefulness.to_json(), "grade": m.grade or None}
        ),
        "left_out": {
            "without_samples": e.frames.omitted.without_samples,
            "without_markers": e.frames.omitted.without_markers,
        },
    }


def _marker_errors(m: Evaluated) -> dict[str, Any]:
    """Return the errors of each marker; of other targets with their unit."""
    errors = zip(
        m.model.target_names, m.evaluation.marker_rmse, m.evaluation.marker_peak, strict=True
    )
    rows = {name: {"rmse": r, "peak": p} for name, r, p in errors}
    if m.model.targets is None:
        return {"markers": rows}
    return {
        "unit": m.unit,
        "targets": rows,
        "test": None if m.errors is None else m.errors.to_json(),
    }


def _plain(value: Any) -> Any:
    """Convert arrays to lists and NaN to None, which JSON lacks."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _table_1(result: SessionEvaluation) -> Rows:
    rows: Rows = []
    for m in result.models:
        e = m.evaluation
        rows.append([m.name, *asdict(e.total).values(), e.camera_noise, e.rmse_without_noise])
    rows += [
        [f"{name} ({SOURCE})", *asdict(t).values(), None, None]
        for name, t in published_errors(result).items()
    ]
    return rows


def _by_marker(models: Sequence[Evaluated]) -> Rows:
    rows: Rows = []
    for m in models:
        e = m.evaluation
        for name, place, rmse, peak in zip(
            m.model.target_names, m.model.rest_points, e.marker_rmse, e.marker_peak, strict=True
        ):
            rows.append([m.name, name, *place, rmse, peak])
    return rows


def _by_pose(models: Sequence[Evaluated]) -> Rows:
    rows: Rows = []
    for m in models:
        e = m.evaluation
        for k, (pose, t) in enumerate(zip(e.frames.poses, e.by_pose, strict=True)):
            c = e.coverage
            inside = [None, None] if c is None else [c.by_pose[k], c.by_pose_error[k]]
            rows.append([m.name, pose, *asdict(t).values(), *inside])
    return rows


def _coverage(models: Sequence[Evaluated]) -> Rows:
    rows: Rows = []
    for m in models:
        c = m.evaluation.coverage
        for k, share in enumerate([] if c is None else c.by_tenth, 1):
            rows.append([m.name, k, share, None if c is None else c.level])
    return rows


def _by_speed(models: Sequence[Evaluated]) -> Rows:
    rows: Rows = []
    for m in models:
        b = m.evaluation.by_speed
        rows += [
            [m.name, *row]
            for row in zip(b.edges[:-1], b.edges[1:], b.frames, b.rmse, b.too_far, strict=True)
        ]
    return rows


def _budget(models: Sequence[Evaluated]) -> Rows:
    """Return the fitted error budget, and the true one where it is known."""
    rows: Rows = []
    for m in models:
        for how, budget in (("truth", m.by_truth), ("fitted", m.budget)):
            if budget is None:
                continue
            total = budget.total
            rows += [
                [m.name, cause, square, square / total if total else None, how]
                for cause, square in budget.shares.items()
            ]
            rows.append([m.name, "total", total, 1.0 if total else None, how])
    return rows


def _predicted_error(p: PredictedError) -> dict[str, Any]:
    return {
        "rmse": p.predicted,
        "measured": p.measured,
        "ratio": p.ratio,
        "promised_ratio": p.design_ratio,
        "mean_squares": p.shares,
        "promise": None if p.design is None else asdict(p.design),
        "shapes_shown_again": p.repeated_share,
    }


def _predicted(models: Sequence[Evaluated]) -> Rows:
    """Return the mean squares, which add up to the predicted one, and RMSE with its ratio."""
    rows: Rows = []
    for m in models:
        if (p := m.predicted) is None:
            continue
        rows += [[m.name, cause, square, None, None] for cause, square in p.shares.items()]
        rows.append([m.name, "predicted", p.predicted**2, p.predicted, p.ratio])
        if p.design is not None:
            promise = p.design.rmse
            rows.append([m.name, "promised", promise**2, promise, p.design_ratio])
        rows.append([m.name, "measured", p.measured**2, p.measured, 1.0])
    return rows


def _frames(models: Sequence[Evaluated]) -> Rows:
    rows: Rows = []
    for m in models:
        e: Evaluation = m.evaluation
        f = e.frames
        largest = np.nanmax(f.marker_error, axis=1)
        radius = np.where(f.visible, f.radius, 0).sum(1) / f.visible.sum(1)
        numbers = (f.time, f.frame_error, largest, radius, e.speed, e.too_far, f.distance)
        columns = zip(f.run, f.pose, *numbers, strict=True)
        rows += [[m.name, f.runs[run], f.poses[pose], *row] for run, pose, *row in columns]
    return rows


def _values(models: Sequence[Evaluated]) -> Rows:
    """Return the measured and predicted numbers of all targets, with their half widths."""
    rows: Rows = [["model", "run", "time_s", "target", "unit", "measured", "predicted", "radius"]]
    for m in models:
        f, targets = m.evaluation.frames, m.model.targets
        if targets is None:
            continue
        axes = ("",) if targets.axes == 1 else ("_x", "_y", "_z")
        for k, name in enumerate(targets.names):
            for a, axis in enumerate(axes):
                columns = zip(
                    f.run,
                    f.time,
                    f.measured[:, k, a],
                    f.predicted[:, k, a],
                    f.radius[:, k],
                    strict=True,
                )
                rows += [
                    [m.name, f.runs[run], time, name + axis, m.unit, *numbers]
                    for run, time, *numbers in columns
                ]
    return rows


def _comparison(comparison: Comparison) -> Rows:
    names = [field.name for field in fields(PairedTest)]
    units = {"difference": "difference_mm", "low": "low_mm", "high": "high_mm"}
    return [
        [units.get(name, name) for name in names],
        *([getattr(test, name) for name in names] for test in comparison.tests),
    ]


def _text(rows: Iterable[Iterable[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float | np.floating):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return "" if value is None else value
