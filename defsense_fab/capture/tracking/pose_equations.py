"""Normal equations of the cameras' poses, from views of tags, for any span of frames.

Positions of tags are eliminated from the normal equations of a camera's pose, frame by frame (Schur
complement; Triggs et al. 2000, section 6). Cumulative sums over frames give the equations of any
span.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.rotations import cross_matrices, rotation_matrices
from .reconstruction import tag_corners

GAUSS_NEWTON_STEPS = 6  # for the tags' poses
MIN_CORNER_SIGMA_PX = 0.05
#: Standard deviations of a pose's change, rad and mm.
POSE_PRIOR = np.array([0.05] * 3 + [20.0] * 3)
SCATTER_PIECES = 30  # of all frames, from which the scatter of poses is estimated
OUTLIER_FACTOR = 3.0  # residual relative to the frame's other tags, above which a tag counts less
BLOCK_TAGS = 3000  # in memory at once


@dataclass(frozen=True)
class SharedViews:
    """n views of tags that at least two of v cameras see.

    Attributes:
        size: Side of the tags, mm.
        frame: Frame of each tag (n,).
        count: Number of frames.
        corners: Corners (n, v, 4, 2), px without distortion, NaN where not visible.
        variance: Variance of the corners' coordinates (n, v), px^2.
    """

    size: float
    frame: Int
    count: int
    corners: Float
    variance: Float

    @property
    def is_visible(self) -> Bool:
        """Whether each camera sees each tag (n, v)."""
        return np.asarray(np.isfinite(self.corners).all(axis=(2, 3)))


def shared_views(frames: Int, corners: Float, covariance: Float, size: float) -> SharedViews:
    """Collect the tags that at least two cameras see.

    Args:
        frames: Indices of the frames (k,).
        corners: Corners (k, m, v, 4, 2), px without distortion.
        covariance: Covariances (k, m, v, 5, 2, 2), px^2, of each corner and last of their mean.
        size: Side of the tags, mm.
    """
    is_visible = np.isfinite(corners).all(axis=(3, 4))
    rows = np.argwhere(is_visible.sum(axis=2) >= 2)
    indices = rows[:, 0], rows[:, 1]
    variance = np.trace(covariance[indices][:, :, :4], axis1=3, axis2=4).mean(axis=2) / 2
    return SharedViews(size, rows[:, 0], len(frames), corners[indices], variance)


@dataclass(frozen=True)
class PoseEquations:
    """Cumulative normal equations of the poses of v cameras.

    Entry k holds the sum over the first k frames.

    Attributes:
        N: Normal matrices (k + 1, v, 6, 6).
        g: Right sides (k + 1, v, 6).
        picture: Sums of squared image motion per pose change (k + 1, v, 6, 6).
        tags: Numbers of tags (k + 1, v).
        inflation: Ratio of the residuals' variance to the stated variance.
    """

    N: Float
    g: Float
    picture: Float
    tags: Float
    inflation: float

    def pose(self, c: int, lo: int, hi: int) -> tuple[Float, Float]:
        """Solve for the change of a camera's pose by the frames [lo, hi).

        Returns:
            The change (6,), and the inverse of its normal matrix (6, 6).
        """
        inverse = np.linalg.inv(self.N[hi, c] - self.N[lo, c] + np.diag(1 / POSE_PRIOR**2))
        return inverse @ (self.g[hi, c] - self.g[lo, c]), inverse

    def scatter(self, c: int, ends: Sequence[int]) -> Float:
        """Return the mean square (6, 6) over frames by which pieces differ from their span's pose.

        Args:
            c: Camera.
            ends: Limits of the spans.
        """
        total, pieces = np.zeros((6, 6)), 0
        length = max((ends[-1] - ends[0]) / SCATTER_PIECES, 1.0)
        for lo, hi in pairwise(ends):
            edges = np.linspace(lo, hi, int(np.ceil((hi - lo) / length)) + 1).astype(int)
            N, g = np.diff(self.N[edges, c], axis=0), np.diff(self.g[edges, c], axis=0)
            residual = g - N @ self.pose(c, lo, hi)[0]
            total += residual.T @ residual
            pieces += len(residual)
        spans = len(ends) - 1
        return total * pieces / max(pieces - spans, 1) / (ends[-1] - ends[0])


def pose_equations(
    cameras: Sequence[Camera], views: SharedViews, R: Float, T: Float
) -> PoseEquations:
    """Build the equations for cameras with given poses in each frame.

    Args:
        cameras: The v cameras.
        views: Tags that they share.
        R: Rotations (k, v, 3, 3).
        T: Translations (k, v, 3), mm.
    """
    v = len(cameras)
    N, g = np.zeros((views.count + 1, v, 6, 6)), np.zeros((views.count + 1, v, 6))
    picture, tags = np.zeros((views.count + 1, v, 6, 6)), np.zeros((views.count + 1, v))
    chi_parts = []
    for part in _frame_parts(views):
        chi, *values_of_parts = _tag_equations(cameras, part, R, T)
        chi_parts.append(chi)
        for total, values in zip((N, g, picture, tags), values_of_parts, strict=True):
            np.add.at(total, part.frame + 1, values)
    chi = np.concatenate(chi_parts) if chi_parts else np.zeros(0)
    inflation = max(float(np.median(chi)), 1.0) if len(chi) else 1.0
    N, g, picture, tags = (np.cumsum(x, axis=0) for x in (N, g, picture, tags))
    return PoseEquations(N, g, picture, tags, inflation)


def _frame_parts(views: SharedViews) -> Iterator[SharedViews]:
    """Divide views into parts, because the matrices of all take much memory."""
    starts = np.searchsorted(views.frame, np.arange(views.count + 1))
    first = 0
    while first < views.count:
        last = int(np.searchsorted(starts, starts[first] + BLOCK_TAGS, side="right")) - 1
        last = min(max(last, first + 1), views.count)
        rows = slice(int(starts[first]), int(starts[last]))
        if rows.stop > rows.start:
            yield replace(
                views,
                frame=views.frame[rows],
                corners=views.corners[rows],
                variance=views.variance[rows],
            )
        first = last


def _tag_equations(
    cameras: Sequence[Camera], views: SharedViews, R: Float, T: Float
) -> tuple[Float, Float, Float, Float, Float]:
    """Eliminate the pose of each of n tags.

    Returns:
        Chi square over its degrees of freedom (n,); normal matrices (n, v, 6, 6) and right sides
        (n, v, 6) of the cameras' poses; sums of squared image motion (n, v, 6, 6); and whether each
        camera sees the tag (n, v).
    """
    is_visible, (n, v) = views.is_visible, views.is_visible.shape
    focal = np.stack([c.focal for c in cameras])[:, None]
    center = np.stack([c.matrix[:2, 2] for c in cameras])[:, None]
    pixels = np.where(is_visible[..., None, None], views.corners, 0.0)
    w = np.where(is_visible, 1 / np.maximum(views.variance, MIN_CORNER_SIGMA_PX**2), 0.0)
    R, T = R[views.frame], T[views.frame]
    model = tag_corners(views.size)
    tag_rotation, tag_position = _initial_tag_poses(
        R, T, (pixels - center) / focal, is_visible, model
    )
    for step in range(GAUSS_NEWTON_STEPS + 1):
        rotated = model @ np.swapaxes(tag_rotation, 1, 2)  # (n, 4, 3)
        X = np.einsum("nvij,nkj->nvki", R, rotated + tag_position[:, None]) + T[:, :, None]
        z = np.maximum(X[..., 2:], 1.0)
        plane = X[..., :2] / z
        miss = np.where(is_visible[..., None, None], pixels - plane * focal - center, 0.0)
        D = np.zeros((*plane.shape, 3))
        D[..., 0, 0] = D[..., 1, 1] = 1.0
        D[..., 2] = -plane
        D *= (focal / z)[..., None] * is_visible[..., None, None, None]
        DR = D @ R[:, :, None]
        by_tag = np.concatenate([-DR @ cross_matrices(rotated)[:, None], DR], axis=-1)
        by_tag = by_tag.reshape(n, v, 8, 6)
        wj = w[..., None, None] * by_tag
        A = np.einsum("nvka,nvkb->nab", wj, by_tag) + 1e-9 * np.eye(6)
        a = np.einsum("nvka,nvk->na", wj, miss.reshape(n, v, 8))
        if step == GAUSS_NEWTON_STEPS:
            break
        d = np.linalg.solve(A, a[..., None])[..., 0]
        angle = np.linalg.norm(d[:, :3], axis=1, keepdims=True)
        d[:, :3] *= np.minimum(1.0, 0.3 / np.maximum(angle, 1e-12))
        tag_rotation, tag_position = (
            rotation_matrices(d[:, :3]) @ tag_rotation,
            tag_position + d[:, 3:],
        )
    chi = (w * (miss**2).sum(axis=(2, 3))).sum(axis=1) / (8 * is_visible.sum(axis=1) - 6)
    weight = _robust_weights(chi, views)[:, None]
    by_camera = np.concatenate([-D @ cross_matrices(X), D], axis=-1).reshape(n, v, 8, 6)
    wb = (weight * w)[..., None, None] * by_camera
    across = np.einsum("nvka,nvkb->nvab", wb, by_tag)  # camera by tag
    solved = np.linalg.solve(A[:, None], np.swapaxes(across, 2, 3))
    solved = solved / np.maximum(weight, 1e-12)[..., None, None]
    N = np.einsum("nvka,nvkb->nvab", wb, by_camera) - across @ solved
    g = np.einsum("nvka,nvk->nva", wb, miss.reshape(n, v, 8))
    g -= (across @ np.linalg.solve(A, a[..., None])[:, None])[..., 0]
    picture = np.einsum("nvka,nvkb->nvab", by_camera, by_camera) / 4
    return chi, N, g, picture, is_visible.astype(float)


def _robust_weights(chi: Float, views: SharedViews) -> Float:
    """Return weights (n,) of tags by how much worse they fit than their frame's other tags."""
    order = np.lexsort((chi, views.frame))
    starts = np.searchsorted(views.frame[order], np.arange(views.count + 1))
    medians = (starts[:-1] + starts[1:]) // 2
    usual_chi = np.full(views.count, 1.0)
    has_tags = starts[1:] > starts[:-1]
    usual_chi[has_tags] = np.maximum(chi[order][medians[has_tags]], 1.0)
    return np.asarray(1 / (1 + (chi / (OUTLIER_FACTOR**2 * usual_chi[views.frame])) ** 2))


def _initial_tag_poses(
    R: Float, T: Float, plane: Float, is_visible: Bool, model: Float
) -> tuple[Float, Float]:
    """Return the squares whose corners are nearest to all rays.

    Args:
        R: Rotations of the cameras (n, v, 3, 3).
        T: Translations of the cameras (n, v, 3), mm.
        plane: Corners (n, v, 4, 2) on the plane at unit distance.
        is_visible: Whether each camera sees the tag (n, v).
        model: Corners of the square (4, 3), mm.

    Returns:
        Rotations (n, 3, 3) and positions (n, 3), mm.
    """
    ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1) @ R
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    center = -np.einsum("nvji,nvj->nvi", R, T)
    projectors = (np.eye(3) - ray[..., :, None] * ray[..., None, :]) * is_visible[
        ..., None, None, None
    ]
    g = np.einsum("nvkij,nvj->nki", projectors, center)
    X = np.linalg.solve(projectors.sum(axis=1) + 1e-12 * np.eye(3), g[..., None])[..., 0]
    center_of_tag = X.mean(axis=1)
    u, _, vt = np.linalg.svd(np.swapaxes(X - center_of_tag[:, None], 1, 2) @ model)
    sign = np.ones((len(X), 3))
    sign[:, 2] = np.linalg.det(u) * np.linalg.det(vt)
    return (u * sign[:, None]) @ vt, center_of_tag
