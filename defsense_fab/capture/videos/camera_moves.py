"""Cameras that were moved while they recorded: when, by how much, and how they stand from then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float
from ..cameras.rig_file import Rig
from ..tracking.camera_motion import CameraMotion, find_camera_motion, which_moved
from ..tracking.observations import ObservationSource, StoredObservations
from ..tracking.pose_equations import shared_views
from .camera_sync import together

_VIEWS = 40_000  # tags times cameras that are looked at, over all frames
_NEAR = 20.0  # s beside a move, whose pictures are compared with those at it
_SHAKES = 0.15  # s, that a camera may need for its move, to either side


@dataclass(frozen=True)
class CameraMove:
    """A camera of index `camera`, or, of two, perhaps the other (not `sure`), was moved at `time`
    s, known and done to +- `within` s; `motion` is its own."""

    camera: int
    sure: bool
    time: float
    within: float
    motion: CameraMotion

    def told(self, names: Sequence[str]) -> str:
        """What there is to say of it."""
        which = names[self.camera] if self.sure else " or ".join(names)
        return (
            f"{which} was moved at {self.time:.2f} s: turned by {self.motion.degrees:.2f} degrees,"
            f" its centre by {self.motion.shift:.1f} mm; where it stands from then on was found"
            f" from the tags, and what was seen within {self.within:.2f} s of it was left out. Run"
            " 'defsense capture camera arrange' before the next recording"
        )

    @property
    def record(self) -> dict[str, float | int | bool]:
        """For `quality.json`."""
        return {
            "camera": self.camera, "sure": self.sure, "time": self.time,
            "degrees": self.motion.degrees, "shift": self.motion.shift,
        }  # fmt: skip


@dataclass(frozen=True)
class RigPart:
    """The rig as it stands in [`start`, `end`) s."""

    rig: Rig
    start: float
    end: float

    def frames(self, time: Float) -> Bool:
        """Which of the times (t,) s are within it."""
        return np.asarray((time >= self.start) & (time < self.end))

    def of(self, seen: Sequence[StoredObservations]) -> list[StoredObservations]:
        """What the cameras saw within it."""
        return [s.only(self.frames(s.time)) for s in seen]


def find_moves(rig: Rig, seen: Sequence[ObservationSource], size: float) -> list[CameraMove]:
    """By tags of `size` mm that several cameras saw, all by one clock."""
    if len(rig.cameras) < 2 or not all(len(s.time) for s in seen):
        return []
    time, each = seen[0].time, len(seen) * max(len(seen[0].ids), 1)
    stride = max(int(np.ceil(len(time) * each / _VIEWS)), 1)
    frames = np.arange(0, len(time), stride)
    views = shared_views(frames, *together(seen, frames), size)
    moves = []
    period = float(np.median(np.diff(time[frames]))) if len(frames) > 1 else _SHAKES
    takes = int(np.ceil(_SHAKES / max(period, 1e-6)))
    for motion in find_camera_motion(rig.cameras, views, takes):
        at = (time[frames[motion.at - 1]] + time[frames[motion.at]]) / 2
        within = _SHAKES + (time[frames[motion.at]] - time[frames[motion.at - 1]]) / 2
        moves.append(_by_picture(motion, seen, float(at), float(within)))
    return moves


def _by_picture(
    motion: CameraMotion, seen: Sequence[ObservationSource], at: float, within: float
) -> CameraMove:
    """Of two cameras it is the one whose picture jumped; the other's motion is the inverse, as far
    as the cameras' frames are the same (`parts_of` brings them there)."""
    if len(seen) != 2:
        return CameraMove(motion.camera, True, at, within, motion)
    near = [s.part(np.flatnonzero(np.abs(s.time - at) < _NEAR)) for s in seen]
    jumped = which_moved([(o.time, o.corners.mean(axis=2)) for o in near], at, within)
    which = motion.camera if jumped is None else jumped
    return CameraMove(which, jumped is not None, at, within, motion)


def parts_of(rig: Rig, moves: Sequence[CameraMove]) -> tuple[list[RigPart], list[CameraMove]]:
    """The rig between moves, and the moves as those of the cameras that made them."""
    cameras, parts, own = list(rig.cameras), [], []
    start = -np.inf
    for move in moves:
        parts.append(RigPart(replace(rig, cameras=tuple(cameras)), start, move.time))
        motion, start = move.motion, move.time
        if move.camera != motion.camera:
            motion = motion.of_other(cameras[motion.camera], cameras[move.camera], move.camera)
        cameras[move.camera] = motion.moved(cameras[move.camera])
        own.append(replace(move, motion=motion))
    parts.append(RigPart(replace(rig, cameras=tuple(cameras)), start, np.inf))
    return parts, own
