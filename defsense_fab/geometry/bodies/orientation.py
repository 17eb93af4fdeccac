"""How a body stands before a viewer, told from its shape: which axis is up, and which side is in
front."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...core.arrays import Float
from ...core.mesh import Surface

#: What is to the right, up and towards the viewer, in rows: z up, seen along +y; and y up, seen
#: along -z, as most programs for animation have it.
Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
Y_UP = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])

_LOW = 0.03  # of the height: how far above the lowest point a body is taken to touch the ground
_MORE, _LEAST, _LITTLE = 2.0, 0.04, 0.1  # shares of the ground that a standing body covers
_TALL = 1.3  # of its other sizes
_LONG = 1.5  # of its width, from where a body is seen from its long side


def standing(surface: Surface) -> Float:
    """Unit vectors (3, 3) in rows: to the right, up, and towards the viewer.

    Up is z, as in CAD and printing, unless the shape says that it is y: the body would stand on its
    lowest points along y (its centre above them), and these cover a far larger share of its outline
    from there than they do along z; or they cover little along both, and it is longest along y.
    Front is where y is low, or z high with y up; a body that is much deeper than wide from there is
    seen from its other side."""
    points = surface.vertices[np.unique(surface.faces)]
    frame = Y_UP if _stands_on_y(points, _middle(surface)) else Z_UP
    wide, _, deep = np.abs(frame) @ np.ptp(points, axis=0)
    if deep > _LONG * wide:
        right, up, back = frame
        frame = np.array([-back, up, right])
    return frame


def _stands_on_y(points: Float, middle: Float) -> bool:
    along_y, along_z = (_footing(points, middle, axis) for axis in (1, 2))
    x, y, z = np.ptp(points, axis=0)
    if max(along_y, along_z) < _LITTLE and y > _TALL * max(x, z):
        return True
    return bool(along_y > _LEAST + _MORE * along_z)


def _footing(points: Float, middle: Float, axis: int) -> float:
    """The share of a body's bounding rectangle, seen along an axis, that its lowest points span; 0
    where its middle is not above them."""
    height = points[:, axis] - points[:, axis].min()
    flat = np.delete(points, axis, axis=1)
    touching = flat[height <= _LOW * height.max()]
    try:
        hull = ConvexHull(touching)
    except (QhullError, ValueError):  # all on a line, or fewer than three
        return 0.0
    above = hull.equations[:, :2] @ np.delete(middle, axis) + hull.equations[:, 2]
    return float(hull.volume / np.prod(np.ptp(flat, axis=0))) if above.max() < 0 else 0.0


def _middle(surface: Surface) -> Float:
    """Centre of mass (3,) mm."""
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    return np.asarray(volume @ (a + b + c) / 4 / volume.sum())
