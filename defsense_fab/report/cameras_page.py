"""What views of a board say of cameras, as a page to look at."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.cameras.intrinsics import Intrinsics
from ..capture.cameras.view_selection import Coverage
from ..capture.tags.detection import BoardView
from ..core.camera import Camera
from .html import write_page

_WIDTH = 640  # px of a picture on the page


def write_report(
    path: Path, cameras: Sequence[tuple[Intrinsics, Coverage, Sequence[BoardView]]]
) -> None:
    """One page: of each camera where corners were seen, how far they were missed, how the lens
    bends."""
    write_page(path, "cameras", width=_WIDTH, cameras=[_section(*camera) for camera in cameras])


def _section(found: Intrinsics, covered: Coverage, views: Sequence[BoardView]) -> dict[str, Any]:
    """What the template shows of one camera."""
    c = found.camera
    w, h = c.size
    k = _WIDTH / w
    most = float(np.max(np.where(np.isfinite(found.errors), found.errors, 0.0), initial=0.1))
    return {
        "name": c.name,
        "size": c.size,
        "height": f"{h * k:.0f}",
        "numbers": [
            ("views", f"{len(views)}, of which {int((~found.used).sum())} were left out"),
            ("error", f"{found.error:.3f} px, root mean square"),
            ("focal length", f"{c.focal[0]:.1f} x {c.focal[1]:.1f} px, +- {found.sigma[0]:.1f}"),
            ("centre", f"{c.matrix[0, 2]:.1f}, {c.matrix[1, 2]:.1f} px, +- {found.sigma[2]:.1f}"),
            ("distortion", ", ".join(f"{x:.4f}" for x in c.distortions)),
            ("covered", f"{covered.fraction:.0%} of the picture"),
        ],
        "hints": list(covered.hints),
        "lattice": _lattice(c, k),
        "corners": [
            (f"{x * k:.1f}", f"{y * k:.1f}", bool(used))
            for view, used in zip(views, found.used, strict=True)
            for x, y in view.corners
        ],
        "bars": _bars(found, most),
        "most": f"{most:.2f}",
    }


def _lattice(camera: Camera, k: float) -> list[str]:
    """Straight lines as the lens bends them: points of polylines, in pixels of the page."""
    w, h = camera.size
    edge = camera.to_plane(np.array([[0.0, h / 2], [w, h / 2], [w / 2, 0.0], [w / 2, h]]))
    if not np.isfinite(edge).all():
        return []
    x0, x1, y0, y1 = edge[0, 0], edge[1, 0], edge[2, 1], edge[3, 1]
    lines = []
    for s in np.linspace(0, 1, 9):
        t = np.linspace(0, 1, 40)
        for x, y in (
            (np.full(40, x0 + s * (x1 - x0)), y0 + t * (y1 - y0)),
            (x0 + t * (x1 - x0), np.full(40, y0 + s * (y1 - y0))),
        ):
            p = camera.to_pixels(np.column_stack([x, y])) * k
            lines.append(" ".join(f"{a:.1f},{b:.1f}" for a, b in p))
    return lines


def _bars(found: Intrinsics, most: float) -> list[dict[str, Any]]:
    step = _WIDTH / max(len(found.errors), 1)
    bars = []
    for i, (error, used) in enumerate(zip(found.errors, found.used, strict=True)):
        tall = 120 * min(error / most, 1.0)
        bars.append(
            {
                "x": f"{i * step + 1:.1f}",
                "y": f"{130 - tall:.1f}",
                "width": f"{max(step - 2, 1):.1f}",
                "height": f"{tall:.1f}",
                "used": bool(used),
                "title": f"view {i + 1}: {error:.3f} px, tilt {found.tilt[i]:.0f} degrees",
            }
        )
    return bars
