"""Off-screen pictures of a build: routing, strain sections, error maps, exploded parts."""

from __future__ import annotations

import base64
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # Without a screen VTK tries X first and complains; EGL needs none.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import numpy as np
import pyvista as pv

from ...core.arrays import Float
from ...core.files import replacing
from ...core.mesh import Surface
from ..artifacts.layout import WeighedRecord
from .colors import COLORS as COLORS

_SIZE = (1100, 620)
_FEWEST = 2  # layouts, for a picture of their errors


def _plotter() -> Any:
    plotter = pv.Plotter(off_screen=True, window_size=list(_SIZE), lighting="light kit")
    plotter.set_background("white")
    return plotter


def _poly(surface: Surface) -> Any:
    faces = np.concatenate([np.full((len(surface.faces), 1), 3), surface.faces], axis=1)
    return pv.PolyData(surface.vertices, faces.ravel())


def _finish(plotter: Any, view: Float, up: Float | None = None, zoom: float = 1.25) -> str:
    """PNG as a data URI; `view` is the direction from the object to the camera."""
    if up is None:
        up = np.array([0, 0, 1.0] if abs(view[2]) < 0.9 else [0, 1.0, 0])
    plotter.view_vector(tuple(view), viewup=tuple(up))
    plotter.enable_parallel_projection()
    plotter.reset_camera()
    plotter.camera.zoom(zoom)
    plotter.add_axes()
    image = plotter.screenshot(return_img=True)
    plotter.close()
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _bar(title: str) -> dict[str, Any]:
    return {
        "title": title + "\n",  # the bar draws its title onto its labels
        "color": "black",
        "title_font_size": 24,
        "label_font_size": 20,
        "fmt": "%.3g",
        "position_x": 0.25,
        "width": 0.5,
        "height": 0.1,
        "position_y": 0.03,
    }


def routing(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float, view: Float
) -> str:
    """The body with its cords; the paths as drawn are thin and grey."""
    plotter = _plotter()
    body = _poly(surface)
    plotter.add_mesh(body, color="#c9d6df", opacity=0.25, smooth_shading=False)
    edges = body.extract_feature_edges(30, boundary_edges=False, non_manifold_edges=False)
    if edges.n_points:
        plotter.add_mesh(edges, color="#52616b", line_width=1.5)
    for path in drawn:
        plotter.add_mesh(pv.lines_from_points(path), color="#777777", line_width=2)
    for i, path in enumerate(cords):
        plotter.add_mesh(
            pv.lines_from_points(path).tube(radius=radius), color=COLORS[i % len(COLORS)]
        )
    return _finish(plotter, view)


def front(trials: Sequence[WeighedRecord]) -> str | None:
    """The layouts made on trial as points: error against parts; PNG as a data URI, or None where
    fewer than two could be made."""
    made = [t for t in trials if t.built is not None and t.parts is not None]
    if len(made) < _FEWEST:
        return None
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.5, 3.6), dpi=110, layout="constrained")
    axis = figure.subplots()
    for clear, label, face in ((True, "nothing to say of the parts", None), (False, "notes", "w")):
        some = [t for t in made if (not t.warnings) == clear]
        if some:
            x, y = _places(some)
            axis.scatter(x, y, s=60, edgecolor=COLORS[1], facecolor=face or COLORS[1], label=label)
    x, y = _places([t for t in made if t.chosen])
    axis.scatter(x, y, s=220, facecolor="none", edgecolor=COLORS[0], linewidth=2, label="taken")
    axis.set(xlabel="parts", ylabel="RMSE on unseen states, mm")
    axis.margins(x=0.15)
    axis.set_ylim(0, 1.15 * float(_places(made)[1].max()))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axis.grid(True, alpha=0.25)
    axis.legend(fontsize="small")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _places(trials: Sequence[WeighedRecord]) -> Float:
    """Parts and errors of trials (2, t)."""
    return np.array([(t.parts, t.built) for t in trials], float).reshape(-1, 2).T


def strain_section(field: Path, name: str, origin: Float, normal: Float, top: float) -> str:
    """A deformed section coloured by the largest principal strain, in per cent."""
    grid = pv.read(field)
    grid.point_data["strain %"] = 100 * grid.point_data["strain"]
    cut = grid.slice(normal=normal, origin=origin)
    plotter = _plotter()
    outline = grid.extract_surface(algorithm="dataset_surface").warp_by_vector("displacement")
    plotter.add_mesh(outline, color="#c9d6df", opacity=0.15)
    plotter.add_mesh(
        cut.warp_by_vector("displacement"),
        scalars="strain %",
        cmap="viridis",
        clim=[0, top],
        scalar_bar_args=_bar("largest principal strain (%)"),
    )
    plotter.add_text(name, color="black", font_size=16, position="upper_left")
    return _finish(plotter, normal * np.array([1, -1, 1]))


def error_map(surface: Surface, error: Float, name: str, view: Float, top: float) -> str:
    """The deformed surface coloured by the reconstruction error (mm) at its vertices (n,)."""
    plotter = _plotter()
    body = _poly(surface)
    body.point_data["error"] = error
    plotter.add_mesh(
        body,
        scalars="error",
        cmap="magma",
        clim=[0, top],
        scalar_bar_args=_bar("reconstruction error (mm)"),
        smooth_shading=False,
    )
    plotter.add_text(name, color="black", font_size=16, position="upper_left")
    return _finish(plotter, view)


def modes(shapes: list[tuple[str, Float]], faces: Any, rest: Float, path: Path) -> None:
    """Moved bodies (title, vertices (n, 3)) side by side over the outline at rest, as a PNG."""
    columns = 2
    rows = -(-max(len(shapes), 1) // columns)
    plotter = pv.Plotter(off_screen=True, shape=(rows, columns), window_size=[1200, 420 * rows])
    plotter.set_background("white")
    long = int(np.ptp(rest, axis=0).argmax())
    view = (1.0, 0.35, 0.55) if long == 1 else (0.35, -1.0, 0.55)
    for i, (title, moved) in enumerate(shapes):
        plotter.subplot(i // columns, i % columns)
        plotter.add_mesh(_poly(Surface(rest, faces)), color="#dde3e8", opacity=0.35)
        body = _poly(Surface(moved, faces))
        body["movement"] = np.linalg.norm(moved - rest, axis=1)
        plotter.add_mesh(body, scalars="movement", cmap="viridis", show_scalar_bar=False)
        plotter.add_text(title, font_size=12, color="black")
        plotter.view_vector(view, viewup=(0, 0, 1))
        plotter.reset_camera()
    with replacing(path) as temporary:
        plotter.screenshot(str(temporary))
    plotter.close()
