"""Write an evaluation as a folder: a page, figures for a paper, tables and JSON."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import TrainingError
from ...core.storage.files import replace_folder, write_text
from ...core.version import __version__
from ...decoding.error_scale import SCALE
from ...training.evaluation.error_budget import ErrorBudget
from ...training.evaluation.evaluate_models import Evaluated, SessionEvaluation
from ...training.evaluation.model_comparison import SIGNIFICANCE_LEVEL, Comparison
from ..html import write_page
from .data_files import SOURCE, as_data, csv_files, published_errors
from .figures import svg_figures

PAGE, DATA = "evaluation.html", "evaluation.json"

_METHOD = "paired by blocks of the same frames"

_CAPTIONS = {
    "paths": "Measured and predicted displacement of three markers around the largest error: the"
    " marker that moves most, a marker with a median movement, and the marker with the largest"
    " RMSE, each along the direction in which it moves most.",
    "error-over-time": "Error of each frame (RMS over the visible markers), its median, and the"
    " mean half width of the intervals.",
    "markers": "RMSE of each marker, at its position at rest.",
    "poses": "Errors by requested pose; the dashed line is the RMSE of all frames.",
    "hysteresis": "Errors by speed and direction: how much the predicted displacement is too large,"
    " and the RMSE. A difference between the directions is hysteresis of the cords.",
    "coverage": "Share of marker positions inside their intervals, by tenths of the tested time.",
    "error-budget": "Causes of the mean square error.",
}

_TARGET_CAPTIONS = {
    "values": "Measured and predicted targets with their intervals over the tested time.",
    "paths": "Measured and predicted targets with their intervals around the largest error: the"
    " target that changes most, one with a median change, and the one with the largest RMSE.",
    "error-over-time": "Error of each row (RMS over the targets), its median, and the mean half"
    " width of the intervals.",
    "coverage": "Share of the values inside their intervals, by tenths of the tested time.",
    "hysteresis": "Errors by speed and direction: how much the change from the reference is too"
    " large, and the RMSE. A difference between the directions is hysteresis of the sensor.",
}


def write_evaluation(folder: Path, result: SessionEvaluation, expected: str = "") -> None:
    """Write all files of an evaluation, completely or not at all; an existing one is replaced.

    Args:
        folder: The folder to write.
        result: The evaluation.
        expected: How the error compares with the one that the design expects, as a sentence.

    Raises:
        TrainingError: The folder holds something else than an evaluation.
        StorageError: The folder cannot be written.
    """
    check_folder(folder)
    with replace_folder(folder, overwrite=True) as new:
        figures = _draw(result)
        for name, text in figures.items():
            write_text(new / f"{name}.svg", text)
        for name, text in csv_files(result).items():
            write_text(new / name, text)
        write_text(new / DATA, json.dumps(as_data(result), indent=1, allow_nan=False) + "\n")
        write_page(new / PAGE, "evaluation", **_values(result, figures), expected=expected)


def check_folder(folder: Path) -> None:
    """Check that a folder is missing or holds only an evaluation, which may be replaced.

    Args:
        folder: The folder.

    Raises:
        TrainingError: The folder holds other files, which would be lost.
    """
    if not folder.exists():
        return
    expected_names = {PAGE, DATA}
    others = [
        p.name
        for p in (sorted(folder.iterdir()) if folder.is_dir() else [folder])
        if p.name not in expected_names and p.suffix not in (".svg", ".csv")
    ]
    if others or (any(folder.iterdir()) and not (folder / PAGE).exists()):
        content = f"contains {others[0]}" if others and folder.is_dir() else "exists"
        raise TrainingError(
            f"{content} and is not an evaluation, so it would be overwritten",
            code="not-an-evaluation",
            where=folder,
            action="Choose another output folder",
            file=others[0] if others else None,
        )


def _values(result: SessionEvaluation, figures: dict[str, str]) -> dict[str, Any]:
    first = result.models[0]
    return {
        "result": result,
        "first": first,
        "evaluation": first.evaluation,
        "scale": SCALE,
        "paper": published_errors(result),
        "unit": first.unit_text,
        "noun": first.noun,
        "targets": _target_rows(result) if first.model.targets is not None else [],
        "source": SOURCE,
        "figures": [(name, _caption(name, first), _image(svg)) for name, svg in figures.items()],
        "rows_by_pose": list(
            zip(first.evaluation.frames.poses, first.evaluation.by_pose, strict=True)
        ),
        "causes": _causes(first.budget),
        "true_causes": None if first.by_truth is None else _causes(first.by_truth),
        "comparison": result.comparison,
        "verdict": verdict(result.comparison) if result.comparison else "",
        "version": __version__,
    }


def _draw(result: SessionEvaluation) -> dict[str, str]:
    """Return the figures of the first model, and prediction and truth for each further unit."""
    first, *others = result.models
    figures = svg_figures(first)
    for m in others:
        if m.model.metadata is first.model.metadata:
            figures[f"values-{_file_word(m.unit)}"] = svg_figures(m)["values"]
    return figures


def _file_word(unit: str) -> str:
    return "".join(c for c in unit if c.isalnum()) or "no-unit"


def _caption(name: str, first: Evaluated) -> str:
    if first.model.targets is None:
        return _CAPTIONS[name]
    kind = "values" if name.startswith("values") else name
    return _TARGET_CAPTIONS.get(kind) or _CAPTIONS[kind].replace("marker", "target")


def _target_rows(result: SessionEvaluation) -> list[tuple[str, str, float, float, str]]:
    """Return name, unit, RMSE, peak and model of each target of all models."""
    return [
        (name, m.unit_text, float(rmse), float(peak), m.name)
        for m in result.models
        for name, rmse, peak in zip(
            m.model.target_names,
            m.evaluation.marker_rmse,
            m.evaluation.marker_peak,
            strict=True,
        )
    ]


def _image(svg: str) -> str:
    data = base64.b64encode(svg.encode()).decode("ascii")
    return f"data:image/svg+xml;base64,{data}"


def _causes(budget: ErrorBudget) -> list[tuple[str, float, float]]:
    total = budget.total
    return [(c, s, s / total if total else 0.0) for c, s in budget.shares.items()]


def probability(p: float) -> str:
    """Format a probability as in papers."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def verdict(c: Comparison) -> str:
    """Return whether the models differ, as a sentence."""
    if np.isnan(c.means).any():
        return "The models decode no frame in common. Test them on the same markers and channels."
    if not c.tests:
        return "The errors are correlated for too long to compare the models. Record for longer."
    best = c.names[int(c.means.argmin())]
    others = [t for t in c.tests if best in (t.first, t.second)]
    better = sum(t.p < SIGNIFICANCE_LEVEL for t in others)
    if len(others) == len(c.names) - 1 and better == len(others):
        p = probability(max(t.p for t in others))
        return f"{best} has smaller errors than all other models ({_METHOD}, {p})."
    return (
        f"{best} has the smallest mean error, but the difference from the other models is not"
        f" significant for all of them ({_METHOD})."
    )
