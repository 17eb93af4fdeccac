"""What views of a board say of cameras, as a page to look at."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from ..capture.board_view import BoardView
from ..capture.board_views import Coverage
from ..capture.intrinsics import Intrinsics
from ..core.camera import Camera
from ..core.files import storage_errors, write_text

_WIDTH = 640  # px of a picture on the page
_STYLE = (
    "body{font:15px sans-serif;max-width:900px;margin:2em auto;color:#222}svg{background:#f4f4f4}"
    "td,th{padding:2px 10px;text-align:right}table{border-collapse:collapse;margin:1em 0}"
    "tr:nth-child(even){background:#f4f4f4}.out{color:#b00}"
)


def write_report(
    path: Path, cameras: Sequence[tuple[Intrinsics, Coverage, Sequence[BoardView]]]
) -> None:
    """One page: of each camera where corners were seen, how far they were missed, how the lens
    bends."""
    parts = [_section(*camera) for camera in cameras]
    with storage_errors(path):
        write_text(
            path,
            f"<!doctype html><meta charset=utf-8><title>Cameras</title><style>{_STYLE}</style>"
            f"<h1>Cameras</h1>{''.join(parts)}\n",
        )


def _section(found: Intrinsics, covered: Coverage, views: Sequence[BoardView]) -> str:
    c = found.camera
    numbers = [
        ("views", f"{len(views)}, of which {int((~found.used).sum())} were left out"),
        ("error", f"{found.error:.3f} px, root mean square"),
        ("focal length", f"{c.focal[0]:.1f} x {c.focal[1]:.1f} px, +- {found.sigma[0]:.1f}"),
        ("centre", f"{c.matrix[0, 2]:.1f}, {c.matrix[1, 2]:.1f} px, +- {found.sigma[2]:.1f}"),
        ("distortion", ", ".join(f"{x:.4f}" for x in c.distortions)),
        ("covered", f"{covered.fraction:.0%} of the picture"),
    ]
    rows = "".join(f"<tr><th>{a}<td style='text-align:left'>{escape(b)}" for a, b in numbers)
    hints = "".join(f"<li>{escape(h)}" for h in covered.hints)
    todo = f"<p>What would make it better:<ul>{hints}</ul>" if hints else ""
    return (
        f"<h2>{escape(c.name)}, {c.size[0]} x {c.size[1]}</h2><table>{rows}</table>{todo}"
        f"<h3>Corners of the board, by view</h3>{_corners(found, views)}"
        f"<p>Blue: views that fit; red: views that were left out. Straight lines in the world are"
        f" the grey lines in the picture.</p><h3>Error by view</h3>{_bars(found)}"
    )


def _corners(found: Intrinsics, views: Sequence[BoardView]) -> str:
    w, h = found.camera.size
    k = _WIDTH / w
    dots = []
    for view, used in zip(views, found.used, strict=True):
        color = "#27c" if used else "#d22"
        dots += [f"<circle cx={x * k:.1f} cy={y * k:.1f} r=2 fill={color} />"
                 for x, y in view.corners]  # fmt: skip
    return (
        f"<svg width={_WIDTH} height={h * k:.0f}>{_lattice(found.camera, k)}{''.join(dots)}</svg>"
    )


def _lattice(camera: Camera, k: float) -> str:
    """Straight lines as the lens bends them."""
    w, h = camera.size
    edge = camera.to_plane(np.array([[0.0, h / 2], [w, h / 2], [w / 2, 0.0], [w / 2, h]]))
    if not np.isfinite(edge).all():
        return ""
    x0, x1, y0, y1 = edge[0, 0], edge[1, 0], edge[2, 1], edge[3, 1]
    lines = []
    for s in np.linspace(0, 1, 9):
        t = np.linspace(0, 1, 40)
        for x, y in (
            (np.full(40, x0 + s * (x1 - x0)), y0 + t * (y1 - y0)),
            (x0 + t * (x1 - x0), np.full(40, y0 + s * (y1 - y0))),
        ):
            p = camera.to_pixels(np.column_stack([x, y])) * k
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in p)
            lines.append(f'<polyline points="{points}" fill=none stroke=#bbb />')
    return "".join(lines)


def _bars(found: Intrinsics) -> str:
    most = float(np.max(np.where(np.isfinite(found.errors), found.errors, 0.0), initial=0.1))
    n = len(found.errors)
    step = _WIDTH / max(n, 1)
    bars = []
    for i, (error, used) in enumerate(zip(found.errors, found.used, strict=True)):
        tall = 120 * min(error / most, 1.0)
        bars.append(
            f"<rect x={i * step + 1:.1f} y={130 - tall:.1f} width={max(step - 2, 1):.1f}"
            f" height={tall:.1f} fill={'#27c' if used else '#d22'}><title>view {i + 1}:"
            f" {error:.3f} px, tilt {found.tilt[i]:.0f} degrees</title></rect>"
        )
    return (
        f"<svg width={_WIDTH} height=150>{''.join(bars)}<text x=4 y=14 font-size=12>"
        f"{most:.2f} px</text></svg>"
    )
