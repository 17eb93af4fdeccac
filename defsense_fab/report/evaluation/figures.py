"""Draw the figures of an evaluation for a paper: one column wide, 8 pt, readable in gray."""

from __future__ import annotations

import io
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...training.evaluation.error_budget import UNEXPLAINED
from ...training.evaluation.evaluate_models import Evaluated

_COLUMN_WIDTH_INCH = 85 / 25.4
_DARK, _BLUE, _LIGHT, _BAND = "#111111", "#1f5fa8", "#e08a1e", "#c9d6e6"
_MAX_CURVE_POINTS = 2000
_MAX_VALUE_PANELS = 6  # targets of one figure
_PATH_DURATION_S = 30.0
_MIN_LABEL_DISTANCE = 0.06  # share of the device's size; closer labels cover each other
_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 0.9,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "hatch.linewidth": 0.5,
    "svg.hashsalt": "defsense",
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
}


def svg_figures(evaluated: Evaluated) -> dict[str, str]:
    """Draw all figures of an evaluated model.

    Args:
        evaluated: The evaluated model.

    Returns:
        SVG by name, in reading order; coverage only if the model has intervals.
    """
    figures: dict[str, tuple[float, Callable[[Any, Evaluated], None]]] = {
        "paths": (78, _draw_paths),
        "error-over-time": (50, _draw_error_over_time),
        "markers": (_markers_height(evaluated.model.rest_points), _draw_markers),
        "poses": (24 + 7 * min(len(evaluated.evaluation.frames.poses), 12), _draw_poses),
        "hysteresis": (72, _draw_hysteresis),
        "coverage": (45, _draw_coverage),
        "error-budget": (48, _draw_error_budget),
    }
    if evaluated.evaluation.coverage is None:
        del figures["coverage"]
    if (targets := evaluated.model.targets) is not None:
        height = 18 + 26 * min(len(targets.names), _MAX_VALUE_PANELS)
        paths = 18 + 20 * min(len(targets.names), 3), _draw_paths
        figures = {"values": (height, _draw_values), **figures, "paths": paths}
        del figures["poses"]
        if targets.axes == 1:
            del figures["markers"]
    return {name: _render_svg(draw, height, evaluated) for name, (height, draw) in figures.items()}


def _render_svg(draw: Callable[[Any, Evaluated], None], height: float, evaluated: Evaluated) -> str:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure((_COLUMN_WIDTH_INCH, height / 25.4), layout="constrained")
        draw(figure, evaluated)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None})
        figure.clear()
    return out.getvalue()


def _draw_paths(figure: Any, evaluated: Evaluated) -> None:
    """Draw the displacement of three markers, each along the direction in which it moves most.

    The markers are the one that moves most, one with a median movement, and the one with the
    largest error.
    """
    e = evaluated.evaluation
    f = e.frames
    count = 3 if evaluated.model.targets is None else min(len(evaluated.model.ids), 3)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    frames = _frames_around_largest(f.elapsed, f.frame_error)
    markers = _choose_markers(f.measured - evaluated.model.rest_points, e.marker_rmse)
    for ax, m in zip(axes, markers, strict=False):
        rest = evaluated.model.rest_points[m]
        displacements = f.measured[f.visible[:, m], m] - rest
        direction = (
            np.linalg.svd(displacements, full_matrices=False)[2][0]
            if len(displacements)
            else np.eye(len(rest))[-1]
        )
        direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
        t = f.elapsed[frames]
        origin = rest if len(rest) > 1 else 0.0  # scalars are drawn as they are
        predicted, measured = (
            (x[frames, m] - origin) @ direction for x in (f.predicted, f.measured)
        )
        radius = f.radius[frames, m]
        if np.isfinite(radius).any():
            ax.fill_between(
                t,
                predicted - radius,
                predicted + radius,
                color=_BAND,
                lw=0,
                label=_interval_label(evaluated),
            )
        ax.plot(*_break_at_gaps(t, measured), color=_DARK, lw=1.0, label="measured")
        ax.plot(
            *_break_at_gaps(t, predicted), color=_LIGHT, lw=0.9, ls=(0, (3, 1.2)), label="predicted"
        )
        name = evaluated.model.target_names[m]
        ax.set_title(name if evaluated.model.targets else f"marker {name}", loc="left", pad=2)
        ax.margins(x=0)
    for ax in axes[len(markers) :]:
        ax.set_visible(False)
    what = "value" if evaluated.model.rest_points.shape[1] == 1 else "displacement"
    axes[len(markers) // 2].set_ylabel(f"{what}, {evaluated.unit_text}")
    axes[len(markers) - 1].set_xlabel("time, s")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)


def _draw_values(figure: Any, evaluated: Evaluated) -> None:
    """Draw measured and predicted targets with their intervals over the whole test.

    A position is drawn along the axis on which it changes most.
    """
    f, model = evaluated.evaluation.frames, evaluated.model
    assert model.targets is not None
    count = min(len(model.target_names), _MAX_VALUE_PANELS)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    subset = slice(None, None, -(-len(f.elapsed) // _MAX_CURVE_POINTS) or 1)
    t = f.elapsed[subset]
    for m, ax in enumerate(axes):
        spread = np.nan_to_num(np.nanstd(f.measured[:, m], axis=0)) if f.visible[:, m].any() else 0
        axis = int(np.argmax(spread))
        measured, predicted = f.measured[subset, m, axis], f.predicted[subset, m, axis]
        radius = f.radius[subset, m]
        if np.isfinite(radius).any():
            label = _interval_label(evaluated)
            low, high = predicted - radius, predicted + radius
            ax.fill_between(t, low, high, color=_BAND, lw=0, label=label)
        ax.plot(*_break_at_gaps(t, measured), color=_DARK, lw=0.8, label="measured")
        ax.plot(*_break_at_gaps(t, predicted), color=_LIGHT, lw=0.7, label="predicted")
        name = model.target_names[m] + (f", {'xyz'[axis]}" if model.targets.axes == 3 else "")
        ax.set_title(name, loc="left", pad=2)
        ax.set_ylabel(evaluated.unit_text)
        ax.margins(x=0)
    axes[-1].set_xlabel("tested time, s")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)


def _draw_error_over_time(figure: Any, evaluated: Evaluated) -> None:
    ax = figure.subplots()
    f = evaluated.evaluation.frames
    subset = slice(None, None, -(-len(f.elapsed) // _MAX_CURVE_POINTS) or 1)
    radius = np.where(f.visible, f.radius, 0).sum(1) / f.visible.sum(1)
    if np.isfinite(radius).any():
        ax.fill_between(
            f.elapsed[subset],
            0,
            radius[subset],
            color=_BAND,
            lw=0,
            label=_interval_label(evaluated),
        )
    ax.plot(
        *_break_at_gaps(f.elapsed[subset], f.frame_error[subset]),
        color=_BLUE,
        lw=0.5,
        label="frame",
    )
    edges = np.linspace(0, len(f.elapsed), min(len(f.elapsed), 40) + 1).astype(int)
    middle = [float(f.elapsed[a:b].mean()) for a, b in pairwise(edges)]
    median = [float(np.median(f.frame_error[a:b])) for a, b in pairwise(edges)]
    ax.plot(middle, median, color=_DARK, lw=1.2, label="median")
    ax.set_ylim(0, None)
    ax.margins(x=0)
    ax.set_xlabel("tested time, s")
    ax.set_ylabel(f"error, {evaluated.unit_text} (RMS of {evaluated.noun}s)")
    figure.legend(loc="outside upper right", ncols=3)


def _draw_markers(figure: Any, evaluated: Evaluated) -> None:
    """Draw the markers at rest along the axes of the smallest and second smallest extent."""
    places, rmse = evaluated.model.rest_points, evaluated.evaluation.marker_rmse
    a, b, c = np.argsort(-np.ptp(places, axis=0), kind="stable")
    views = figure.subplots(2, 1, sharex=True, height_ratios=_heights(places))
    max_rmse = float(np.nanmax(rmse)) if np.isfinite(rmse).any() else 1.0
    extent = float(np.ptp(places, axis=0).max())
    order = np.argsort(np.nan_to_num(rmse), kind="stable")
    for ax, (x, y) in zip(views, ((a, b), (a, c)), strict=True):
        size = 10 + 60 * np.nan_to_num(rmse[order]) / max_rmse
        points = ax.scatter(
            places[order, x],
            places[order, y],
            c=rmse[order],
            s=size,
            cmap="cividis_r",
            vmin=0,
            vmax=max_rmse,
            edgecolors=_DARK,
            linewidths=0.4,
        )
        ax.set_aspect("equal", adjustable="datalim")
        ax.margins(0.12)
        ax.set_ylabel(f"{'xyz'[y]}, mm")
    views[1].set_xlabel(f"{'xyz'[a]}, mm")
    for at, ids in _group_labels(
        places[order[-3:]][:, [a, b]], evaluated.model.ids[order[-3:]], extent
    ):
        views[0].annotate(
            ", ".join(map(str, ids)), at, (4, 4), textcoords="offset points", fontsize=7
        )
    figure.colorbar(points, ax=views, label="RMSE, mm", aspect=30)


def _group_labels(places: Float, ids: Int, extent: float) -> list[tuple[Float, list[int]]]:
    """Return places (n, 2) with the numbers of the markers that share a label there."""
    groups: list[tuple[Float, list[int]]] = []
    for place, number in zip(places, ids.tolist(), strict=True):
        neighbors = [
            ids for at, ids in groups if np.abs(at - place).max() < _MIN_LABEL_DISTANCE * extent
        ]
        if neighbors:
            neighbors[0].append(number)
        else:
            groups.append((place, [number]))
    return groups


def _heights(places: Float) -> tuple[float, float]:
    """Return the heights of both views of the markers by their extents, mm."""
    extents = np.sort(np.ptp(places, axis=0))[::-1]
    high, low = (float(np.clip(55 * x / max(extents[0], 1e-9), 14, 55)) for x in extents[1:])
    return high, low


def _markers_height(places: Float) -> float:
    """Return the height of the figure of the markers, mm; 0 for scalars, which have none."""
    return sum(_heights(places)) + 28 if places.shape[1] == 3 else 0.0


def _draw_poses(figure: Any, evaluated: Evaluated) -> None:
    ax = figure.subplots()
    e = evaluated.evaluation
    rows = sorted(zip(e.frames.poses, e.by_pose, strict=True), key=lambda row: -row[1].rmse)[:12]
    for k, (_, p) in enumerate(rows):
        ax.barh(k, p.rmse, 0.62, color=_BAND, edgecolor=_DARK, lw=0.6)
        ax.plot([max(p.rmse - p.deviation, 0), p.rmse + p.deviation], [k, k], color=_DARK)
        ax.plot(p.average_peak, k, "o", color="w", mec=_BLUE, ms=4)
        ax.plot(p.peak, k, "D", color=_DARK, ms=3)
    ax.axvline(e.total.rmse, color=_LIGHT, ls="--", zorder=0)
    ax.set_yticks(range(len(rows)), [_shorten(name) for name, _ in rows])
    ax.invert_yaxis()
    ax.set_xlim(0, None)
    ax.set_xlabel(f"error, {evaluated.unit_text}")
    handles = [
        _legend_handle("s", _BAND, "RMSE ± SD", 6),
        _legend_handle("o", "w", "average peak", 4, _BLUE),
        _legend_handle("D", _DARK, "peak", 3),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=3)


def _draw_hysteresis(figure: Any, evaluated: Evaluated) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    b = evaluated.evaluation.by_speed
    middle = (b.edges[:-1] + b.edges[1:]) / 2
    for ax, values, axis_label in (
        (above, b.too_far, f"too large by, {evaluated.unit_text}"),
        (below, b.rmse, f"RMSE, {evaluated.unit_text}"),
    ):
        for is_direction, color, mark in ((middle < 0, _BLUE, "v"), (middle > 0, _LIGHT, "^")):
            label = "returning" if mark == "v" else "moving out"
            ax.plot(
                middle[is_direction],
                values[is_direction],
                mark + "-",
                color=color,
                ms=3.5,
                mec=_DARK,
                mew=0.4,
                label=label,
            )
        ax.axvline(0, color="0.6", lw=0.5)
        ax.set_ylabel(axis_label)
    above.axhline(0, color="0.6", lw=0.5)
    below.set_ylim(0, None)
    below.set_xlabel(f"speed of the {evaluated.noun}s, {evaluated.unit_text}/s (back < 0 < out)")
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)


def _draw_coverage(figure: Any, evaluated: Evaluated) -> None:
    c = evaluated.evaluation.coverage
    assert c is not None
    ax = figure.subplots()
    ax.plot(
        10 * np.arange(10) + 5,
        100 * c.by_tenth,
        "o-",
        color=_BLUE,
        ms=4,
        mec=_DARK,
        mew=0.4,
        label="measured",
    )
    ax.axhline(100 * c.level, color=_LIGHT, ls="--", label=f"nominal, {100 * c.level:.0f} %")
    ax.set_xlim(0, 100)
    low = float(np.nanmin(c.by_tenth))
    ax.set_ylim(max(0.0, 100 * min(low, c.level) - 15), 101)
    ax.set_xlabel("tested time, %")
    ax.set_ylabel("inside the interval, %")
    figure.legend(loc="outside upper right", ncols=2)


def _draw_error_budget(figure: Any, evaluated: Evaluated) -> None:
    """Draw one bar of squares in percent of the sum; negative shares are left of 0."""
    ax = figure.subplots()
    budget = evaluated.budget
    styles = (
        ("#222222", ""),
        ("#e9e9e9", ""),
        ("#8fb3d9", "///"),
        ("#1f5fa8", ""),
        ("#f3c98b", "..."),
        ("#8a8a8a", "\\\\\\"),
        ("#e08a1e", ""),
        ("#ffffff", "xxx"),
        ("#ffffff", ""),
    )
    right, left = 0.0, 0.0
    for k, (cause, square) in enumerate(budget.shares.items()):
        share = 100 * square / budget.total if budget.total else 0.0
        color, hatch = styles[-1] if cause == UNEXPLAINED else styles[k % (len(styles) - 1)]
        start = right if share >= 0 else left + share
        ax.barh(
            0,
            abs(share),
            0.5,
            start,
            color=color,
            hatch=hatch,
            edgecolor=_DARK,
            lw=0.6,
            label=f"{cause}, {share:.0f} %",
        )
        if share >= 0:
            right += share
        else:
            left += share
    ax.axvline(0, color=_DARK, lw=0.6)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel(f"% of the mean square error, {budget.total:.3g} {evaluated.unit_text}²")
    figure.legend(loc="outside upper center", ncols=2)


def _choose_markers(displacements: Float, rmse: Float) -> list[int]:
    """Choose up to three different markers."""
    with np.errstate(all="ignore"):
        size = np.nan_to_num(np.sqrt(np.nanmean(np.nan_to_num(displacements**2).sum(2), axis=0)))
    order = np.argsort(-size, kind="stable")
    candidates = [order[0], order[len(order) // 2], int(np.argmax(np.nan_to_num(rmse))), *order]
    return list(dict.fromkeys(int(m) for m in candidates))[:3]


def _frames_around_largest(time: Float, error: Float) -> Int:
    """Return the indices of the frames some seconds around the largest error."""
    middle = float(time[int(np.argmax(error))])
    first = max(
        min(middle - _PATH_DURATION_S / 2, float(time[-1]) - _PATH_DURATION_S), float(time[0])
    )
    return np.flatnonzero((time >= first) & (time <= first + _PATH_DURATION_S))


def _break_at_gaps(time: Float, values: Float) -> tuple[Float, Float]:
    """Insert NaN at gaps, so that lines do not cross times without frames."""
    if len(time) < 3:
        return time, values
    step = np.diff(time)
    gaps = np.flatnonzero(step > max(5 * float(np.median(step)), 0.25)) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)


def _interval_label(evaluated: Evaluated) -> str:
    intervals = evaluated.model.main.intervals
    return f"{100 * intervals.level:.0f} % interval" if intervals else "interval"


def _shorten(name: str) -> str:
    return name if len(name) <= 20 else name[:19] + "…"


def _legend_handle(mark: str, color: str, label: str, size: float, edge: str = _DARK) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", marker=mark, color=color, mec=edge, mew=0.8, ms=size, label=label)
