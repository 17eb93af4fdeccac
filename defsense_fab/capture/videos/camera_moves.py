"""Find cameras that were moved, before or during a recording.

During a recording the time and the motion are found, and the cameras' poses from then on. One
camera of three or more that was moved since all were calibrated, or is not synchronous, is found by
leaving each one out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.camera import Camera
from ..cameras.rig_file import Rig
from ..tracking.camera_motion import CameraMotion, find_camera_motion, which_moved
from ..tracking.observations import StoredObservations, frame_blocks
from ..tracking.pose_equations import shared_views
from ..tracking.reconstruction import reconstruct
from .camera_sync import Count, TrackWarning, views_at_frames, views_of_tags

MAX_TAGS = 300
MIN_TAGS = 20
GOOD_RESIDUAL_PX, MAX_RESIDUAL_PX = (
    0.1,
    0.25,
)  # of all cameras, and of the others without the moved one
MIN_AGREEMENT = 0.9  # share of the tags
MIN_RESIDUAL_RATIO = 3.0  # with another camera left out


def find_moved_camera(
    cameras: Sequence[Camera], views: Iterable[tuple[Float, Float] | None], size: float
) -> int | None:
    """Find the one camera without which the others fit together.

    Args:
        cameras: The v cameras.
        views: Corners (n, v, 4, 2), px without distortion, and covariances (n, v, 5, 2, 2), of
            sampled tags. Two samples are expected: after the cameras were synchronized, where all
            may fit, and before, because a camera that was moved can look late.
        size: Side of the tags, mm.

    Returns:
        The camera; None if all fit, or no single camera explains the residuals.
    """
    samples = []
    for sample in views:
        if sample is None or _residual(cameras, *sample, size) <= GOOD_RESIDUAL_PX:
            return None
        samples.append(sample)
    candidates = (_find_inconsistent(cameras, *sample, size) for sample in reversed(samples))
    return next((k for k in candidates if k is not None), None)


def sample_tags(
    by_camera: Sequence[StoredObservations], count: Count
) -> tuple[Float, Float] | None:
    """Return views of some tags that three of v cameras see; None if they are few.

    Args:
        by_camera: Observations of each camera.
        count: Number of cameras that see each tag in the first one's frames (t, m).
    """
    rows = np.argwhere(count >= 3)
    if len(rows) < MIN_TAGS:
        return None
    return views_of_tags(by_camera, rows[:: max(len(rows) // MAX_TAGS, 1)])


def count_cameras(by_camera: Sequence[StoredObservations]) -> Count:
    """Return how many cameras see each tag in each frame of the first one (t, m)."""
    count = np.zeros((len(by_camera[0].time), len(by_camera[0].ids)), np.int8)
    for frames in frame_blocks(*count.shape):
        corners, _ = views_at_frames(by_camera, frames)
        count[frames] = np.isfinite(corners).all(axis=(3, 4)).sum(axis=2)
    return count


def _find_inconsistent(
    cameras: Sequence[Camera], corners: Float, covariance: Float, size: float
) -> int | None:
    """Return the camera without which the others fit much better; None if there is none."""
    residuals = np.array(
        [
            _residual(
                [c for k, c in enumerate(cameras) if k != excluded],
                np.delete(corners, excluded, axis=1),
                np.delete(covariance, excluded, axis=1),
                size,
            )
            for excluded in range(len(cameras))
        ]
    )
    best = int(residuals.argmin())
    others = np.delete(residuals, best)
    return (
        best
        if residuals[best] <= MAX_RESIDUAL_PX
        and (others > MIN_RESIDUAL_RATIO * residuals[best]).all()
        else None
    )


def _residual(cameras: Sequence[Camera], corners: Float, covariance: Float, size: float) -> float:
    """Return the median residual of tags (n, v, 4, 2), px; infinite if cameras disagree."""
    located = reconstruct(cameras, corners[:, None], covariance[:, None], size)
    by_several = located.views >= 2
    if by_several.sum() < MIN_TAGS:
        return float("inf")
    if located.cameras[by_several].sum() < MIN_AGREEMENT * located.views[by_several].sum():
        return float("inf")
    return float(np.nanmedian(located.miss[by_several]))


MAX_VIEWS = 40_000  # tags times cameras, over all frames
COMPARED_S = 20.0  # on each side of a move, whose images are compared with those at the move
MOVE_MARGIN_S = 0.15  # that a move may take on each side


@dataclass(frozen=True)
class CameraMove:
    """A move of a camera during a recording.

    Attributes:
        camera: Index of the camera.
        is_certain: Whether it is known which of two cameras was moved.
        time: Time of the move, s.
        within: Uncertainty and duration of the move, on each side, s.
        motion: The motion of that camera.
    """

    camera: int
    is_certain: bool
    time: float
    within: float
    motion: CameraMotion

    def warning(self, names: Sequence[str]) -> TrackWarning:
        """Return a warning about the move, for cameras with these names."""
        which = names[self.camera] if self.is_certain else " or ".join(names)
        return TrackWarning(
            f"{which} was moved at {self.time:.2f} s: turned by {self.motion.degrees:.2f} degrees,"
            f" its center by {self.motion.shift:.1f} mm. Its pose from then on was found from the"
            f" tags, and frames within {self.within:.2f} s of the move were left out. Run 'defsense"
            " capture camera arrange' before the next recording.",
            "camera-moved",
        )

    @property
    def record(self) -> dict[str, float | int | bool]:
        """Values for `quality.json`."""
        return {
            "camera": self.camera,
            "sure": self.is_certain,
            "time": self.time,
            "degrees": self.motion.degrees,
            "shift": self.motion.shift,
        }


@dataclass(frozen=True)
class RigPart:
    """Cameras between two moves.

    Attributes:
        rig: The cameras with their poses.
        start: First time, s.
        end: Time after the last, s.
    """

    rig: Rig
    start: float
    end: float

    def frames(self, time: Float) -> Bool:
        """Return which of the times (t,), s, are in this part."""
        return np.asarray((time >= self.start) & (time < self.end))

    def of(self, by_camera: Sequence[StoredObservations]) -> list[StoredObservations]:
        """Return the observations in this part."""
        return [s.only(self.frames(s.time)) for s in by_camera]


def find_moves(rig: Rig, by_camera: Sequence[StoredObservations], size: float) -> list[CameraMove]:
    """Find moves of the cameras during a recording.

    Args:
        rig: The cameras.
        by_camera: Observations of each camera, on one clock.
        size: Side of the tags, mm.
    """
    if len(rig.cameras) < 2 or not all(len(s.time) for s in by_camera):
        return []
    time, views_per_frame = by_camera[0].time, len(by_camera) * max(len(by_camera[0].ids), 1)
    stride = max(int(np.ceil(len(time) * views_per_frame / MAX_VIEWS)), 1)
    frames = np.arange(0, len(time), stride)
    views = shared_views(frames, *views_at_frames(by_camera, frames), size)
    moves = []
    period = float(np.median(np.diff(time[frames]))) if len(frames) > 1 else MOVE_MARGIN_S
    move_frames = int(np.ceil(MOVE_MARGIN_S / max(period, 1e-6)))
    for motion in find_camera_motion(rig.cameras, views, move_frames):
        at = (time[frames[motion.at - 1]] + time[frames[motion.at]]) / 2
        within = MOVE_MARGIN_S + (time[frames[motion.at]] - time[frames[motion.at - 1]]) / 2
        moves.append(_attribute_move(motion, by_camera, float(at), float(within)))
    return moves


def _attribute_move(
    motion: CameraMotion, by_camera: Sequence[StoredObservations], at: float, within: float
) -> CameraMove:
    """Attribute a move to the one of two cameras whose image jumped.

    The other camera's motion is the inverse, as far as the cameras' frames are the same
    (`divide_by_moves` ensures that).
    """
    if len(by_camera) != 2:
        return CameraMove(motion.camera, True, at, within, motion)
    nearby = [s.part(np.flatnonzero(np.abs(s.time - at) < COMPARED_S)) for s in by_camera]
    jumping = which_moved(
        [(observations.time, observations.corners.mean(axis=2)) for observations in nearby],
        at,
        within,
    )
    camera = motion.camera if jumping is None else jumping
    return CameraMove(camera, jumping is not None, at, within, motion)


def divide_by_moves(
    rig: Rig, moves: Sequence[CameraMove]
) -> tuple[list[RigPart], list[CameraMove]]:
    """Return the cameras between moves, and the moves as those of the cameras that made them."""
    cameras, parts, attributed = list(rig.cameras), [], []
    start = -np.inf
    for move in moves:
        parts.append(RigPart(replace(rig, cameras=tuple(cameras)), start, move.time))
        motion, start = move.motion, move.time
        if move.camera != motion.camera:
            motion = motion.of_other(cameras[motion.camera], cameras[move.camera], move.camera)
        cameras[move.camera] = motion.moved(cameras[move.camera])
        attributed.append(replace(move, motion=motion))
    parts.append(RigPart(replace(rig, cameras=tuple(cameras)), start, np.inf))
    return parts, attributed
