"""Surfaces of known shape and motion."""

from __future__ import annotations

import numpy as np
import trimesh

from tests.support.grid import grid_of_tets


def bar(cells: tuple[int, int, int] = (20, 4, 4), size=(150.0, 30.0, 30.0)):
    """Return vertices and triangles of a box along x with its base at x = 0."""
    axes = [
        np.linspace(0, s, c + 1) - (s / 2 if k else 0)
        for k, (s, c) in enumerate(zip(size, cells, strict=True))
    ]
    surface, _ = grid_of_tets(axes).boundary().compact()
    return surface.vertices, surface.faces


def ball(subdivisions: int = 3, radius: float = 40.0):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)


def ring(major: int = 40, minor: int = 20):
    mesh = trimesh.creation.torus(50.0, 15.0, major_sections=major, minor_sections=minor)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)


def bent(x: np.ndarray, bend: float, twist: float, length: float = 150.0) -> np.ndarray:
    """Of points of a bar (n, 3): constant curvature in the plane of x and z up to an angle `bend`
    (rad) at the end, with a uniform `twist` (rad) about the axis."""
    s = x[:, 0]
    turn = twist * s / length
    y = np.cos(turn) * x[:, 1] - np.sin(turn) * x[:, 2]
    z = np.sin(turn) * x[:, 1] + np.cos(turn) * x[:, 2]
    if abs(bend) < 1e-12:
        return np.stack([s, y, z], axis=1)
    radius, angle = length / bend, bend * s / length
    return np.stack(
        [(radius - z) * np.sin(angle), y, radius - (radius - z) * np.cos(angle)], axis=1
    )


def spread(vertices: np.ndarray, triangles: np.ndarray, count: int, seed: int = 0) -> np.ndarray:
    """Return points (count, 3) inside triangles, far from each other."""
    rng = np.random.default_rng(seed)
    corners = vertices[triangles[rng.choice(len(triangles), 20 * count)]]
    points = np.einsum("pk,pkd->pd", rng.dirichlet(np.ones(3), len(corners)), corners)
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]
