"""Draw what the package proposes: poses side by side, and layouts by error and planes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ...core.storage.files import replace_file
from ...store.layout import WeighedRecord
from ..html import as_image
from . import views
from .scene import Scene, poly
from .sheet import COLORS, SMALL, Sheet, shortened

_PANEL_WIDTH_PX, _PANEL_HEIGHT_PX, _TITLE_HEIGHT_PX, _GAP_PX = 560, 400, 40, 20
_COLUMNS = 2
_MIN_TRIALS = 2  # layouts, below which a plot of their errors shows nothing


def draw_modes(
    shapes: list[tuple[str, Float]], faces: Any, rest: Float, frame: Float, path: Path
) -> None:
    """Draw deformed bodies side by side over the outline at rest, and write the picture as PNG.

    Args:
        shapes: Titles and deformed vertices (n, 3), mm.
        faces: Triangles (f, 3) of the body's surface.
        rest: Vertices at rest (n, 3), mm.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.
        path: File to write.

    Raises:
        StorageError: The file cannot be written.
    """
    rows = -(-max(len(shapes), 1) // _COLUMNS)
    step = np.array([_PANEL_WIDTH_PX + _GAP_PX, _PANEL_HEIGHT_PX + _TITLE_HEIGHT_PX + _GAP_PX])
    sheet = Sheet(*(step * [_COLUMNS, rows]))
    view = views.three_quarter(frame)
    for i, (title, vertices) in enumerate(shapes):
        corner = step * [i % _COLUMNS, i // _COLUMNS] + _GAP_PX / 2
        with Scene() as scene:
            scene.outline(Surface(rest, faces))
            body = poly(Surface(vertices, faces))
            body["movement"] = np.linalg.norm(vertices - rest, axis=1)
            top = max(float(body["movement"].max()), 1e-9)
            scene.colored(body, "movement", "viridis", top)
            shot = scene.shot(view, _PANEL_WIDTH_PX, _PANEL_HEIGHT_PX)
        margin = np.array([_PANEL_WIDTH_PX, _PANEL_HEIGHT_PX]) - shot.size
        sheet.paste(shot.image, corner + np.array([0, _TITLE_HEIGHT_PX]) + margin / 2)
        sheet.text(
            corner + np.array([0, _TITLE_HEIGHT_PX / 2]),
            shortened(title, _PANEL_WIDTH_PX, SMALL),
            SMALL,
            anchor="lm",
        )
        sheet.axes(view, corner + np.array([0, _TITLE_HEIGHT_PX + _PANEL_HEIGHT_PX - 52]))
    with replace_file(path) as temporary:
        temporary.write_bytes(sheet.png())


def draw_trial_errors(trials: Sequence[WeighedRecord]) -> str | None:
    """Plot the error of each compared layout against its number of planes.

    Args:
        trials: The layouts; those that cannot be made are not drawn.

    Returns:
        The plot as a PNG data URI, or None if fewer than two layouts can be made.
    """
    feasible = [t for t in trials if t.built is not None]
    if len(feasible) < _MIN_TRIALS:
        return None
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.5, 3.6), dpi=110, layout="constrained")
    axis = figure.subplots()
    groups = {
        "no warnings": [t for t in feasible if t.parts is not None and not t.warnings],
        "warnings": [t for t in feasible if t.parts is not None and t.warnings],
        "parts not made": [t for t in feasible if t.parts is None],
    }
    for (label, group), face in zip(groups.items(), (COLORS[1], "w", "lightgray"), strict=True):
        if group:
            x, y = _planes_and_errors(group)
            axis.scatter(x, y, s=60, edgecolor=COLORS[1], facecolor=face, label=label)
    x, y = _planes_and_errors([t for t in feasible if t.chosen])
    axis.scatter(x, y, s=220, facecolor="none", edgecolor=COLORS[0], linewidth=2, label="chosen")
    axis.set(xlabel="Number of planes", ylabel="RMSE in unseen states, mm")
    axis.margins(x=0.15)
    axis.set_ylim(0, 1.15 * float(_planes_and_errors(feasible)[1].max()))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axis.grid(True, alpha=0.25)
    axis.legend(fontsize="small")
    return as_image(figure)


def _planes_and_errors(trials: Sequence[WeighedRecord]) -> Float:
    """Return the numbers of planes and the errors of layouts, (2, t)."""
    return np.array([(t.planes, t.built) for t in trials], float).reshape(-1, 2).T
