"""Detect from its shape how a body stands before a viewer: which axis is up, which side is in
front.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...core.arrays import Float
from ...core.mesh import Surface

#: Right, up and towards the viewer, in rows: z up, seen along +y; and y up, seen along -z, as in
#: most animation programs.
Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
Y_UP = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])

#: Points up to this share of the height above the lowest one touch the ground.
TOUCHING_HEIGHT_SHARE = 0.03
#: Shares of its outline that the foot of a body covers: along y at least twice that along z, and
#: this much; below the last, the foot is not evaluated.
FOOTING_RATIO, MIN_FOOTING_SHARE, SMALL_FOOTING_SHARE = 2.0, 0.04, 0.1
TALL_RATIO = 1.3  # height of a tall body, in its other sizes
DEEP_RATIO = 1.5  # depth, in widths, from which a body is seen from its long side


def viewing_axes(surface: Surface) -> Float:
    """Return unit vectors (3, 3) in rows: to the right, up, and towards the viewer.

    Up is z, as in CAD and printing, unless the shape suggests y. That is so if the body would stand
    on its lowest points along y (its center above them) and these cover a far larger share of its
    outline than those along z; or if both cover little and the body is longest along y. The front
    is at low y, or at high z if y is up. A body that is much deeper than wide from there is seen
    from its other side.

    Args:
        surface: Surface of the body.

    Returns:
        The axes.
    """
    points = surface.vertices[np.unique(surface.faces)]
    frame = Y_UP if _stands_on_y(points, surface.centroid) else Z_UP
    width, _, depth = np.abs(frame) @ np.ptp(points, axis=0)
    if depth > DEEP_RATIO * width:
        right, up, back = frame
        frame = np.array([-back, up, right])
    return frame


def _stands_on_y(points: Float, center: Float) -> bool:
    along_y, along_z = (_footing_share(points, center, axis) for axis in (1, 2))
    x, y, z = np.ptp(points, axis=0)
    if max(along_y, along_z) < SMALL_FOOTING_SHARE and y > TALL_RATIO * max(x, z):
        return True
    return bool(along_y > MIN_FOOTING_SHARE + FOOTING_RATIO * along_z)


def _footing_share(points: Float, center: Float, axis: int) -> float:
    """Return the share of a body's bounding rectangle, seen along an axis, that its lowest points
    span; 0 if its center of mass is not above them.
    """
    height = points[:, axis] - points[:, axis].min()
    flat = np.delete(points, axis, axis=1)
    touching = flat[height <= TOUCHING_HEIGHT_SHARE * height.max()]
    try:
        hull = ConvexHull(touching)
    except (QhullError, ValueError):  # all on a line, or fewer than three points
        return 0.0
    above = hull.equations[:, :2] @ np.delete(center, axis) + hull.equations[:, 2]
    return float(hull.volume / np.prod(np.ptp(flat, axis=0))) if above.max() < 0 else 0.0
