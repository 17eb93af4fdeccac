"""The connector bay: a rectangular recess in the skin in which all wires end."""

from __future__ import annotations

import igl
import numpy as np

from ...core.arrays import Bool, Float, format_point
from ...core.device.device import BaySpec
from ...core.errors import BodyError
from ...core.mesh import Surface
from ..kernels import surface_queries
from ..kernels.cutting_tools import Prism, upright

#: A bay's point may lie this far from the skin, mm.
_FAR = 5.0
#: Least wall behind and beside a bay, mm; near its rim it may thin out as steeply as `_SLOPE`.
_WALL, _SLOPE = 1.2, 0.6
_BEYOND = 1.0  # mm, that the recess goes on above the skin
_STEP = 0.5  # mm, between points of its floor and walls
_COLUMNS = 11  # in which the skin is looked at along and across the opening
_ALIKE = np.cos(np.radians(40))  # of normals that belong to the opening's face


def recess(spec: BaySpec, body: Surface) -> Prism:
    """What is cut out of the body: from `spec.size[2]` mm below the lowest skin within the opening
    to just above the highest, its y axis as far up as the skin's normal allows.

    Raises BodyError where the point is not on the skin, the skin there is too curved, something
    lies over it, or the bay would break through elsewhere.
    """
    width, height, depth = spec.size
    if max(spec.size) > np.linalg.norm(np.ptp(body.bounds, axis=0)):
        raise BodyError(
            f"[body.bay] size: {width:g} x {height:g} x {depth:g} mm is larger than the body",
            code="bay-too-large",
        )
    center, normal = _skin_at(spec, body)
    axes = upright(normal)
    half = np.array([width, height]) / 2
    low, high = _heights(body, center, axes, half, depth)
    polygon = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    made = Prism(
        center + (low - depth) * normal, axes, polygon, float(depth - low + high + _BEYOND)
    )
    _check(made, body, depth)
    return made


def inside(points: Float, bay: Prism, by: float = 0.0) -> Bool:
    """Which points (n, 3) mm lie in the bay, at least `by` mm from its walls and floor."""
    local = (points - bay.origin) @ bay.axes
    half = np.abs(bay.polygon).max(axis=0)
    aside = (np.abs(local[:, :2]) <= half - by).all(axis=1)
    return np.asarray(aside & (local[:, 2] >= by) & (local[:, 2] <= bay.height))


def in_solid(points: Float, bay: Prism | None) -> Float:
    """Those of the points (n, 3) that do not lie in a bay."""
    return points if bay is None else points[~inside(points, bay)]


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
            f"[body.bay] at: {format_point(spec.at)} is {away:.1f} mm from the skin, whose nearest point"
            f" is {format_point(center)}; give a point on the skin",
            code="bay-off-skin",
            distance=away,
        )
    a, b, c = body.vertices[body.faces[int(np.ravel(face)[0])]]
    own = np.cross(b - a, c - a)
    own /= np.linalg.norm(own)
    # The skin's mean direction under the opening: a single facet may lean anywhere.
    points, normals = surface_queries.samples(body, min(spec.size[:2]))
    local = np.abs((points - center) @ upright(own))
    under = (local <= [spec.size[0] / 2, spec.size[1] / 2, spec.size[2]]).all(axis=1)
    normal = normals[under & (normals @ own > _ALIKE)].sum(axis=0) + own
    return center, normal / np.linalg.norm(normal)


def _heights(
    body: Surface, center: Float, axes: Float, half: Float, depth: float
) -> tuple[float, float]:
    """The lowest and the highest skin within the opening, mm from its centre along the normal."""
    normal = axes[:, 2]
    grid = np.linspace(-1, 1, _COLUMNS)
    columns = np.stack(np.meshgrid(*(grid * h for h in half)), axis=-1).reshape(-1, 2)
    tops = center + columns @ axes[:, :2].T + depth * normal
    over = np.asarray(igl.fast_winding_number(body.vertices, body.faces, tops)) > 0.5
    heights = []
    for top, covered in zip(tops, over, strict=True):
        if covered or len(surface_queries.hits(top, normal, body)):
            raise BodyError(
                f"[body.bay]: the body lies over its opening near {format_point(top)}; choose a place that"
                " a connector can reach",
                code="bay-opening-covered",
                at=top.tolist(),
            )
        below = surface_queries.hits(top, -normal, body)
        heights.append(depth - float(below[0]) if len(below) else -np.inf)
    low, high = min(heights), max(heights)
    if high - low > depth / 2:
        fall = "ends" if np.isinf(low) else f"falls by {high - low:.1f} mm"
        raise BodyError(
            f"[body.bay]: the skin around {format_point(center)} {fall} under an opening of"
            f" {2 * half[0]:g} x {2 * half[1]:g} mm; choose a flatter place or a smaller size",
            code="bay-skin-uneven",
        )
    return low, high


def _check(bay: Prism, body: Surface, depth: float) -> None:
    """Whether the bay's floor and walls lie well inside of the body, but for their rim."""
    half = np.abs(bay.polygon).max(axis=0)
    x, y = (np.linspace(-h, h, int(2 * h / _STEP) + 2) for h in half)
    rim = np.concatenate([[[u, v] for u in x for v in (y[0], y[-1])],
                          [[u, v] for u in (x[0], x[-1]) for v in y]])  # fmt: skip
    floor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    levels = np.arange(_STEP, depth, _STEP)
    local = np.concatenate(
        [np.column_stack([floor, np.zeros(len(floor))])]
        + [np.column_stack([rim, np.full(len(rim), z)]) for z in levels]
    )
    points = bay.origin + local @ bay.axes.T
    square = igl.point_mesh_squared_distance(points, body.vertices, body.faces)[0]
    wall = np.sqrt(np.asarray(square))
    wall[np.asarray(igl.fast_winding_number(body.vertices, body.faces, points)) < 0.5] *= -1
    spare = wall - np.minimum(_WALL, _SLOPE * (depth - local[:, 2]))
    if spare.min() < -1e-6:
        k = int(spare.argmin())
        raise BodyError(
            f"[body.bay]: it leaves {max(0.0, float(wall[k])):.1f} mm of wall near"
            f" {format_point(points[k])}; {_WALL:g} mm is needed: choose another place or a smaller size",
            code="bay-wall-thin",
            wall=float(wall[k]),
            at=points[k].tolist(),
        )
