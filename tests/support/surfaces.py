"""Convert surfaces from other libraries, and measure them with libigl alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import igl
import numpy as np
import trimesh

from defsense_fab.core.mesh import Surface


def from_trimesh(mesh: Any) -> Surface:
    """Return the surface of a trimesh.Trimesh."""
    return Surface(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))


def read_stl(path: Path) -> Surface:
    """Return the surface in an STL file, which must be closed."""
    mesh = trimesh.load(path, force="mesh")
    assert mesh.is_watertight
    return from_trimesh(mesh)


def distance(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Return the distance (n,) of points (n, 3) from a surface."""
    square = igl.point_mesh_squared_distance(points, surface.vertices, surface.faces)[0]
    return np.sqrt(np.atleast_1d(square))


def is_inside(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Return which points (n, 3) lie inside a surface."""
    return np.asarray(igl.fast_winding_number(surface.vertices, surface.faces, points)) > 0.5


def join(*surfaces: Surface) -> Surface:
    """Return several surfaces as one."""
    offsets = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    faces = [s.faces + o for s, o in zip(surfaces, offsets, strict=True)]
    return Surface(np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces))
