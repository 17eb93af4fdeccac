"""From what each camera saw to where the tags were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.camera import Camera
from .single_camera import locate_single
from .triangulation import triangulate

_CHUNK = 20_000  # tags solved at once: what the matrices may take of memory


@dataclass(frozen=True)
class Reconstruction:
    """n instants, m tags: `points` (n, m, 3) mm in the world, NaN where not located; `covariance`
    (n, m, 3, 3) mm^2; `cameras` (n, m), how many of them agree; `miss` (n, m) px, their residuals,
    root mean square; `sides` (n, m) mm, the mean side of the tag as located by several cameras;
    `seen` (n, m), cameras that saw the tag; `corners` (n, m, 4, 3) mm as located by several."""

    points: Float
    covariance: Float
    cameras: Int
    miss: Float
    sides: Float
    seen: Int
    corners: Float


def reconstruct(
    cameras: Sequence[Camera],
    corners: Float,
    covariance: Float,
    size: float,
    size_sigma: float = 0.0,
) -> Reconstruction:
    """Tags of `size` mm by v cameras: those that two see by triangulation, those that one sees by
    their size, with `size_sigma` as in `locate_single`. `corners` (n, m, v, 4, 2) px without
    distortion, `covariance` (n, m, v, 5, 2, 2) of each, and of their mean."""
    n, m, v = corners.shape[:3]
    flat, spread = corners.reshape(-1, v, 4, 2), covariance.reshape(-1, v, 5, 2, 2)
    points, cov = np.full((n * m, 3), np.nan), np.full((n * m, 3, 3), np.nan)
    count, miss = np.zeros(n * m, int), np.full(n * m, np.nan)
    sides, outline = np.full(n * m, np.nan), np.full((n * m, 4, 3), np.nan)
    there = np.asarray(np.isfinite(flat).all(axis=(2, 3)))
    many = np.flatnonzero(there.sum(axis=1) >= 2)
    for rows in _chunks(many):
        found = triangulate(cameras, flat[rows], spread[rows])
        points[rows], cov[rows], outline[rows] = found.points, found.covariance, found.corners
        count[rows], miss[rows] = found.used.sum(axis=1), found.miss
        edges = found.corners - np.roll(found.corners, 1, axis=1)
        sides[rows] = np.linalg.norm(edges, axis=2).mean(axis=1)
    one = there.sum(axis=1) == 1
    for c, camera in enumerate(cameras):
        for rows in _chunks(np.flatnonzero(one & there[:, c])):
            found = locate_single(camera, flat[rows, c], spread[rows, c], size, size_sigma)
            points[rows], cov[rows] = found.points, found.covariance
            count[rows], miss[rows] = found.used.sum(axis=1), found.miss
    return Reconstruction(
        points.reshape(n, m, 3), cov.reshape(n, m, 3, 3), count.reshape(n, m), miss.reshape(n, m),
        sides.reshape(n, m), there.sum(axis=1).reshape(n, m), outline.reshape(n, m, 4, 3),
    )  # fmt: skip


def _chunks(rows: Int) -> list[Int]:
    return [rows[k : k + _CHUNK] for k in range(0, len(rows), _CHUNK)]
