"""Write the page about cameras: coverage, reprojection errors and lens distortion."""

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

_PICTURE_WIDTH_PX = 640
_BAR_HEIGHT_PX, _BAR_BASELINE_PX = 120, 130
_MIN_TOP_ERROR_PX = 0.1  # the scale of errors does not end below this


def write_report(
    path: Path, cameras: Sequence[tuple[Intrinsics, Coverage, Sequence[BoardView]]]
) -> None:
    """Write a page about cameras that were calibrated with a board.

    Args:
        path: The file to write.
        cameras: For each camera its intrinsics, the coverage of its picture, and its views.

    Raises:
        StorageError: The file cannot be written.
    """
    write_page(
        path, "cameras", width=_PICTURE_WIDTH_PX, cameras=[_section(*camera) for camera in cameras]
    )


def _section(
    intrinsics: Intrinsics, coverage: Coverage, views: Sequence[BoardView]
) -> dict[str, Any]:
    """Return the values that the template needs for one camera."""
    camera = intrinsics.camera
    w, h = camera.size
    scale = _PICTURE_WIDTH_PX / w
    top_error = float(
        np.max(
            np.where(np.isfinite(intrinsics.errors), intrinsics.errors, 0.0),
            initial=_MIN_TOP_ERROR_PX,
        )
    )
    return {
        "name": camera.name,
        "size": camera.size,
        "height": f"{h * scale:.0f}",
        "numbers": [
            ("views", f"{len(views)}, {int((~intrinsics.used).sum())} of them excluded"),
            ("error", f"{intrinsics.error:.3f} px (RMS)"),
            (
                "focal length",
                f"{camera.focal[0]:.1f} x {camera.focal[1]:.1f} px, +- {intrinsics.sigma[0]:.1f}",
            ),
            (
                "principal point",
                f"{camera.matrix[0, 2]:.1f}, {camera.matrix[1, 2]:.1f} px,"
                f" +- {intrinsics.sigma[2]:.1f}",
            ),
            ("distortion", ", ".join(f"{x:.4f}" for x in camera.distortions)),
            ("coverage", f"{coverage.fraction:.0%} of the picture"),
        ],
        "hints": list(coverage.hints),
        "lattice": _lattice(camera, scale),
        "corners": [
            (f"{x * scale:.1f}", f"{y * scale:.1f}", bool(used))
            for view, used in zip(views, intrinsics.used, strict=True)
            for x, y in view.corners
        ],
        "bars": _bars(intrinsics, top_error),
        "most": f"{top_error:.2f}",
    }


def _lattice(camera: Camera, scale: float) -> list[str]:
    """Return straight lines as the lens bends them: points of polylines, pixels of the page."""
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
            p = camera.to_pixels(np.column_stack([x, y])) * scale
            lines.append(" ".join(f"{a:.1f},{b:.1f}" for a, b in p))
    return lines


def _bars(intrinsics: Intrinsics, top_error: float) -> list[dict[str, Any]]:
    step = _PICTURE_WIDTH_PX / max(len(intrinsics.errors), 1)
    bars = []
    for i, (error, used) in enumerate(zip(intrinsics.errors, intrinsics.used, strict=True)):
        height = _BAR_HEIGHT_PX * min(error / top_error, 1.0)
        bars.append(
            {
                "x": f"{i * step + 1:.1f}",
                "y": f"{_BAR_BASELINE_PX - height:.1f}",
                "width": f"{max(step - 2, 1):.1f}",
                "height": f"{height:.1f}",
                "used": bool(used),
                "title": f"view {i + 1}: {error:.3f} px, tilt {intrinsics.tilt[i]:.0f} degrees",
            }
        )
    return bars
