"""The connector bay: a rectangular recess in the skin in which all wires end."""

from __future__ import annotations

import igl
import numpy as np

from ..core.arrays import Bool, Float, place
from ..core.device import BaySpec
from ..core.errors import BodyError
from ..core.mesh import Surface
from . import skin
from .tools import Prism, upright

#: A bay's point may lie this far from the skin, mm.
_FAR = 5.0
#: Least wall behind and beside a bay, mm.
_WALL = 1.2
_BEYOND = 1.0  # mm, that the recess goes on above the skin
_STEP = 0.5  # mm, between points of the floor


def recess(spec: BaySpec, body: Surface) -> Prism:
    """What is cut out of the body: from `spec.size[2]` mm below the lowest skin within the opening
    to just above the highest, its y axis as far up as the skin's normal allows.

    Raises BodyError where the point is not on the skin, the skin there is too curved, or the bay
    would break through elsewhere.
    """
    width, height, depth = spec.size
    center, normal = _skin_at(spec, body)
    axes = upright(normal)
    points, normals = skin.samples(body, min(width, height))
    near = (points - center) @ axes
    over = (np.abs(near[:, :2]) < [width / 2, height / 2]).all(axis=1)
    over &= (np.abs(near[:, 2]) < 2 * depth) & (normals @ normal > 0)
    low = min(0.0, float(near[over, 2].min(initial=0.0)))
    high = max(0.0, float(near[over, 2].max(initial=0.0)))
    if high - low > depth:
        raise BodyError(
            f"[body.bay]: the skin around {place(center)} rises by {high - low:.1f} mm under an"
            f" opening of {width:g} x {height:g} mm; choose a flatter place or a smaller size"
        )
    half = np.array([width, height]) / 2
    polygon = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    made = Prism(
        center + (low - depth) * normal, axes, polygon, float(depth - low + high + _BEYOND)
    )
    _check(made, body)
    return made


def inside(points: Float, bay: Prism, by: float = 0.0) -> Bool:
    """Which points (n, 3) mm lie in the bay, at least `by` mm from its walls and floor."""
    local = (points - bay.origin) @ bay.axes
    half = np.abs(bay.polygon).max(axis=0)
    aside = (np.abs(local[:, :2]) <= half - by).all(axis=1)
    return np.asarray(aside & (local[:, 2] >= by) & (local[:, 2] <= bay.height))


def without_bay(body: Surface, bay: Prism) -> Surface:
    """The skin (an open surface) without the bay's walls and floor."""
    within = inside(body.vertices, bay, by=-1e-3)
    return Surface(body.vertices, body.faces[~within[body.faces].all(axis=1)])


def _skin_at(spec: BaySpec, body: Surface) -> tuple[Float, Float]:
    """The point of the skin nearest to the spec's, and the normal there."""
    square, face, nearest = igl.point_mesh_squared_distance(
        spec.at[None], body.vertices, body.faces
    )
    center = np.asarray(nearest).reshape(3)
    away = float(np.sqrt(np.ravel(square)[0]))
    if away > _FAR:
        raise BodyError(
            f"[body.bay] at: {place(spec.at)} is {away:.1f} mm from the skin, whose nearest point"
            f" is {place(center)}; give a point on the skin"
        )
    a, b, c = body.vertices[body.faces[int(np.ravel(face)[0])]]
    own = np.cross(b - a, c - a)
    points, normals = skin.samples(body, min(spec.size[:2]))
    # The skin's mean direction under the opening: a single facet may lean anywhere.
    close = np.linalg.norm(points - center, axis=1) < np.hypot(*spec.size[:2]) / 2
    close &= normals @ own > 0
    normal = normals[close].sum(axis=0) if close.any() else own
    return center, normal / np.linalg.norm(normal)


def _check(bay: Prism, body: Surface) -> None:
    """Whether the bay's floor lies well inside of the body."""
    half = np.abs(bay.polygon).max(axis=0)
    x, y = (np.linspace(-h, h, int(2 * h / _STEP) + 2) for h in half)
    floor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = bay.origin + floor @ bay.axes[:, :2].T
    depth = np.sqrt(
        np.asarray(igl.point_mesh_squared_distance(points, body.vertices, body.faces)[0])
    )
    outside = np.asarray(igl.fast_winding_number(body.vertices, body.faces, points)) < 0.5
    depth[outside] *= -1
    if depth.min() < _WALL:
        at = points[int(depth.argmin())]
        raise BodyError(
            f"[body.bay]: it leaves {max(0.0, float(depth.min())):.1f} mm of wall near {place(at)};"
            f" {_WALL:g} mm is needed: choose another place or a smaller size"
        )
