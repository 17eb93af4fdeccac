"""Where the tags were, by cameras as they really stood: in step, and not always where they were
arranged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.progress import Progress
from ..cameras.rig_file import Rig
from ..tracking.observations import StoredObservations
from .camera_sync import CameraSync, sync_cameras
from .located_tags import LocatedTags, joined, locate_tags
from .moved_camera import cameras_that_see, moved_camera, some_tags
from .moves_on_the_way import CameraMove, RigPart, find_moves, parts_of

_AGREE = 0.9  # of the views, that fit where moves are believed


@dataclass(frozen=True)
class Standing:
    """The tags as `located`; what the cameras saw by one clock, `seen`, and `shift` (v,) s that was
    added to their times; the clocks' comparison in each part between `moves`; or the camera that
    was `moved` before, and left out."""

    located: LocatedTags
    seen: Sequence[StoredObservations]
    shift: Sequence[float]
    clocks: Sequence[CameraSync]
    moves: Sequence[CameraMove]
    moved: int | None

    def shaken(self, time: Float) -> Bool:
        """Which of the times (t,) s are those of a move."""
        out = np.zeros(len(time), bool)
        for move in self.moves:
            out |= np.abs(time - move.time) <= move.within
        return out

    def warnings(self, names: Sequence[str], told: bool) -> list[str]:
        """What there is to say of the cameras, whose offsets were `told` or found."""
        out = [move.told(names) for move in self.moves]
        out += dict.fromkeys(note for c in self.clocks for note in c.warnings(names, told))
        if self.moved is not None:
            out.append(
                f"{names[self.moved]}: its views do not fit those of the other cameras, which fit"
                " together: it was moved since they were arranged, or is not in step; it was left"
                " out. Run 'defsense capture camera check'"
            )
        return out


def locate(
    rig: Rig, seen: Sequence[StoredObservations], size: float, frame: Camera, outlined: Int,
    told: bool, progress: Progress,
) -> Standing:  # fmt: skip
    """Tags of `size` mm in the `frame` of a camera, by what all `seen` of them, with the corners of
    the columns `outlined`; offsets that were `told` stay."""
    progress("tracks", 0.1, "comparing clocks")
    clocks = sync_cameras(rig, seen, told=told)
    by_one_clock = [replace(s, time=s.time + b) for s, b in zip(seen, clocks.shift, strict=True)]
    progress("tracks", 0.15, "looking for cameras that were moved")
    parts, moves = parts_of(rig, find_moves(rig, by_one_clock, size))
    progress("tracks", 0.2, "triangulating")
    if moves:
        out = _by_parts(parts, moves, by_one_clock, clocks.shift, size, frame, outlined, told)
        if _explains(out):
            return out
    found = locate_tags(rig.cameras, clocks.seen, size, frame, outlined)
    moved = None
    if len(rig.cameras) > 2:
        views = (
            some_tags(s, found.seen if s is clocks.seen else cameras_that_see(s))
            for s in (clocks.seen, seen)
        )
        moved = moved_camera(rig.cameras, views, size)
    if moved is not None:
        clocks = sync_cameras(rig, seen, told=told, without=moved)
        found = locate_tags(rig.cameras, clocks.seen, size, frame, outlined)
    return Standing(found, clocks.seen, clocks.shift, [clocks], (), moved)


def _by_parts(
    parts: Sequence[RigPart], moves: Sequence[CameraMove], seen: Sequence[StoredObservations],
    shift: Sequence[float], size: float, frame: Camera, outlined: Int, told: bool,
) -> Standing:  # fmt: skip
    clocks = [sync_cameras(part.rig, part.of(seen), told=told) for part in parts]
    found = joined(
        locate_tags(part.rig.cameras, c.seen, size, frame, outlined)
        for part, c in zip(parts, clocks, strict=True)
    )
    return Standing(found, seen, shift, clocks, moves, None)


def _explains(out: Standing) -> bool:
    """Whether the views fit each other as the cameras are said to have stood."""
    shared = (out.located.seen >= 2) & ~out.shaken(out.seen[0].time)[:, None]
    used, all_ = out.located.cameras[shared].sum(), out.located.seen[shared].sum()
    return bool(used >= _AGREE * max(all_, 1))
