"""Fewer triangles of a surface whose vertices stay where they are, so that fields still fit."""

from __future__ import annotations

import igl
import numpy as np

from ...core.arrays import Int
from ...core.mesh import Surface

_BYTES = 3_000_000  # of all states, before they are deflated
_EACH = 13  # bytes of a vertex in a state: where it is, how far off it is read, its strain


def light_faces(surface: Surface, states: int) -> Int:
    """The surface's triangles (f, 3), or, where its vertices in so many states were too many for a
    page, those of some of its vertices."""
    room = _BYTES // (_EACH * max(states, 1))
    if len(surface.vertices) <= room:
        return surface.faces
    made = igl.decimate(surface.vertices, surface.faces, 2 * (room - 2))
    a, b, c = corners = made[3][made[1]].T
    apart = (a != b) & (b != c) & (a != c)  # two corners may be born of one vertex
    return np.asarray(corners.T[apart], np.int64)
