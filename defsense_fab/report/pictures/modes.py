"""Proposed poses side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ...core.storage.files import replace_file
from . import views
from .scene import Scene, poly
from .sheet import SMALL, Sheet, shortened

_WIDTH, _HEIGHT, _HEAD, _COLUMNS, _SPACE = 560, 400, 40, 2, 20


def modes(
    shapes: list[tuple[str, Float]], faces: Any, rest: Float, frame: Float, path: Path
) -> None:
    """Moved bodies (title, vertices (n, 3)) side by side over the outline at rest, as a PNG; how
    the body stands, `frame` (3, 3)."""
    rows = -(-max(len(shapes), 1) // _COLUMNS)
    step = np.array([_WIDTH + _SPACE, _HEIGHT + _HEAD + _SPACE])
    sheet = Sheet(*(step * [_COLUMNS, rows]))
    view = views.three_quarter(frame)
    for i, (title, moved) in enumerate(shapes):
        corner = step * [i % _COLUMNS, i // _COLUMNS] + _SPACE / 2
        with Scene() as scene:
            scene.outline(Surface(rest, faces))
            body = poly(Surface(moved, faces))
            body["movement"] = np.linalg.norm(moved - rest, axis=1)
            top = max(float(body["movement"].max()), 1e-9)
            scene.colored(body, "movement", "viridis", top)
            shot = scene.shot(view, _WIDTH, _HEIGHT)
        spare = np.array([_WIDTH, _HEIGHT]) - shot.size
        sheet.paste(shot.image, corner + np.array([0, _HEAD]) + spare / 2)
        sheet.text(
            corner + np.array([0, _HEAD / 2]), shortened(title, _WIDTH, SMALL), SMALL, anchor="lm"
        )
        sheet.axes(view, corner + np.array([0, _HEAD + _HEIGHT - 52]))
    with replace_file(path) as temporary:
        temporary.write_bytes(sheet.png())
