"""Where cameras stand, from views of one board that several of them see at once.

Bundle adjustment (Triggs et al. 2000): the poses of all cameras but the first, the poses of the
board, and the cameras' intrinsics as far as their own calibration left them open, so that the
corners are missed least, with a loss (Huber's) that lets single bad corners go.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.camera import Camera, cross_matrices, distort
from ...core.errors import CaptureError
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard
from .intrinsics import board_pose

LEAST_VIEWS = 4
_NOISE = 0.1  # px: what corners are worth against the intrinsics' own uncertainty
_ALIKE = 3.0  # above which the corners of a view are off together (1: one by one)
_HUBER = 3.0  # of that: beyond it a corner counts linearly
_STEPS, _DONE = 60, 1e-9
_OWN = 9


@dataclass(frozen=True)
class Extrinsics:
    """`cameras`, the first of them at the world's origin; root mean square `error` px over all
    corners, by camera `errors` (v,); how many boards each pair saw, `shared` (v, v)."""

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
    """From the views of each instant by camera; `sigma`, standard deviations (9,) of fx, fy, cx,
    cy, k1, k2, p1, p2, k3 of each camera, by which they may change (not at all, where None). Raises
    CaptureError where cameras are not linked by boards that they both saw."""
    several = [s for s in instants if len(s) >= 2]
    shared = np.zeros((len(cameras), len(cameras)), int)
    for s in several:
        for a in s:
            for b in s:
                shared[a, b] += 1
    poses = [
        {
            c: p[:2]
            for c, v in s.items()
            if (p := board_pose(cameras[c], board.corners[v.ids], v.corners)) is not None
        }
        for s in several
    ]
    start = _chain(cameras, poses, shared)
    problem = _Problem(cameras, board, several, sigma)
    x = problem.pack(start, poses)
    x = _least(problem, x)
    if sigma is not None and problem.alike(x) > _ALIKE:
        # A board that moved between the cameras' shutters: all corners of a view are off together,
        # and must not bend the lenses.
        problem = _Problem(cameras, board, several, sigma, problem.noise(x))
        x = _least(problem, problem.pack(start, poses))
    out = problem.cameras(x)
    miss = problem.misses(x)
    errors = np.array([np.sqrt((m**2).sum(axis=1).mean()) if len(m) else np.nan for m in miss])
    everything = np.concatenate(miss)
    error = float(np.sqrt((everything**2).sum(axis=1).mean()))
    if not np.isfinite(error) or error > 5:
        raise CaptureError(
            "the poses of the cameras cannot be found: the reprojection error of the corners is"
            f" {error:.1f} px; check that the views were taken at the same time, that the"
            " calibrations belong to these cameras, and that board.json describes this board",
            code="camera-poses-unsolved",
            error=error,
        )
    return Extrinsics(out, error, errors, shared)


def _chain(
    cameras: Sequence[Camera], poses: Sequence[Mapping[int, tuple[Float, Float]]], shared: Float
) -> list[tuple[Float, Float]]:
    """First camera to each camera, along the pairs that share most boards."""
    known: dict[int, tuple[Float, Float]] = {0: (np.eye(3), np.zeros(3))}
    while len(known) < len(cameras):
        pairs = [(shared[a, b], a, b) for a in known for b in range(len(cameras)) if b not in known]
        count, a, b = max(pairs)
        if count < LEAST_VIEWS:
            raise CaptureError(
                f"cameras {cameras[a].name} and {cameras[b].name} saw the board together"
                f" {count} times, but {LEAST_VIEWS} views are needed; hold it where both see it",
                code="views-too-few",
                cameras=(cameras[a].name, cameras[b].name),
                count=count,
            )
        steps = []
        for s in poses:
            if a in s and b in s:
                (Ra, ta), (Rb, tb) = s[a], s[b]
                R = Rb @ Ra.T
                steps.append((R, tb - R @ ta))
        R = Rotation.from_matrix([s[0] for s in steps]).mean().as_matrix()
        t = np.median([s[1] for s in steps], axis=0)
        known[b] = (R @ known[a][0], R @ known[a][1] + t)
    return [known[c] for c in range(len(cameras))]


def _least(problem: _Problem, x: Float) -> Float:
    """Parameters of least loss: Levenberg & Marquardt's method on reweighted squares.

    `scipy.optimize.least_squares` with the same derivatives and loss comes to the same poses (to
    1e-5 mm), but takes 4 to 8 times as long: it decomposes the Jacobian itself, not its square.
    """
    damping = 1e-3
    r = problem.residuals(x)
    loss = _loss(r)
    for _ in range(_STEPS):
        J, w = problem.jacobian(x), _weights(r)
        JW = J * w[:, None]
        N, g = JW.T @ J, JW.T @ r
        gained = 0.0
        while damping < 1e8:
            step = cho_solve(cho_factor(N + damping * np.diag(np.diag(N) + 1e-12)), g)
            tried = problem.residuals(x - step)
            if np.isfinite(tried).all() and _loss(tried) < loss:
                gained = loss - _loss(tried)
                x, r, loss = x - step, tried, loss - gained
                damping = max(damping / 5, 1e-9)
                break
            damping *= 4
        if gained < _DONE * loss:
            break
    return x


def _weights(r: Float) -> Float:
    return np.asarray(_HUBER / np.maximum(np.abs(r), _HUBER))


def _loss(r: Float) -> float:
    a = np.abs(r)
    return float(np.where(a < _HUBER, a * a, 2 * _HUBER * a - _HUBER**2).sum())


class _Problem:
    """Residuals and their derivatives. Parameters: (rotation vector, translation) of each camera
    but the first, of each board (board to first camera), and changes of intrinsics in units of
    their sigma."""

    def __init__(
        self, cameras: Sequence[Camera], board: CharucoBoard,
        instants: Sequence[Mapping[int, BoardView]], sigma: Sequence[Float] | None,
        noise: float = _NOISE,
    ) -> None:  # fmt: skip
        self._noise = noise
        self._cameras, self._v, self._k = cameras, len(cameras), len(instants)
        self._sigma = None
        if sigma is not None:
            each = zip(cameras, sigma, strict=True)
            self._sigma = [np.zeros(_OWN) if c.fisheye else s for c, s in each]
        self._rows = [
            (c, k, board.corners[view.ids], view.corners)
            for k, s in enumerate(instants)
            for c, view in s.items()
        ]
        self._boards = 6 * (self._v - 1)
        self._inner = self._boards + 6 * self._k
        self._size = self._inner + (_OWN * self._v if sigma is not None else 0)

    def pack(
        self, start: Sequence[tuple[Float, Float]],
        poses: Sequence[Mapping[int, tuple[Float, Float]]],
    ) -> Float:  # fmt: skip
        x = np.zeros(self._size)
        for c, (R, t) in enumerate(start[1:]):
            x[6 * c : 6 * c + 6] = np.append(Rotation.from_matrix(R).as_rotvec(), t)
        for k, s in enumerate(poses):
            c, (R, t) = next(iter(s.items()), (0, (np.eye(3), np.array([0, 0, 500.0]))))
            Rc, tc = start[c]
            at = slice(self._boards + 6 * k, self._boards + 6 * k + 6)
            x[at] = np.append(Rotation.from_matrix(Rc.T @ R).as_rotvec(), Rc.T @ (t - tc))
        return x

    def cameras(self, x: Float) -> tuple[Camera, ...]:
        out = []
        for c, camera in enumerate(self._cameras):
            R, t = self._camera(x, c)
            K, d = self._intrinsics(x, c)
            out.append(replace(camera, matrix=K, distortions=d, rotation=R, translation=t))
        return tuple(out)

    def _camera(self, x: Float, c: int) -> tuple[Float, Float]:
        if c == 0:
            return np.eye(3), np.zeros(3)
        p = x[6 * c - 6 : 6 * c]
        return Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]

    def _board(self, x: Float, k: int) -> tuple[Float, Float]:
        p = x[self._boards + 6 * k : self._boards + 6 * k + 6]
        return Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]

    def _intrinsics(self, x: Float, c: int) -> tuple[Float, Float]:
        camera = self._cameras[c]
        if self._sigma is None or camera.fisheye:  # whose focal length and bending go together
            return camera.matrix, camera.distortions
        by = x[self._inner + _OWN * c :][:_OWN] * self._sigma[c]
        K, d = camera.matrix.copy(), np.append(camera.distortions, np.zeros(3))[:8]
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += by[:4]
        d[:5] += by[4:]
        return K, d if np.any(d[5:]) else d[:5]

    def misses(self, x: Float) -> list[Float]:
        """By camera: seen minus shown (n, 2) px."""
        out: list[list[Float]] = [[] for _ in self._cameras]
        for c, k, points, seen in self._rows:
            out[c].append(seen - self._show(x, c, k, points)[0])
        return [np.concatenate(m) if m else np.zeros((0, 2)) for m in out]

    def alike(self, x: Float) -> float:
        """How much the corners of a view are off together: the variance of the views' means by what
        corners that are off one by one would give them."""
        common, single, count = self._parts(x)
        return common * count / max(single, 1e-12) + 1

    def noise(self, x: Float) -> float:
        """px: what a corner is worth where those of a view are off together."""
        common, single, count = self._parts(x)
        return max(float(np.sqrt(single + count * common)), _NOISE)

    def _parts(self, x: Float) -> tuple[float, float, float]:
        """Variances, px^2, of what is common to the corners of a view and of what is not, and how
        many corners a view has."""
        views = [seen - self._show(x, c, k, points)[0] for c, k, points, seen in self._rows]
        count = float(np.mean([len(v) for v in views]))
        single = float(np.mean(np.concatenate([v - v.mean(axis=0) for v in views]) ** 2))
        means = float(np.mean(np.array([v.mean(axis=0) for v in views]) ** 2))
        return max(means - single / count, 0.0), single, count

    def residuals(self, x: Float) -> Float:
        parts = [
            (seen - self._show(x, c, k, points)[0]).ravel() / self._noise
            for c, k, points, seen in self._rows
        ]
        return np.concatenate([*parts, x[self._inner :]])

    def jacobian(self, x: Float) -> Float:
        count = sum(seen.size for *_, seen in self._rows) + self._size - self._inner
        J, row = np.zeros((count, self._size)), 0
        for c, k, points, seen in self._rows:
            _, by_plane, by_own, first, at = self._show(x, c, k, points)
            D = np.zeros((len(points), 2, 3))
            D[:, 0, 0] = D[:, 1, 1] = 1.0
            D[:, :, 2] = -at[:, :2] / at[:, 2:]
            D = by_plane @ (D / at[:, 2:, None])  # by the point in this camera
            part = slice(row, row + seen.size)
            R, _ = self._camera(x, c)
            if c:
                left = _left(x[6 * c - 6 : 6 * c - 3])
                J[part, 6 * c - 6 : 6 * c - 3] = (-D @ cross_matrices(first @ R.T) @ left).reshape(
                    -1, 3
                )
                J[part, 6 * c - 3 : 6 * c] = D.reshape(-1, 3)
            b = self._boards + 6 * k
            Rb, _ = self._board(x, k)
            DR = D @ R
            J[part, b : b + 3] = (
                -DR @ cross_matrices(points @ Rb.T) @ _left(x[b : b + 3])
            ).reshape(-1, 3)
            J[part, b + 3 : b + 6] = DR.reshape(-1, 3)
            if self._sigma is not None:
                o = self._inner + _OWN * c
                J[part, o : o + _OWN] = (by_own * self._sigma[c]).reshape(-1, _OWN)
            row += seen.size
        J /= -self._noise
        J[row:, self._inner :] = np.eye(self._size - self._inner)
        return J

    def _show(
        self, x: Float, c: int, k: int, points: Float
    ) -> tuple[Float, Float, Float, Float, Float]:
        """Pixels (n, 2); derivatives by the undistorted plane (n, 2, 2) and by the camera's own
        parameters (n, 2, 9); points in the first camera and in this one (n, 3)."""
        Rb, tb = self._board(x, k)
        R, t = self._camera(x, c)
        K, d = self._intrinsics(x, c)
        first = points @ Rb.T + tb
        at = first @ R.T + t
        plane = at[:, :2] / at[:, 2:]
        bent, by = distort(plane, d, fisheye=self._cameras[c].fisheye)
        focal = K[[0, 1], [0, 1]]
        own = np.zeros((len(points), 2, _OWN))
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


def _left(r: Float) -> Float:
    """Left Jacobian (3, 3) of the rotation by the vector r (3,) rad (Barfoot 2017, 7.1.3)."""
    angle = float(np.linalg.norm(r))
    K = cross_matrices(r[None])[0]
    if angle < 1e-6:
        return np.asarray(np.eye(3) + K / 2)
    a, b = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + a * K + b * K @ K)
