"""Where a plane cuts a body's surface."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface


def plane_section(surface: Surface, plane: Plane) -> Float:
    """The outline as unordered segments (m, 2, 2) mm in the plane's frame; none where the plane
    misses the body. A facet that lies in the plane gives none: its neighbours do."""
    local = (surface.vertices - plane.origin) @ plane.axes
    above = local[:, 2] > 0
    count = above[surface.faces].sum(1)
    crossed = np.flatnonzero((count == 1) | (count == 2))
    corners = local[surface.faces[crossed]]
    side = above[surface.faces[crossed]]
    # The corner that is alone on its side: both crossings are on its edges.
    alone = np.where(side.sum(1) == 1, side.argmax(1), (~side).argmax(1))
    row = np.arange(len(crossed))
    one = corners[row, alone]
    ends = []
    for turn in (1, 2):
        other = corners[row, (alone + turn) % 3]
        share = one[:, 2] / (one[:, 2] - other[:, 2])
        ends.append(one[:, :2] + share[:, None] * (other - one)[:, :2])
    return np.stack(ends, axis=1) if len(crossed) else np.zeros((0, 2, 2))


def inside_section(section: Float, points: Float) -> np.ndarray:
    """Which points (q, 2) mm lie inside of the outline (m, 2, 2): a ray to the right crosses it an
    odd number of times."""
    a, b = section[:, 0], section[:, 1]
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
    return np.asarray((spans & (x < at)).sum(1) % 2 == 1)


def nearest_on_section(section: Float, point: Float) -> Float:
    """The point (2,) of the outline (m, 2, 2), m >= 1, that is nearest to one."""
    a, along = section[:, 0], section[:, 1] - section[:, 0]
    square = np.maximum((along**2).sum(1), 1e-18)
    t = np.clip(((point - a) * along).sum(1) / square, 0, 1)
    places = a + t[:, None] * along
    return np.asarray(places[((places - point) ** 2).sum(1).argmin()])
