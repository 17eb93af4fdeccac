"""Locate tags in every frame of the first camera, with cameras synchronized and at their real
poses.

Tags are located some seconds at a time. Cameras that were moved during the recording have the poses
found from the tags; one that was moved before is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.progress import Progress
from ..cameras.rig_file import Rig
from ..tracking.observations import StoredObservations, frame_blocks
from ..tracking.reconstruction import reconstruct
from .camera_moves import (
    CameraMove,
    RigPart,
    count_cameras,
    divide_by_moves,
    find_moved_camera,
    find_moves,
    sample_tags,
)
from .camera_sync import CameraSync, Count, TrackWarning, sync_cameras, views_at_frames

BLOCK_TAGS = 5_000  # located at once; each needs some kB


@dataclass(frozen=True)
class LocatedTags:
    """m tags in t frames, in a camera's frame.

    Attributes:
        points: Positions (t, m, 3), mm, NaN where not located.
        sigma: Standard deviations along the axes (t, m, 3), mm.
        cameras: Number of cameras that agree (t, m).
        miss: Root mean square residuals (t, m), px.
        sides: Mean sides of the tags as located by several cameras (t, m), mm.
        views: Number of cameras that see the tag (t, m).
        corners: Corners of selected tags (t, k, 4, 3), mm, in single precision.
    """

    points: Float
    sigma: Float
    cameras: Count
    miss: Float
    sides: Float
    views: Count
    corners: NDArray[np.float32]


def locate_tags(
    cameras: Sequence[Camera],
    by_camera: Sequence[StoredObservations],
    size: float,
    frame: Camera,
    outlined: Int,
) -> LocatedTags:
    """Locate tags by all cameras at the times of the first one's frames.

    Args:
        cameras: The cameras.
        by_camera: Observations of each camera.
        size: Side of the tags, mm.
        frame: Camera in whose frame the tags are returned.
        outlined: Columns of the tags whose corners are kept (k,).
    """
    shape = len(by_camera[0].time), len(by_camera[0].ids)
    tags = LocatedTags(
        np.empty((*shape, 3)),
        np.empty((*shape, 3)),
        np.empty(shape, np.int8),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape, np.int8),
        np.empty((len(by_camera[0].time), len(outlined), 4, 3), np.float32),
    )
    rotation = frame.rotation
    for frames in frame_blocks(*shape, BLOCK_TAGS):
        located = reconstruct(cameras, *views_at_frames(by_camera, frames), size)
        tags.points[frames] = frame.to_camera(located.points)
        rotated = rotation @ located.covariance @ rotation.T
        tags.sigma[frames] = np.sqrt(np.diagonal(rotated, axis1=-2, axis2=-1))
        tags.cameras[frames], tags.miss[frames] = located.cameras, located.miss
        tags.sides[frames], tags.views[frames] = located.sides, located.views
        tags.corners[frames] = frame.to_camera(located.corners[:, outlined])
    return tags


def join_tags(parts: Iterable[LocatedTags]) -> LocatedTags:
    """Join consecutive parts."""
    all_parts = list(parts)
    return LocatedTags(
        *(np.concatenate([getattr(p, f.name) for p in all_parts]) for f in fields(LocatedTags))
    )


MIN_AGREEMENT = 0.9  # share of the views that fit, if moves are credible


@dataclass(frozen=True)
class LocatedScene:
    """Located tags, and the state of the cameras.

    Attributes:
        located: The tags.
        by_camera: Observations of each camera, on one clock.
        shift: Times that were added to those of each camera (v,), s.
        clocks: Synchronization of the cameras in each part between moves.
        moves: Moves of cameras.
        moved_camera: Camera that was moved before the recording, and left out.
    """

    located: LocatedTags
    by_camera: Sequence[StoredObservations]
    shift: Sequence[float]
    clocks: Sequence[CameraSync]
    moves: Sequence[CameraMove]
    moved_camera: int | None

    def is_moving(self, time: Float) -> Bool:
        """Return which of the times (t,), s, are those of a move."""
        out = np.zeros(len(time), bool)
        for move in self.moves:
            out |= np.abs(time - move.time) <= move.within
        return out

    def warnings(self, names: Sequence[str], offsets_given: bool) -> list[TrackWarning]:
        """Return the warnings about the cameras.

        Args:
            names: Names of the cameras.
            offsets_given: Whether the offsets were given.
        """
        notes = [move.warning(names) for move in self.moves]
        notes += dict.fromkeys(
            note for c in self.clocks for note in c.warnings(names, offsets_given)
        )
        if self.moved_camera is not None:
            notes.append(
                TrackWarning(
                    f"{names[self.moved_camera]}: its views do not fit those of the other cameras,"
                    " which fit each other. It was moved since the calibration, or is not"
                    " synchronous, and was left out. Run 'defsense capture camera check'.",
                    "camera-left-out",
                )
            )
        return notes


def locate_scene(
    rig: Rig,
    by_camera: Sequence[StoredObservations],
    size: float,
    frame: Camera,
    outlined: Int,
    offsets_given: bool,
    progress: Progress,
) -> LocatedScene:
    """Locate tags, and find out whether cameras were moved.

    Args:
        rig: The cameras.
        by_camera: Observations of each camera.
        size: Side of the tags, mm.
        frame: Camera in whose frame the tags are returned.
        outlined: Columns of the tags whose corners are kept (k,).
        offsets_given: Whether the offsets were given, so they stay.
        progress: Receives progress.
    """
    progress("tracks", 0.1, "comparing clocks")
    clocks = sync_cameras(rig, by_camera, offsets_given=offsets_given)
    by_one_clock = [
        replace(observations, time=observations.time + shift)
        for observations, shift in zip(by_camera, clocks.shift, strict=True)
    ]
    progress("tracks", 0.15, "finding cameras that were moved")
    parts, moves = divide_by_moves(rig, find_moves(rig, by_one_clock, size))
    progress("tracks", 0.2, "triangulating")
    if moves:
        scene = _locate_parts(
            parts, moves, by_one_clock, clocks.shift, size, frame, outlined, offsets_given
        )
        if _is_consistent(scene):
            return scene
    located = locate_tags(rig.cameras, clocks.by_camera, size, frame, outlined)
    moved_camera = None
    if len(rig.cameras) > 2:
        views = (
            sample_tags(
                observations,
                located.views if observations is clocks.by_camera else count_cameras(observations),
            )
            for observations in (clocks.by_camera, by_camera)
        )
        moved_camera = find_moved_camera(rig.cameras, views, size)
    if moved_camera is not None:
        clocks = sync_cameras(rig, by_camera, offsets_given=offsets_given, excluded=moved_camera)
        located = locate_tags(rig.cameras, clocks.by_camera, size, frame, outlined)
    return LocatedScene(located, clocks.by_camera, clocks.shift, [clocks], (), moved_camera)


def _locate_parts(
    parts: Sequence[RigPart],
    moves: Sequence[CameraMove],
    by_camera: Sequence[StoredObservations],
    shift: Sequence[float],
    size: float,
    frame: Camera,
    outlined: Int,
    offsets_given: bool,
) -> LocatedScene:
    clocks = [
        sync_cameras(part.rig, part.of(by_camera), offsets_given=offsets_given) for part in parts
    ]
    located = join_tags(
        locate_tags(part.rig.cameras, c.by_camera, size, frame, outlined)
        for part, c in zip(parts, clocks, strict=True)
    )
    return LocatedScene(located, by_camera, shift, clocks, moves, None)


def _is_consistent(scene: LocatedScene) -> bool:
    """Return whether the views fit the poses of the cameras."""
    shared = (scene.located.views >= 2) & ~scene.is_moving(scene.by_camera[0].time)[:, None]
    used, visible = scene.located.cameras[shared].sum(), scene.located.views[shared].sum()
    return bool(used >= MIN_AGREEMENT * max(visible, 1))
