"""Lay out cords as the paper's baselines do, for comparison (DefSense, CHI 2016, Table 1).

The baselines are straight cords in one plane, and straight cords where pictures show much strain.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.device.sensor_tables import new_sensor_names
from ...core.mesh import Surface
from ..limits.polyline_distance import path_gaps
from ..problem.problem import Problem, green_strains, sample_interior
from .candidate_families import straight_batch
from .candidates import Pool, build_pool
from .starting_layouts import Layout, no_room_error

_LINES = 1500


def manual_layout(problem: Problem, count: int) -> Layout:
    """Place straight cords side by side in the middle plane, along the body's longest edge.

    Args:
        problem: The problem.
        count: Number of cords.

    Raises:
        LayoutError: If they do not fit.
    """
    plane = middle_plane(problem.surface)
    points = sample_interior(problem, 4000, np.random.default_rng(0))
    width = float(np.ptp((points - plane.origin) @ plane.axes[:, 1])) - 2 * problem.limits.depth
    offsets = (np.arange(count) - (count - 1) / 2) * width / (count + 1)
    pool = _parallel_pool(problem, plane.origin + offsets[:, None] * plane.axes[:, 1], plane)
    if len(pool) < count:
        raise no_room_error(problem, count)
    return _layout(pool, range(count))


def visual_layout(problem: Problem, count: int, rng: np.random.Generator) -> Layout:
    """Place straight cords along the body where pictures of the strain suggest them.

    The cords are chosen one after the other, as pivoted QR does: each has the largest vector of
    mean strains in all states, perpendicular to those of the cords before. Neither signals nor
    errors are used, as by a person who looks at the pictures.

    Args:
        problem: The problem.
        count: Number of cords.
        rng: Random generator.

    Raises:
        LayoutError: If they do not fit.
    """
    pool = _parallel_pool(
        problem, sample_interior(problem, _LINES, rng), middle_plane(problem.surface)
    )
    if len(pool) < count:
        raise no_room_error(problem, count)
    strains = green_strains(problem, pool.paths.reshape(-1, 3))
    size = np.sqrt((strains**2).sum((2, 3))).reshape(-1, *pool.paths.shape[:2]).mean(2)  # (n, c)
    is_clear = np.ones(len(pool), bool)
    chosen: list[int] = []
    for _ in range(count):
        worth = np.where(is_clear, np.linalg.norm(size, axis=0), -1.0)
        if worth.max() < 0:
            raise no_room_error(problem, count)
        k = int(worth.argmax())
        chosen.append(k)
        direction = size[:, k] / max(float(worth[k]), 1e-12)
        size = size - np.outer(direction, direction @ size)
        is_clear &= path_gaps(pool.paths, pool.paths[k]) > problem.limits.clearance + 0.1
    return _layout(pool, chosen)


def middle_plane(surface: Surface) -> Plane:
    """Return the plane through the middle of the body's bounding box.

    Its x axis follows the longest edge of the box, and its normal the shortest; of equal edges the
    later axis is taken.
    """
    low, high = surface.bounds
    size = np.round(high - low, 3)
    longest = int(size.argmax())
    shortest = max((i for i in range(3) if i != longest), key=lambda i: (-size[i], i))
    return Plane.from_normal((low + high) / 2, np.eye(3)[shortest], np.eye(3)[longest])


def _parallel_pool(problem: Problem, starts: Float, plane: Plane) -> Pool:
    """Return straight cords through points (c, 3) along the plane's x axis, parallel to it."""
    axes = np.repeat(plane.axes[None], len(starts), axis=0)
    return build_pool(problem, [lambda: straight_batch(problem, starts, axes[:, :, 0], axes)])


def _layout(pool: Pool, chosen: range | list[int]) -> Layout:
    return tuple(
        pool.sensor(k, name, frozenset({"path", "plane"}))
        for k, name in zip(chosen, new_sensor_names(()), strict=False)
    )
