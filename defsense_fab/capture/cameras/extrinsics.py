"""Find the poses of cameras from views of one board that several of them see at once.

Bundle adjustment (Triggs et al. 2000) finds the poses of all cameras but the first, the poses of
the board, and the cameras' intrinsics as far as their own calibration left them uncertain. It
minimizes the residuals of the corners with Huber's loss, which limits the influence of single bad
corners.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.camera import Camera, distort
from ...core.errors import CaptureError
from ...core.rotations import cross_matrices
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard
from .intrinsics import find_board_pose

MIN_VIEWS = 4
CORNER_NOISE_PX = 0.1  # relative to the uncertainty of the intrinsics
MAX_COMMON_ERROR = 3.0  # above it the corners of a view share an error (1: independent errors)
MAX_ERROR_PX = 5
HUBER_LIMIT = 3.0  # in units of the noise: beyond it a corner counts linearly
MAX_STEPS, MIN_LOSS_DECREASE = 60, 1e-9  # relative
INTRINSICS = 9  # parameters of a camera


@dataclass(frozen=True)
class Extrinsics:
    """Poses of v cameras.

    Attributes:
        cameras: The cameras; the first is at the world's origin.
        error: Root mean square residual of all corners, px.
        errors: The same for each camera (v,), px.
        shared: Number of boards that each pair saw (v, v).
    """

    cameras: tuple[Camera, ...]
    error: float
    errors: Float
    shared: Float


def estimate_extrinsics(
    cameras: Sequence[Camera],
    board: CharucoBoard,
    instants: Sequence[Mapping[int, BoardView]],
    sigma: Sequence[Float] | None = None,
) -> Extrinsics:
    """Find the poses of cameras.

    Args:
        cameras: The calibrated cameras.
        board: The board.
        instants: Views of each instant by camera.
        sigma: Standard deviations (9,) of fx, fy, cx, cy, k1, k2, p1, p2, k3 of each camera, by
            which they may change; None keeps them fixed.

    Raises:
        CaptureError: If cameras are not linked by boards that both saw, or the views do not fit.
    """
    shared_views = [views for views in instants if len(views) >= 2]
    shared = np.zeros((len(cameras), len(cameras)), int)
    for views in shared_views:
        for a in views:
            for b in views:
                shared[a, b] += 1
    poses = [
        {
            c: p[:2]
            for c, v in views.items()
            if (p := find_board_pose(cameras[c], board.corners[v.ids], v.corners)) is not None
        }
        for views in shared_views
    ]
    start_poses = _chain_poses(cameras, poses, shared)
    problem = BundleAdjustment(cameras, board, shared_views, sigma)
    x = problem.pack(start_poses, poses)
    x = _minimize(problem, x)
    if sigma is not None and problem.common_error(x) > MAX_COMMON_ERROR:
        # The board moved between the cameras' shutters. All corners of a view share that error,
        # which must not change the lenses.
        problem = BundleAdjustment(cameras, board, shared_views, sigma, problem.view_noise(x))
        x = _minimize(problem, problem.pack(start_poses, poses))
    adjusted = problem.cameras(x)
    residuals = problem.camera_residuals(x)
    errors = np.array([np.sqrt((m**2).sum(axis=1).mean()) if len(m) else np.nan for m in residuals])
    all_residuals = np.concatenate(residuals)
    error = float(np.sqrt((all_residuals**2).sum(axis=1).mean()))
    if not np.isfinite(error) or error > MAX_ERROR_PX:
        raise CaptureError(
            f"the cameras' poses cannot be found, because the reprojection error is {error:.1f} px",
            code="camera-poses-unsolved",
            where="cameras",
            action=(
                "Check that the views were taken at the same time, that the calibrations belong to"
                " these cameras, and that board.json describes this board"
            ),
            error=error,
        )
    return Extrinsics(adjusted, error, errors, shared)


def _chain_poses(
    cameras: Sequence[Camera], poses: Sequence[Mapping[int, tuple[Float, Float]]], shared: Float
) -> list[tuple[Float, Float]]:
    """Return each camera's pose relative to the first, along the pairs that share most boards."""
    camera_poses: dict[int, tuple[Float, Float]] = {0: (np.eye(3), np.zeros(3))}
    while len(camera_poses) < len(cameras):
        pairs = [
            (shared[a, b], a, b)
            for a in camera_poses
            for b in range(len(cameras))
            if b not in camera_poses
        ]
        count, a, b = max(pairs)
        if count < MIN_VIEWS:
            raise CaptureError(
                f"they saw the board together {count} times, but {MIN_VIEWS} views are needed",
                code="too-few-views",
                where=f"cameras {cameras[a].name} and {cameras[b].name}",
                action="Hold the board where both see it",
                cameras=(cameras[a].name, cameras[b].name),
                count=count,
            )
        relative_poses = []
        for views in poses:
            if a in views and b in views:
                (Ra, ta), (Rb, tb) = views[a], views[b]
                R = Rb @ Ra.T
                relative_poses.append((R, tb - R @ ta))
        R = Rotation.from_matrix([views[0] for views in relative_poses]).mean().as_matrix()
        t = np.median([views[1] for views in relative_poses], axis=0)
        camera_poses[b] = (R @ camera_poses[a][0], R @ camera_poses[a][1] + t)
    return [camera_poses[c] for c in range(len(cameras))]


def _minimize(problem: BundleAdjustment, x: Float) -> Float:
    """Return the parameters of least loss, by Levenberg-Marquardt on reweighted squares.

    `scipy.optimize.least_squares` with the same derivatives and loss finds the same poses (to 1e-5
    mm), but takes 4 to 8 times as long, because it decomposes the Jacobian itself, not its square.
    """
    damping = 1e-3
    residual = problem.residuals(x)
    loss = _huber_loss(residual)
    for _ in range(MAX_STEPS):
        J, w = problem.jacobian(x), _huber_weights(residual)
        JW = J * w[:, None]
        N, g = JW.T @ J, JW.T @ residual
        decrease = 0.0
        while damping < 1e8:
            step = cho_solve(cho_factor(N + damping * np.diag(np.diag(N) + 1e-12)), g)
            candidate = problem.residuals(x - step)
            if np.isfinite(candidate).all() and _huber_loss(candidate) < loss:
                decrease = loss - _huber_loss(candidate)
                x, residual, loss = x - step, candidate, loss - decrease
                damping = max(damping / 5, 1e-9)
                break
            damping *= 4
        if decrease < MIN_LOSS_DECREASE * loss:
            break
    return x


def _huber_weights(r: Float) -> Float:
    return np.asarray(HUBER_LIMIT / np.maximum(np.abs(r), HUBER_LIMIT))


def _huber_loss(r: Float) -> float:
    a = np.abs(r)
    return float(np.where(a < HUBER_LIMIT, a * a, 2 * HUBER_LIMIT * a - HUBER_LIMIT**2).sum())


class BundleAdjustment:
    """Residuals and their derivatives.

    Parameters are the rotation vector and translation of each camera but the first, of each board
    (board to first camera), and changes of the intrinsics in units of their sigma.

    Args:
        cameras: The cameras.
        board: The board.
        instants: Views of each instant by camera.
        sigma: As in `estimate_extrinsics`.
        noise: Standard deviation of a corner, px.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        board: CharucoBoard,
        instants: Sequence[Mapping[int, BoardView]],
        sigma: Sequence[Float] | None,
        noise: float = CORNER_NOISE_PX,
    ) -> None:
        self._noise = noise
        self._cameras, self._camera_count, self._board_count = cameras, len(cameras), len(instants)
        self._sigma = None
        if sigma is not None:
            pairs = zip(cameras, sigma, strict=True)
            self._sigma = [np.zeros(INTRINSICS) if c.fisheye else views for c, views in pairs]
        self._rows = [
            (c, k, board.corners[view.ids], view.corners)
            for k, views in enumerate(instants)
            for c, view in views.items()
        ]
        self._boards_start = 6 * (self._camera_count - 1)
        self._intrinsics_start = self._boards_start + 6 * self._board_count
        self._size = self._intrinsics_start + (
            INTRINSICS * self._camera_count if sigma is not None else 0
        )

    def pack(
        self,
        camera_poses: Sequence[tuple[Float, Float]],
        board_poses: Sequence[Mapping[int, tuple[Float, Float]]],
    ) -> Float:
        """Return the parameters for poses of the cameras and of the boards."""
        x = np.zeros(self._size)
        for c, (R, t) in enumerate(camera_poses[1:]):
            x[6 * c : 6 * c + 6] = np.append(Rotation.from_matrix(R).as_rotvec(), t)
        for k, views in enumerate(board_poses):
            c, (R, t) = next(iter(views.items()), (0, (np.eye(3), np.array([0, 0, 500.0]))))
            Rc, tc = camera_poses[c]
            part = slice(self._boards_start + 6 * k, self._boards_start + 6 * k + 6)
            x[part] = np.append(Rotation.from_matrix(Rc.T @ R).as_rotvec(), Rc.T @ (t - tc))
        return x

    def cameras(self, x: Float) -> tuple[Camera, ...]:
        """Return the cameras with parameters x."""
        out = []
        for c, camera in enumerate(self._cameras):
            R, t = self._camera_pose(x, c)
            K, d = self._intrinsics(x, c)
            out.append(replace(camera, matrix=K, distortions=d, rotation=R, translation=t))
        return tuple(out)

    def _camera_pose(self, x: Float, c: int) -> tuple[Float, Float]:
        if c == 0:
            return np.eye(3), np.zeros(3)
        p = x[6 * c - 6 : 6 * c]
        return Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]

    def _board_pose(self, x: Float, k: int) -> tuple[Float, Float]:
        p = x[self._boards_start + 6 * k : self._boards_start + 6 * k + 6]
        return Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]

    def _intrinsics(self, x: Float, c: int) -> tuple[Float, Float]:
        camera = self._cameras[c]
        if self._sigma is None or camera.fisheye:  # focal length and distortion are correlated
            return camera.matrix, camera.distortions
        change = x[self._intrinsics_start + INTRINSICS * c :][:INTRINSICS] * self._sigma[c]
        K, d = camera.matrix.copy(), np.append(camera.distortions, np.zeros(3))[:8]
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += change[:4]
        d[:5] += change[4:]
        return K, d if np.any(d[5:]) else d[:5]

    def camera_residuals(self, x: Float) -> list[Float]:
        """Return corners minus projected points (n, 2), px, for each camera."""
        out: list[list[Float]] = [[] for _ in self._cameras]
        for c, k, points, pixels in self._rows:
            out[c].append(pixels - self._project(x, c, k, points)[0])
        return [np.concatenate(m) if m else np.zeros((0, 2)) for m in out]

    def common_error(self, x: Float) -> float:
        """Return how far the corners of a view share an error.

        It is the variance of the views' means relative to that of independent errors.
        """
        common, single, count = self._error_parts(x)
        return common * count / max(single, 1e-12) + 1

    def view_noise(self, x: Float) -> float:
        """Return the standard deviation of a corner, px, if a view's corners share an error."""
        common, single, count = self._error_parts(x)
        return max(float(np.sqrt(single + count * common)), CORNER_NOISE_PX)

    def _error_parts(self, x: Float) -> tuple[float, float, float]:
        """Return the variances, px^2, of the errors that a view's corners share and do not share,
        and the mean number of corners.
        """
        views = [pixels - self._project(x, c, k, points)[0] for c, k, points, pixels in self._rows]
        count = float(np.mean([len(v) for v in views]))
        single = float(np.mean(np.concatenate([v - v.mean(axis=0) for v in views]) ** 2))
        means = float(np.mean(np.array([v.mean(axis=0) for v in views]) ** 2))
        return max(means - single / count, 0.0), single, count

    def residuals(self, x: Float) -> Float:
        """Return the residuals in units of the noise, and the changes of the intrinsics."""
        parts = [
            (corners - self._project(x, c, k, points)[0]).ravel() / self._noise
            for c, k, points, corners in self._rows
        ]
        return np.concatenate([*parts, x[self._intrinsics_start :]])

    def jacobian(self, x: Float) -> Float:
        """Return the derivatives of the residuals by the parameters."""
        count = (
            sum(corners.size for *_, corners in self._rows) + self._size - self._intrinsics_start
        )
        J, row = np.zeros((count, self._size)), 0
        for c, k, points, corners in self._rows:
            _, by_plane, by_intrinsics, in_first, in_camera = self._project(x, c, k, points)
            D = np.zeros((len(points), 2, 3))
            D[:, 0, 0] = D[:, 1, 1] = 1.0
            D[:, :, 2] = -in_camera[:, :2] / in_camera[:, 2:]
            D = by_plane @ (D / in_camera[:, 2:, None])  # derivative by the point in this camera
            part = slice(row, row + corners.size)
            R, _ = self._camera_pose(x, c)
            if c:
                left_jacobian = _left_jacobian(x[6 * c - 6 : 6 * c - 3])
                J[part, 6 * c - 6 : 6 * c - 3] = (
                    -D @ cross_matrices(in_first @ R.T) @ left_jacobian
                ).reshape(-1, 3)
                J[part, 6 * c - 3 : 6 * c] = D.reshape(-1, 3)
            board_column = self._boards_start + 6 * k
            Rb, _ = self._board_pose(x, k)
            DR = D @ R
            J[part, board_column : board_column + 3] = (
                -DR
                @ cross_matrices(points @ Rb.T)
                @ _left_jacobian(x[board_column : board_column + 3])
            ).reshape(-1, 3)
            J[part, board_column + 3 : board_column + 6] = DR.reshape(-1, 3)
            if self._sigma is not None:
                own_column = self._intrinsics_start + INTRINSICS * c
                J[part, own_column : own_column + INTRINSICS] = (
                    by_intrinsics * self._sigma[c]
                ).reshape(-1, INTRINSICS)
            row += corners.size
        J /= -self._noise
        J[row:, self._intrinsics_start :] = np.eye(self._size - self._intrinsics_start)
        return J

    def _project(
        self, x: Float, c: int, k: int, points: Float
    ) -> tuple[Float, Float, Float, Float, Float]:
        """Project points of a board.

        Returns:
            Pixels (n, 2); derivatives by the undistorted plane (n, 2, 2) and by the camera's
            intrinsics (n, 2, 9); and the points in the first camera's and in this camera's frame
            (n, 3).
        """
        Rb, tb = self._board_pose(x, k)
        R, t = self._camera_pose(x, c)
        K, d = self._intrinsics(x, c)
        first = points @ Rb.T + tb
        at = first @ R.T + t
        plane = at[:, :2] / at[:, 2:]
        bent, by = distort(plane, d, fisheye=self._cameras[c].fisheye)
        focal = K[[0, 1], [0, 1]]
        own = np.zeros((len(points), 2, INTRINSICS))
        own[:, 0, 0], own[:, 1, 1] = bent[:, 0], bent[:, 1]
        own[:, 0, 2] = own[:, 1, 3] = 1.0
        px, py = plane.T
        r = px * px + py * py
        below = 1.0
        if len(d) == 8:
            below = 1 + r * (d[5] + r * (d[6] + r * d[7]))
        for column, power in ((4, r), (5, r * r), (8, r**3)):
            own[:, :, column] = plane * (power / below)[:, None]
        own[:, 0, 6], own[:, 1, 6] = 2 * px * py, r + 2 * py * py
        own[:, 0, 7], own[:, 1, 7] = r + 2 * px * px, 2 * px * py
        own[:, :, 4:] *= focal[None, :, None]
        return bent * focal + K[:2, 2], by * focal[:, None], own, first, at


def _left_jacobian(r: Float) -> Float:
    """Return the left Jacobian (3, 3) of the rotation by the vector r (3,), rad (Barfoot 2017,
    section 7.1.3).
    """
    angle = float(np.linalg.norm(r))
    K = cross_matrices(r[None])[0]
    if angle < 1e-6:
        return np.asarray(np.eye(3) + K / 2)
    a, b = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * K + b * K @ K)
