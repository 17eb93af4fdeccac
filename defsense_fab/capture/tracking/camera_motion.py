"""Find when a camera was moved while recording, and by how much, from the tags alone.

A tag is a square of known size, so its views show how the cameras are placed relative to each
other, in depth too, even where their rays still meet. A camera was moved where two spans of frames
differ by far more than pieces of them do among themselves. Errors of the lens model also change
with the tags' positions, but not permanently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.rotations import rotation_matrices
from .pose_equations import POSE_PRIOR, PoseEquations, SharedViews, pose_equations

MAX_MOVES = 6
MIN_SPAN_FRAMES = 12  # without the frames in which a camera is moved
MIN_CHI_SQUARE = 60.0  # of a change that is not by chance
MIN_IMAGE_MOTION_PX = 0.4
JUMP_WINDOW_S = 0.2  # on each side of a move, from which the images are extrapolated
MIN_JUMP_RATIO = 1.5  # relative to jumps at other times
REFERENCE_JUMPS = 60  # at other times
REFINEMENT_ROUNDS = 2  # in which all moves are measured together


@dataclass(frozen=True)
class CameraMotion:
    """A move of one camera.

    From frame `at` on, a point X in the camera's former frame is at rotation X + translation.

    Attributes:
        camera: Index of the camera.
        at: First frame after the move.
        rotation: Rotation (3, 3).
        translation: Translation (3,), mm.
    """

    camera: int
    at: int
    rotation: Float
    translation: Float

    @property
    def degrees(self) -> float:
        """Angle by which the camera was turned, degrees."""
        cosine = (np.trace(self.rotation) - 1) / 2
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))

    @property
    def shift(self) -> float:
        """Distance by which its center of projection was moved, mm."""
        return float(np.linalg.norm(self.translation))

    def of_other(self, camera: Camera, other: Camera, index: int) -> CameraMotion:
        """Return the motion of another camera that gives the same relative pose.

        Args:
            camera: This motion's camera before the move.
            other: The other camera before the move.
            index: Index of the other camera.
        """
        turn = camera.rotation @ other.rotation.T  # from the other's frame to this one's
        shift = camera.translation - turn @ other.translation
        R = turn.T @ self.rotation.T @ turn
        t = turn.T @ (self.rotation.T @ (shift - self.translation) - shift)
        return CameraMotion(index, self.at, _orthogonal(R), t)

    def moved(self, camera: Camera) -> Camera:
        """Return the camera after the move."""
        return replace(
            camera,
            rotation=_orthogonal(self.rotation @ camera.rotation),
            translation=self.rotation @ camera.translation + self.translation,
        )


def find_camera_motion(
    cameras: Sequence[Camera], views: SharedViews, move_frames: int
) -> list[CameraMotion]:
    """Find moves of single cameras, in the order of time.

    For two cameras only the relative pose is known. Then all moves are attributed to the second
    one, unless `which_moved` shows otherwise.

    Args:
        cameras: The cameras.
        views: Tags that they share.
        move_frames: Largest number of frames that a move takes on each side.
    """
    cameras = _fit_start_pose(cameras, views)
    R, T = _poses(cameras, views.count)
    moves: list[CameraMotion] = []
    candidates = range(1, 2) if len(cameras) == 2 else range(len(cameras))
    while len(moves) < MAX_MOVES:
        sums = pose_equations(cameras, _without_moves(views, moves, move_frames), R, T)
        ends = [0, *sorted(m.at for m in moves), views.count]
        best: tuple[float, int, int, Float] | None = None
        for c in candidates:
            for span in range(len(ends) - 1):
                change = _best_change(sums, c, ends, span, move_frames)
                if change is not None and (best is None or change[0] > best[0]):
                    best = (change[0], c, *change[1:])
        if best is None:
            break
        _, c, at, pose_change = best
        motion = CameraMotion(c, at, rotation_matrices(pose_change[:3]), pose_change[3:])
        moves = sorted([*moves, motion], key=lambda m: m.at)
        R, T = _poses_after(cameras, views.count, moves)
    for _ in range(REFINEMENT_ROUNDS if moves else 0):
        for k, m in enumerate(moves):
            sums = pose_equations(cameras, _without_moves(views, moves, move_frames), R, T)
            lo = moves[k - 1].at if k else 0
            hi = moves[k + 1].at if k + 1 < len(moves) else views.count
            pose_change = sums.pose(m.camera, m.at, hi)[0] - sums.pose(m.camera, lo, m.at)[0]
            turn = rotation_matrices(pose_change[:3])
            moves[k] = replace(
                m,
                rotation=_orthogonal(turn @ m.rotation),
                translation=turn @ m.translation + pose_change[3:],
            )
            R, T = _poses_after(cameras, views.count, moves)
    return moves


def which_moved(images: Sequence[tuple[Float, Float]], at: float, gap: float) -> int | None:
    """Find which of two cameras was moved, by the jump of its image.

    Args:
        images: For each camera, times (t,), s, and centers of tags (t, m, 2), px.
        at: Time of the move, s.
        gap: Uncertainty of that time, s.

    Returns:
        The camera whose image jumped by more than usual; None if that is not clear.
    """
    is_clear, is_usual = [], []
    for time, px in images:
        window = 2 * (gap + JUMP_WINDOW_S)
        reference_times = np.linspace(time[0] + window / 2, time[-1] - window / 2, REFERENCE_JUMPS)
        jumps = [_image_jump(time, px, t, gap) for t in reference_times if abs(t - at) > window]
        jumps = [j for j in jumps if np.isfinite(j)]
        jump = _image_jump(time, px, at, gap)
        if len(jumps) < REFERENCE_JUMPS // 4 or not np.isfinite(jump):
            return None
        usual_jump = np.quantile(jumps, 0.95)
        is_clear.append(jump > MIN_JUMP_RATIO * usual_jump)
        is_usual.append(jump < usual_jump)
    for k in (0, 1):
        if is_clear[k] and is_usual[1 - k]:
            return k
    return None


def _image_jump(time: Float, px: Float, at: float, gap: float) -> float:
    """Return the distance, px, between lines through the images before and after a time.

    It is the median over all tags, because hands move tags one by one; NaN with too few images.
    """
    before = np.flatnonzero((time < at - gap) & (time > at - gap - JUMP_WINDOW_S))
    after = np.flatnonzero((time > at + gap) & (time < at + gap + JUMP_WINDOW_S))
    if min(len(before), len(after)) < 3:
        return np.nan
    ends = [_line_at_zero(time[rows] - at, px[rows]) for rows in (before, after)]
    difference = ends[1] - ends[0]
    is_known = np.isfinite(difference).all(axis=1)
    return (
        float(np.linalg.norm(np.median(difference[is_known], axis=0))) if is_known.any() else np.nan
    )


def _line_at_zero(t: Float, px: Float) -> Float:
    """Return centers (m, 2) at time zero, by lines through centers (n, m, 2) at times (n,)."""
    A = np.stack([np.ones(len(t)), t], axis=1)
    return np.asarray((np.linalg.pinv(A) @ px.reshape(len(t), -1))[0].reshape(-1, 2))


def _best_change(
    sums: PoseEquations, c: int, ends: Sequence[int], span: int, move_frames: int
) -> tuple[float, int, Float] | None:
    """Find the best change of a camera's pose in a span.

    Args:
        sums: Equations of the poses.
        c: Camera.
        ends: Limits of the spans.
        span: Number of the span.
        move_frames: Frames that a move takes on each side.

    Returns:
        By how much two poses explain the views better than one, the frame, and the difference of
        the poses (6,); None if that is not clear.
    """
    lo, hi = ends[span], ends[span + 1]
    margin = MIN_SPAN_FRAMES + move_frames
    frames = np.arange(lo + margin, hi - margin + 1)
    if not len(frames):
        return None
    prior = np.diag(1 / POSE_PRIOR**2)

    def gain(N: Float, g: Float) -> Float:
        return np.asarray((g * np.linalg.solve(N + prior, g[..., None])[..., 0]).sum(-1))

    N, g = sums.N[:, c], sums.g[:, c]
    gains = gain(N[frames] - N[lo], g[frames] - g[lo]) + gain(N[hi] - N[frames], g[hi] - g[frames])
    gains -= gain(N[hi] - N[lo], g[hi] - g[lo])
    k = int(frames[gains.argmax()])
    scatter = sums.scatter(c, sorted([*ends, k]))
    poses, covariance = [], np.zeros((6, 6))
    for first, last in ((lo, k), (k, hi)):
        pose, inverse = sums.pose(c, first, last)
        poses.append(pose)
        covariance += inverse @ ((last - first) * scatter) @ inverse + sums.inflation * inverse
    difference = poses[1] - poses[0]
    chi_square = float(difference @ np.linalg.solve(covariance, difference))
    tags = sums.tags[hi, c] - sums.tags[lo, c]
    picture = (sums.picture[hi, c] - sums.picture[lo, c]) / max(tags, 1)
    if (
        chi_square < MIN_CHI_SQUARE
        or float(np.sqrt(difference @ picture @ difference)) < MIN_IMAGE_MOTION_PX
    ):
        return None
    return float(gains.max()), k, difference


def _fit_start_pose(cameras: Sequence[Camera], views: SharedViews) -> list[Camera]:
    """Correct the pose of the camera that explains most of the residuals.

    A camera that was moved before the recording, or is not quite where it was calibrated, was not
    moved during it.
    """
    out = list(cameras)
    for _ in range(REFINEMENT_ROUNDS):
        sums = pose_equations(out, views, *_poses(out, views.count))
        gains = [float(sums.pose(c, 0, views.count)[0] @ sums.g[-1, c]) for c in range(len(out))]
        c = int(np.argmax(gains))
        pose_change = sums.pose(c, 0, views.count)[0]
        out[c] = CameraMotion(c, 0, rotation_matrices(pose_change[:3]), pose_change[3:]).moved(
            out[c]
        )
    return out


def _without_moves(
    views: SharedViews, motions: Sequence[CameraMotion], move_frames: int
) -> SharedViews:
    """Return the views without frames in which a camera is being moved."""
    is_still = np.ones(len(views.frame), bool)
    for m in motions:
        is_still &= (views.frame < m.at - move_frames) | (views.frame >= m.at + move_frames)
    return replace(
        views,
        frame=views.frame[is_still],
        corners=views.corners[is_still],
        variance=views.variance[is_still],
    )


def _poses(cameras: Sequence[Camera], count: int) -> tuple[Float, Float]:
    """Return rotations (k, v, 3, 3) and translations (k, v, 3) of the cameras in each frame."""
    R = np.tile(np.stack([c.rotation for c in cameras]), (count, 1, 1, 1))
    return R, np.tile(np.stack([c.translation for c in cameras]), (count, 1, 1))


def _poses_after(
    cameras: Sequence[Camera], count: int, motions: Sequence[CameraMotion]
) -> tuple[Float, Float]:
    """Return the poses in each frame with moves applied."""
    R, T = _poses(cameras, count)
    for m in motions:
        R[m.at :, m.camera] = m.rotation @ R[m.at :, m.camera]
        T[m.at :, m.camera] = T[m.at :, m.camera] @ m.rotation.T + m.translation
    return R, T


def _orthogonal(R: Float) -> Float:
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)
