"""Render solids and lines off-screen with VTK from any direction, so that they fill the picture."""

from __future__ import annotations

import os
import sys
import threading
from dataclasses import dataclass
from types import TracebackType
from typing import Any

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # Without a screen, VTK tries X first and prints errors; EGL needs no screen.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import numpy as np
import pyvista as pv
from scipy import sparse
from scipy.sparse import csgraph

from ...core.arrays import Bool, Float
from ...core.mesh import Surface
from .views import View

_MARGIN_PX = 3  # around all shapes
_MIN_EDGE_ANGLE_DEG = 30  # between two facets, above which their edge is drawn
_MIN_CHAIN_LENGTH = 0.2  # share of a body's size, below which a chain of edges is not drawn
_EDGE_COLOR = "#3c4a54"
_MAX_SHAPE_BRIGHTNESS = 252  # of 255: brighter pixels are background
_APPEARANCE_FIELDS = ("color", "ambient", "diffuse", "lighting", "opacity")


@dataclass(frozen=True)
class Shot:
    """A rendered picture of a scene.

    Attributes:
        image: Pixels (h, w, 3).
        view: The view.
        scale: Scale, pixels per mm.
        corner: Point (2,) of the view's plane at the top left of the image, mm.
    """

    image: Any
    view: View
    scale: float
    corner: Float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.image.shape[1], self.image.shape[0]

    def pixel(self, points: Float) -> Float:
        """Return the pixels (n, 2), to the right and down, of points (n, 3) mm."""
        return np.asarray((self.view.flat(points) - self.corner) * [1.0, -1.0] * self.scale)


class _Plotters(threading.local):
    """Plotters of this thread that no scene uses. A new one would compile all shaders again."""

    def __init__(self) -> None:
        self._free: list[Any] = []

    def take(self) -> Any:
        if self._free:
            return self._free.pop()
        plotter = pv.Plotter(off_screen=True, lighting="none")
        plotter.set_background("white")
        for place, strength in (((-0.5, 0.8, 1.0), 0.75), ((1.0, 0.0, 0.6), 0.35)):
            light = pv.Light(position=place, intensity=strength, light_type="camera light")
            plotter.add_light(light)
        plotter.enable_parallel_projection()
        return plotter

    def give_back(self, plotter: Any) -> None:
        if threading.current_thread() is threading.main_thread():
            plotter.clear_actors()
            self._free.append(plotter)
        else:  # PyVista would keep the plotter when the thread has ended
            plotter.close()


_plotters = _Plotters()


class Scene:
    """Shapes in the rest frame in mm, to be rendered from any direction.

    Use it in a `with` block: the next scene uses the same window. Every picture holds all shapes.
    """

    def __init__(self) -> None:
        self._plotter: Any = _plotters.take()
        self._points: list[Float] = []
        self._named: dict[str, list[Any]] = {}

    def __enter__(self) -> Scene:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        _plotters.give_back(self._plotter)

    def solid(
        self, surface: Surface, color: str, opacity: float = 1.0, edges: bool = True, name: str = ""
    ) -> None:
        """Add a body in one color, with its sharp edges.

        Args:
            surface: Surface of the body.
            color: Color.
            opacity: Opacity, 0 to 1.
            edges: Whether to draw sharp edges.
            name: Name by which `visible_areas` finds the body.
        """
        mesh = poly(surface)
        self.mesh(
            mesh, surface.vertices, name, color=color, opacity=opacity, split_sharp_edges=True
        )
        if edges:
            self._edges(mesh, 1.5)

    def outline(self, surface: Surface, color: str = "#8fa3b0", opacity: float = 0.12) -> None:
        """Add a body that is nearly transparent, so that shapes inside it are visible."""
        mesh = poly(surface)
        self.mesh(mesh, surface.vertices, color=color, opacity=opacity, ambient=0.6, diffuse=0.4)
        self._edges(mesh, 1.0)

    def colored(
        self, mesh: Any, scalars: str, colors: str, top: float, is_shaded: bool = True
    ) -> None:
        """Add a pyvista mesh colored by one of its arrays.

        Args:
            mesh: The mesh.
            scalars: Name of the array.
            colors: Name of a matplotlib color map.
            top: Value of the last color; the first one is 0.
            is_shaded: Whether to shade the mesh, faintly, so that colors match the color bar.
        """
        shading = {"ambient": 0.8, "diffuse": 0.25} if is_shaded else {"lighting": False}
        self.mesh(
            mesh,
            np.asarray(mesh.points, float),
            scalars=scalars,
            cmap=colors,
            clim=[0, top],
            show_scalar_bar=False,
            **shading,
        )

    def tube(self, line: Float, color: str, radius: float, name: str = "") -> None:
        """Add a round cord along a line (p, 3), mm."""
        tube = pv.lines_from_points(line).tube(radius=radius)
        self.mesh(tube, np.asarray(tube.points, float), name, color=color)

    def line(self, line: Float, color: str, width: float = 2.0) -> None:
        """Add a thin line (p, 3) mm, `width` pixels wide."""
        self.mesh(pv.lines_from_points(line), line, color=color, line_width=width, lighting=False)

    def cylinder(
        self, center: Float, axis: Float, diameter: float, length: float, color: str, name: str = ""
    ) -> None:
        """Add a cylinder, such as a pin."""
        pin = pv.Cylinder(center=center, direction=axis, radius=diameter / 2, height=length)
        self.mesh(pin, np.asarray(pin.points, float), name, color=color, split_sharp_edges=True)

    def mesh(self, mesh: Any, points: Float, name: str = "", **options: Any) -> None:
        """Add a pyvista mesh with options of `Plotter.add_mesh`; pictures hold `points` (n, 3)."""
        shading = {"ambient": 0.45, "diffuse": 0.7}
        actor = self._plotter.add_mesh(mesh, render=False, **(shading | options))
        self._points.append(np.asarray(points, float).reshape(-1, 3))
        if name:
            self._named.setdefault(name, []).append(actor)

    def _image(self) -> Any:
        self._plotter.render()  # applies changes since the last picture
        return np.array(self._plotter.screenshot(return_img=True))

    def _edges(self, mesh: Any, width: float) -> None:
        edges = _long_edges(mesh)
        if edges is not None:
            self._plotter.add_mesh(
                edges, color=_EDGE_COLOR, line_width=width, lighting=False, render=False
            )

    def extent(self, view: View) -> Float:
        """Return the lowest and highest place (2, 2) of all shapes in a view, mm."""
        flat = view.flat(np.concatenate(self._points))
        return np.array([flat.min(0), flat.max(0)])

    def shot(self, view: View, width: float, height: float) -> Shot:
        """Render the scene as large as it fits; the image has no empty margins.

        Args:
            view: The view.
            width: Largest width, pixels.
            height: Largest height, pixels.

        Returns:
            The picture.
        """
        low, high = self.extent(view)
        available = np.array([width, height], float) - 2 * _MARGIN_PX
        scale = float((available / np.maximum(high - low, 1e-6)).min())
        size = np.ceil((high - low) * scale).astype(int) + 2 * _MARGIN_PX
        middle = (low + high) / 2
        points = np.concatenate(self._points)
        depth = points @ view.back
        focus = middle[0] * view.right + middle[1] * view.up + depth.mean() * view.back
        distance = 2 * float(np.ptp(depth)) + 10
        # `Plotter.window_size` would render the scene from the old direction.
        self._plotter.render_window.SetSize(int(size[0]), int(size[1]))
        camera = self._plotter.camera
        camera.focal_point = tuple(focus)
        camera.position = tuple(focus + distance * view.back)
        camera.up = tuple(view.up)
        camera.parallel_scale = size[1] / scale / 2
        self._plotter.renderer.ResetCameraClippingRange()
        image = _darken_outline(self._image())
        corner = middle + np.array([-0.5, 0.5]) * size / scale
        return Shot(image, view, scale, corner)

    def visible_areas(self) -> dict[str, Bool]:
        """Return the pixels (h, w) of the last picture in which each named shape is visible."""
        saved = []
        codes = {name: 20 + 40 * (i % 6) for i, name in enumerate(self._named)}
        rows = {name: 20 + 40 * (i // 6) for i, name in enumerate(self._named)}
        colors = {
            id(a): (codes[n] / 255, rows[n] / 255, 1.0)
            for n, actors in self._named.items()
            for a in actors
        }
        for actor in self._plotter.renderer.actors.values():
            appearance = actor.prop
            saved.append(
                (actor, {k: getattr(appearance, k) for k in _APPEARANCE_FIELDS}, actor.visibility)
            )
            if id(actor) in colors:
                # Without lighting, the color is the sum of ambient and diffuse.
                appearance.color, appearance.ambient, appearance.diffuse = (
                    colors[id(actor)],
                    0.0,
                    1.0,
                )
                appearance.lighting, appearance.opacity = False, 1.0
            else:
                actor.visibility = False
        image = self._image().astype(int)
        for actor, appearance, visible in saved:
            for key, value in appearance.items():
                setattr(actor.prop, key, value)
            actor.visibility = visible
        return {n: (np.abs(image - [codes[n], rows[n], 255]).max(2) <= 1) for n in self._named}


def poly(surface: Surface) -> Any:
    """Convert a surface to a pyvista mesh.

    The mesh is not decimated: drawing 100,000 triangles is faster than removing them.
    """
    faces = np.concatenate([np.full((len(surface.faces), 1), 3), surface.faces], axis=1)
    return pv.PolyData(surface.vertices, faces.ravel())


def _long_edges(mesh: Any) -> Any:
    """Return the sharp edges of a mesh that form long chains, or None if there are none.

    Sharp edges of single facets of a round body are left out.
    """
    edges = mesh.extract_feature_edges(
        _MIN_EDGE_ANGLE_DEG, boundary_edges=False, non_manifold_edges=False, manifold_edges=False
    )
    if not edges.n_cells:
        return None
    points = np.asarray(edges.points)
    pairs = edges.lines.reshape(-1, 3)[:, 1:]
    shape = (len(points), len(points))
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape)
    chain = csgraph.connected_components(graph, directed=False)[1][pairs[:, 0]]
    low, high = (np.full((chain.max() + 1, 3), s * np.inf) for s in (1, -1))
    np.minimum.at(low, chain, points[pairs].min(1))
    np.maximum.at(high, chain, points[pairs].max(1))
    size = np.linalg.norm(np.ptp(np.asarray(mesh.points), axis=0))
    is_long = np.linalg.norm(high - low, axis=1)[chain] > _MIN_CHAIN_LENGTH * size
    if not is_long.any():
        return None
    lines = np.column_stack([np.full(is_long.sum(), 2), pairs[is_long]])
    return pv.PolyData(points, lines=lines.ravel())


def _darken_outline(image: Any) -> Any:
    """Darken the border between shapes and the white background, for pale colors."""
    is_shape = np.pad(image.min(axis=2) < _MAX_SHAPE_BRIGHTNESS, 1)
    is_surrounded = (
        is_shape[:-2, 1:-1] & is_shape[2:, 1:-1] & is_shape[1:-1, :-2] & is_shape[1:-1, 2:]
    )
    is_edge = is_shape[1:-1, 1:-1] & ~is_surrounded
    image[is_edge] = image[is_edge] // 2 + 30
    return image
