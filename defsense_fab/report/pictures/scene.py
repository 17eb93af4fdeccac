"""Solids and lines drawn off-screen by VTK, from any side, so that they fill their picture."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from types import TracebackType
from typing import Any

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # Without a screen VTK tries X first and complains; EGL needs none.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import numpy as np
import pyvista as pv
from scipy import sparse
from scipy.sparse import csgraph

from ...core.arrays import Bool, Float
from ...core.mesh import Surface
from .views import View

_MARGIN = 3  # pixels around all that is drawn
_EDGE = 30  # degrees between facets, from which on their edge is drawn
_CHAIN = 0.2  # of a body's size: over which edges have to hang together, to be drawn
_LINE = "#3c4a54"
_WHITE = 252  # of 255: what is darker is taken to be drawn
_LOOK = ("color", "ambient", "diffuse", "lighting", "opacity")


@dataclass(frozen=True)
class Shot:
    """What a scene looks like from a `view`: `image` (h, w, 3), `scale` in pixels a mm, and the
    point of the view's plane (2,) mm that is at the image's top left."""

    image: Any
    view: View
    scale: float
    corner: Float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.image.shape[1], self.image.shape[0]

    def pixel(self, points: Float) -> Float:
        """Where points (n, 3) mm are in the image: (n, 2) pixels to the right and down."""
        return np.asarray((self.view.flat(points) - self.corner) * [1.0, -1.0] * self.scale)


class Scene:
    """What is to be drawn, in the rest frame in mm. Use it in a `with` block: it holds memory of
    the graphics library until it is closed. All of it fits into every picture of it."""

    def __init__(self) -> None:
        self._plotter: Any = pv.Plotter(off_screen=True, lighting="none")
        self._plotter.set_background("white")
        for place, strength in (((-0.5, 0.8, 1.0), 0.75), ((1.0, 0.0, 0.6), 0.35)):
            light = pv.Light(position=place, intensity=strength, light_type="camera light")
            self._plotter.add_light(light)
        self._plotter.enable_parallel_projection()
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
        self._plotter.close()

    def solid(
        self,
        surface: Surface,
        color: str,
        opacity: float = 1.0,
        edges: bool = True,
        name: str = "",
    ) -> None:
        """A body in one colour with its sharp edges; what has a `name` can be found by `seen`."""
        mesh = poly(surface)
        self.mesh(
            mesh, surface.vertices, name, color=color, opacity=opacity, split_sharp_edges=True
        )
        if edges:
            self._edges(mesh, 1.5)

    def outline(self, surface: Surface, color: str = "#8fa3b0", opacity: float = 0.12) -> None:
        """A body that is there, and through which one sees."""
        mesh = poly(surface)
        self.mesh(mesh, surface.vertices, color=color, opacity=opacity, ambient=0.6, diffuse=0.4)
        self._edges(mesh, 1.0)

    def colored(self, mesh: Any, scalars: str, colors: str, top: float, lit: bool = True) -> None:
        """A pyvista mesh coloured by one of its arrays from 0 to `top`; where it is `lit`, shades
        are faint, so that colours can be compared with the bar."""
        shading = {"ambient": 0.8, "diffuse": 0.25} if lit else {"lighting": False}
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
        """A line (p, 3) mm as a round cord."""
        tube = pv.lines_from_points(line).tube(radius=radius)
        self.mesh(tube, np.asarray(tube.points, float), name, color=color)

    def line(self, line: Float, color: str, width: float = 2.0) -> None:
        """A thin line (p, 3) mm, `width` in pixels."""
        self.mesh(pv.lines_from_points(line), line, color=color, line_width=width, lighting=False)

    def cylinder(
        self, center: Float, axis: Float, diameter: float, length: float, color: str, name: str = ""
    ) -> None:
        """A round pin."""
        pin = pv.Cylinder(center=center, direction=axis, radius=diameter / 2, height=length)
        self.mesh(pin, np.asarray(pin.points, float), name, color=color, split_sharp_edges=True)

    def mesh(self, mesh: Any, points: Float, name: str = "", **options: Any) -> None:
        """Any pyvista mesh with options of `Plotter.add_mesh`; `points` (n, 3) mm are to fit."""
        shading = {"ambient": 0.45, "diffuse": 0.7}
        actor = self._plotter.add_mesh(mesh, render=False, **(shading | options))
        self._points.append(np.asarray(points, float).reshape(-1, 3))
        if name:
            self._named.setdefault(name, []).append(actor)

    def _image(self) -> Any:
        self._plotter.render()  # what has changed since the picture before
        return np.array(self._plotter.screenshot(return_img=True))

    def _edges(self, mesh: Any, width: float) -> None:
        edges = _long_edges(mesh)
        if edges is not None:
            self._plotter.add_mesh(
                edges, color=_LINE, line_width=width, lighting=False, render=False
            )

    def extent(self, view: View) -> Float:
        """Lowest and highest place of all that is drawn, as seen: (2, 2) mm."""
        flat = view.flat(np.concatenate(self._points))
        return np.array([flat.min(0), flat.max(0)])

    def shot(self, view: View, width: float, height: float) -> Shot:
        """The scene as large as fits into so many pixels; the image has no empty margins."""
        low, high = self.extent(view)
        room = np.array([width, height], float) - 2 * _MARGIN
        scale = float((room / np.maximum(high - low, 1e-6)).min())
        size = np.ceil((high - low) * scale).astype(int) + 2 * _MARGIN
        middle = (low + high) / 2
        points = np.concatenate(self._points)
        depth = points @ view.back
        focus = middle[0] * view.right + middle[1] * view.up + depth.mean() * view.back
        far = 2 * float(np.ptp(depth)) + 10
        self._plotter.window_size = [int(size[0]), int(size[1])]
        camera = self._plotter.camera
        camera.focal_point = tuple(focus)
        camera.position = tuple(focus + far * view.back)
        camera.up = tuple(view.up)
        camera.parallel_scale = size[1] / scale / 2
        self._plotter.renderer.ResetCameraClippingRange()
        image = _outlined(self._image())
        corner = middle + np.array([-0.5, 0.5]) * size / scale
        return Shot(image, view, scale, corner)

    def seen(self) -> dict[str, Bool]:
        """Where in the last shot each thing with a name is seen, (h, w)."""
        kept = []
        codes = {name: 20 + 40 * (i % 6) for i, name in enumerate(self._named)}
        rows = {name: 20 + 40 * (i // 6) for i, name in enumerate(self._named)}
        colors = {
            id(a): (codes[n] / 255, rows[n] / 255, 1.0) for n, some in self._named.items()
            for a in some
        }  # fmt: skip
        for actor in self._plotter.renderer.actors.values():
            look = actor.prop
            kept.append((actor, {k: getattr(look, k) for k in _LOOK}, actor.visibility))
            if id(actor) in colors:
                # Without lighting what is seen is the sum of both.
                look.color, look.ambient, look.diffuse = colors[id(actor)], 0.0, 1.0
                look.lighting, look.opacity = False, 1.0
            else:
                actor.visibility = False
        image = self._image().astype(int)
        for actor, look, visible in kept:
            for key, value in look.items():
                setattr(actor.prop, key, value)
            actor.visibility = visible
        return {n: (np.abs(image - [codes[n], rows[n], 255]).max(2) <= 1) for n in self._named}


def poly(surface: Surface) -> Any:
    """A surface as a pyvista mesh. It is not thinned out: drawing 100,000 triangles takes less than
    thinning them."""
    faces = np.concatenate([np.full((len(surface.faces), 1), 3), surface.faces], axis=1)
    return pv.PolyData(surface.vertices, faces.ravel())


def _long_edges(mesh: Any) -> Any:
    """The sharp edges of a mesh that hang together over some length: not those of single facets of
    a round body. None where there are none."""
    edges = mesh.extract_feature_edges(
        _EDGE, boundary_edges=False, non_manifold_edges=False, manifold_edges=False
    )
    if not edges.n_cells:
        return None
    points = np.asarray(edges.points)
    pairs = edges.lines.reshape(-1, 3)[:, 1:]
    shape = (len(points), len(points))
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape)
    piece = csgraph.connected_components(graph, directed=False)[1][pairs[:, 0]]
    low, high = (np.full((piece.max() + 1, 3), s * np.inf) for s in (1, -1))
    np.minimum.at(low, piece, points[pairs].min(1))
    np.maximum.at(high, piece, points[pairs].max(1))
    size = np.linalg.norm(np.ptp(np.asarray(mesh.points), axis=0))
    kept = np.linalg.norm(high - low, axis=1)[piece] > _CHAIN * size
    if not kept.any():
        return None
    lines = np.column_stack([np.full(kept.sum(), 2), pairs[kept]])
    return pv.PolyData(points, lines=lines.ravel())


def _outlined(image: Any) -> Any:
    """With a thin dark line where what is drawn meets the white around it, so that pale colours
    have an edge."""
    drawn = np.pad(image.min(axis=2) < _WHITE, 1)
    around = drawn[:-2, 1:-1] & drawn[2:, 1:-1] & drawn[1:-1, :-2] & drawn[1:-1, 2:]
    edge = drawn[1:-1, 1:-1] & ~around
    image[edge] = image[edge] // 2 + 30
    return image
