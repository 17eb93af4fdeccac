"""Place the connector bay: a rectangular recess in the skin in which all wires end."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool, Float, format_point
from ...core.device.device import BaySpec
from ...core.errors import BodyError
from ...core.mesh import Surface
from ..kernels.cutting_tools import Prism, upright_axes
from ..kernels.surface_queries import cast_ray, sample_skin, signed_distance_of

#: Largest distance of a bay's point from the skin.
MAX_SKIN_DISTANCE_MM = 5.0
#: Least wall behind and next to a bay; near the rim the wall may grow by only `RIM_SLOPE` per
#: depth.
MIN_WALL_MM, RIM_SLOPE = 1.2, 0.6
OVERSHOOT_MM = 1.0  # how far the recess continues above the skin
SAMPLE_STEP_MM = 0.5  # between checked points of floor and walls
OPENING_COLUMNS = 11  # of rays along and across the opening
MIN_FACE_COSINE = np.cos(np.radians(40))  # between normals of the same face


def place_bay(spec: BaySpec, body: Surface) -> Prism:
    """Place the connector bay of a device in its body.

    Args:
        spec: The `[body.bay]` section: a point near the skin, and width, height and depth, mm.
        body: Surface of the body without its bay.

    Returns:
        The prism to cut out: from `depth` below the lowest skin within the opening to just above
        the highest. Its z axis is the mean normal of the skin, its y axis as upright as that
        allows.

    Raises:
        BodyError: If the point is not on the skin, the skin there is too uneven, something covers
            the opening, or the walls would be too thin.
    """
    width, height, depth = spec.size
    if max(spec.size) > np.linalg.norm(np.ptp(body.bounds, axis=0)):
        raise BodyError(
            f"{width:g} x {height:g} x {depth:g} mm is larger than the body",
            code="bay-too-large",
            where="[body.bay] size",
            action="Give a smaller size",
        )
    center, normal = _find_skin(spec, body)
    axes = upright_axes(normal)
    half = np.array([width, height]) / 2
    low, high = _opening_heights(body, center, axes, half, depth)
    polygon = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    bay = Prism(
        center + (low - depth) * normal, axes, polygon, float(depth - low + high + OVERSHOOT_MM)
    )
    _check_walls(bay, body, depth)
    return bay


def is_in_bay(points: Float, bay: Prism, margin: float = 0.0) -> Bool:
    """Return which points lie in a bay.

    Args:
        points: Points (n, 3), mm.
        bay: The bay.
        margin: Least distance from the bay's walls and floor, mm.

    Returns:
        Flags (n,).
    """
    local = (points - bay.origin) @ bay.axes
    half = np.abs(bay.polygon).max(axis=0)
    is_between_walls = (np.abs(local[:, :2]) <= half - margin).all(axis=1)
    return np.asarray(is_between_walls & (local[:, 2] >= margin) & (local[:, 2] <= bay.height))


def outside_bay(points: Float, bay: Prism | None) -> Float:
    """Return the points (k, 3) of points (n, 3) that do not lie in a bay."""
    return points if bay is None else points[~is_in_bay(points, bay)]


def without_bay(body: Surface, bay: Prism) -> Surface:
    """Return the skin (an open surface) without the bay's walls and floor."""
    is_in = is_in_bay(body.vertices, bay, margin=-1e-3)
    return Surface(body.vertices, body.faces[~is_in[body.faces].all(axis=1)])


def _find_skin(spec: BaySpec, body: Surface) -> tuple[Float, Float]:
    """Return the point of the skin nearest to the bay's point, and the mean normal around it."""
    distances, faces, nearest = signed_distance_of(body).closest(spec.at[None])
    center, distance = nearest[0], float(distances[0])
    if distance > MAX_SKIN_DISTANCE_MM:
        raise BodyError(
            f"{format_point(spec.at)} is {distance:.1f} mm from the skin, whose nearest point is"
            f" {format_point(center)}",
            code="bay-off-skin",
            where="[body.bay] at",
            action="Give a point on the skin",
            distance=distance,
        )
    a, b, c = body.vertices[body.faces[faces[0]]]
    facet_normal = np.cross(b - a, c - a)
    facet_normal /= np.linalg.norm(facet_normal)
    # The mean direction of the skin under the opening: a single facet may lean anywhere.
    points, normals = sample_skin(body, min(spec.size[:2]))
    local = np.abs((points - center) @ upright_axes(facet_normal))
    under = (local <= [spec.size[0] / 2, spec.size[1] / 2, spec.size[2]]).all(axis=1)
    normal = normals[under & (normals @ facet_normal > MIN_FACE_COSINE)].sum(axis=0) + facet_normal
    return center, normal / np.linalg.norm(normal)


def _opening_heights(
    body: Surface, center: Float, axes: Float, half: Float, depth: float
) -> tuple[float, float]:
    """Return the lowest and highest skin within the opening, mm from its center along the
    normal.
    """
    normal = axes[:, 2]
    grid = np.linspace(-1, 1, OPENING_COLUMNS)
    columns = np.stack(np.meshgrid(*(grid * h for h in half)), axis=-1).reshape(-1, 2)
    tops = center + columns @ axes[:, :2].T + depth * normal
    is_covered = signed_distance_of(body).inside(tops)
    heights = []
    for top, is_top_covered in zip(tops, is_covered, strict=True):
        if is_top_covered or len(cast_ray(top, normal, body)):
            raise BodyError(
                f"the body covers its opening near {format_point(top)}",
                code="bay-opening-covered",
                where="[body.bay]",
                action="Choose a place that a connector can reach",
                at=top.tolist(),
            )
        below = cast_ray(top, -normal, body)
        heights.append(depth - float(below[0]) if len(below) else -np.inf)
    low, high = min(heights), max(heights)
    if high - low > depth / 2:
        defect = "ends" if np.isinf(low) else f"falls by {high - low:.1f} mm"
        raise BodyError(
            f"the skin around {format_point(center)} {defect} under an opening of"
            f" {2 * half[0]:g} x {2 * half[1]:g} mm",
            code="bay-skin-uneven",
            where="[body.bay]",
            action="Choose a flatter place or a smaller size",
        )
    return low, high


def _check_walls(bay: Prism, body: Surface, depth: float) -> None:
    """Raise BodyError if the bay's floor or walls are too near to the skin, except at their rim."""
    half = np.abs(bay.polygon).max(axis=0)
    x, y = (np.linspace(-h, h, int(2 * h / SAMPLE_STEP_MM) + 2) for h in half)
    rim = np.concatenate(
        [[[u, v] for u in x for v in (y[0], y[-1])], [[u, v] for u in (x[0], x[-1]) for v in y]]
    )
    floor = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    levels = np.arange(SAMPLE_STEP_MM, depth, SAMPLE_STEP_MM)
    local = np.concatenate(
        [np.column_stack([floor, np.zeros(len(floor))])]
        + [np.column_stack([rim, np.full(len(rim), z)]) for z in levels]
    )
    points = bay.origin + local @ bay.axes.T
    wall = signed_distance_of(body)(points)
    excess = wall - np.minimum(MIN_WALL_MM, RIM_SLOPE * (depth - local[:, 2]))
    if excess.min() < -1e-6:
        k = int(excess.argmin())
        raise BodyError(
            f"it leaves {max(0.0, float(wall[k])):.1f} mm of wall near"
            f" {format_point(points[k])}, and"
            f" {MIN_WALL_MM:g} mm is needed",
            code="bay-wall-thin",
            where="[body.bay]",
            action="Choose another place or a smaller size",
            wall=float(wall[k]),
            at=points[k].tolist(),
        )
