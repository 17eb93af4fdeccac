"""A surface as arrays for the page: vertices, faces and the edges that are drawn."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Int
from ...core.mesh import Surface

_EDGE_ANGLE_DEGREES = 25.0  # between faces on both sides of a drawn edge


def surface_arrays(surface: Surface, edge_angle: float = _EDGE_ANGLE_DEGREES) -> dict[str, object]:
    """Return the vertices (v, 3) mm, faces (f, 3) and feature edges (e, 2) of a surface.

    Args:
        surface: The surface.
        edge_angle: Angle, in degrees, between faces on both sides of a feature edge.
    """
    return {
        "vertices": surface.vertices.astype(np.float32),
        "faces": surface.faces.astype(np.uint32),
        "edges": feature_edges(surface, edge_angle).astype(np.uint32),
    }


def feature_edges(surface: Surface, angle: float = _EDGE_ANGLE_DEGREES) -> Int:
    """Return the edges (e, 2) between faces that meet at an angle, and those of one face only."""
    faces = np.asarray(surface.faces, np.int64)
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owners = np.tile(np.arange(len(faces)), 3)
    keys = ends[:, 0] * (faces.max(initial=0) + 1) + ends[:, 1]
    order = np.argsort(keys, kind="stable")
    ends, owners, keys = ends[order], owners[order], keys[order]
    is_first = np.ones(len(keys), bool)
    is_first[1:] = keys[1:] != keys[:-1]
    starts = np.flatnonzero(is_first)
    counts = np.diff(np.append(starts, len(keys)))
    paired = starts[counts == 2]
    normals = surface.normals
    cosines = np.einsum("ij,ij->i", normals[owners[paired]], normals[owners[paired + 1]])
    sharp = paired[cosines < np.cos(np.deg2rad(angle))]
    return np.asarray(ends[np.concatenate([sharp, starts[counts != 2]])])
