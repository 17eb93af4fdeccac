"""An evaluation as a folder: a page to look at, figures for a paper, tables and JSON."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from ...core.errors import TrainingError
from ...core.storage.files import replace_folder, write_text
from ...core.version import __version__
from ...training.evaluation.error_budget import ErrorBudget
from ...training.evaluation.evaluate_models import SessionEvaluation
from ...training.evaluation.model_comparison import (
    SIGNIFICANCE_LEVEL,
    Analysis,
    Comparison,
    Statistic,
)
from ..html import write_page
from .figures import svg_figures
from .tables import PAPER, SOURCE, as_data, csv_files

PAGE, DATA = "evaluation.html", "evaluation.json"

_CAPTIONS = {
    "paths": "Displacement of three markers, measured and predicted, about the largest error: the"
    " marker that moves most, one in the middle, and the one with the largest RMSE, each along the"
    " direction in which it moves most.",
    "error-over-time": "Error of each frame (root mean square over the markers seen), its median,"
    " and the mean half width of the intervals.",
    "markers": "RMSE of each marker, where it is at rest.",
    "poses": "By the pose that was asked for; the dashed line is the RMSE of all frames.",
    "hysteresis": "By speed and direction: how much too far out the device is said to be, and the"
    " RMSE. Where both directions part, the cords' hysteresis is left.",
    "coverage": "Share of marker positions inside of their intervals, by tenths of the tested"
    " time.",
    "error-budget": "Where the mean square error comes from.",
}


def write_evaluation(folder: Path, result: SessionEvaluation) -> None:
    """All files of the folder, whole or not at all; an evaluation that is there is replaced. Raises
    TrainingError for a folder of something else, StorageError where it cannot be written."""
    check_folder(folder)
    with replace_folder(folder, overwrite=True) as new:
        figures = svg_figures(result.models[0])
        for name, text in figures.items():
            write_text(new / f"{name}.svg", text)
        for name, text in csv_files(result).items():
            write_text(new / name, text)
        write_text(new / DATA, json.dumps(as_data(result), indent=1, allow_nan=False) + "\n")
        write_page(new / PAGE, "evaluation", **_values(result, figures))


def check_folder(folder: Path) -> None:
    """Raises TrainingError for a folder that holds something else than an evaluation, which would
    be lost."""
    if not folder.exists():
        return
    own = {PAGE, DATA}
    others = [
        p.name
        for p in (sorted(folder.iterdir()) if folder.is_dir() else [folder])
        if p.name not in own and p.suffix not in (".svg", ".csv")
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
        "paper": PAPER,
        "source": SOURCE,
        "figures": [(name, _CAPTIONS[name], _image(svg)) for name, svg in figures.items()],
        "rows_by_pose": list(
            zip(first.evaluation.frames.poses, first.evaluation.by_pose, strict=True)
        ),
        "causes": _causes(first.budget),
        "true_causes": None if first.by_truth is None else _causes(first.by_truth),
        "comparison": _comparison(result.comparison) if result.comparison else None,
        "version": __version__,
    }


def _image(svg: str) -> str:
    data = base64.b64encode(svg.encode()).decode("ascii")
    return f"data:image/svg+xml;base64,{data}"


def _causes(budget: ErrorBudget) -> list[tuple[str, float, float]]:
    total = budget.total
    return [(c, s, s / total if total else 0.0) for c, s in budget.shares.items()]


def _comparison(c: Comparison) -> dict[str, Any]:
    rows = [("frames, as if independent", c.by_frame)]
    if c.by_block is not None:
        rows.append((f"blocks of {c.block_frames} frames", c.by_block))
    tests = [(what, name, *line) for what, a in rows for name, line in _tests(a)]
    return {"tests": tests, "verdict": verdict(c), "data": c}


def _tests(a: Analysis) -> list[tuple[str, tuple[str, str]]]:
    out = [
        ("analysis of variance", _line(a.anova)),
        ("equal variances (Levene)", _line(a.levene)),
    ]
    if a.variances_differ:
        out += [("Welch", _line(a.welch)), ("Kruskal-Wallis", _line(a.kruskal))]
    out.append(("effect size", (f"ω² = {a.omega_squared:.3f}, η² = {a.eta_squared:.3f}", "")))
    return out


def _line(s: Statistic) -> tuple[str, str]:
    within = "" if s.within != s.within else f", {s.within:.0f}"
    return f"{s.value:.2f} ({s.between:.0f}{within})", probability(s.p)


def probability(p: float) -> str:
    """As papers write it."""
    if p != p:
        return "p not known"
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}"


def verdict(c: Comparison) -> str:
    """What the test that holds says, in a sentence."""
    if c.by_block is None and not c.paired:
        return (
            f"Errors go on for so long (blocks of {c.block_frames} frames) that nothing can be said;"
            " record for longer."
        )
    best = c.names[int(c.means.argmin())]
    if c.paired:
        others = [t for t in c.paired if best in (t.first, t.second)]
        better = sum(t.p < SIGNIFICANCE_LEVEL for t in others)
        how = "paired by blocks of the same frames"
        if len(others) == len(c.names) - 1 and better == len(others):
            p = max(t.p for t in others)
            return f"{best} has smaller errors than any other ({how}, {probability(p)})."
        return f"{best} has the smallest mean error, but not demonstrably than all others ({how})."
    assert c.by_block is not None
    told = c.by_block.valid_test
    how = f"{'Welch' if c.by_block.variances_differ else 'analysis of variance'} of block means"
    if told.p < SIGNIFICANCE_LEVEL:
        return f"The models' errors differ ({how}, {probability(told.p)}); {best} has the smallest."
    return f"The models' errors do not differ demonstrably ({how}, {probability(told.p)})."
