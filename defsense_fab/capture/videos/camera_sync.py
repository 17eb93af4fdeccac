"""Cameras brought in step with the first one, by how the tags move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ..cameras.rig_file import Rig
from ..tracking.camera_clocks import FrameDrops, find_frame_drops, find_offset
from ..tracking.observations import ObservationSource, StoredObservations, frame_blocks, interpolate

_REACH, _IN_STEP = 0.25, 1e-3  # s, between clocks: looked for, and not worth a correction
_APART = 10.0  # s, between videos that were begun by hand
_CLOSE, _BETTER = 0.5, 0.5  # px that rays may miss by where an offset is believed; and of before
_FEW = 3  # frames that are not worth a word
_MOVES = 0.5  # px that a tag moves, for a picture that came twice to be wrong


@dataclass(frozen=True)
class CameraSync:
    """What v cameras saw, by the first one's clock; what was added to each one's times, `shift`
    (v,) s; where that changed on the way, `steps` by camera; and how many frames of each showed the
    picture before once more, `frozen` (v,), or fit no offset, `unfit` (v,)."""

    seen: list[StoredObservations]
    shift: list[float]
    steps: dict[int, FrameDrops]
    frozen: list[int]
    unfit: list[int]

    def warnings(self, names: Sequence[str], told: bool) -> list[str]:
        """What there is to say of it, `told` where the offsets were given."""
        out = [
            f"{name}: {count} frames show the picture before once more while things move, and were"
            " left out; is the video damaged, or was the computer too slow?"
            for name, count in zip(names, self.frozen, strict=True)
            if count
        ]
        out += [
            f"{name}: {count} frames do not fit those of {names[0]} at any offset near by, and were"
            " left out: was a camera moved on the way, or do its times jump?"
            for name, count in zip(names, self.unfit, strict=True)
            if count > _FEW
        ]
        if not told and any(self.shift):
            ms = ", ".join(f"{1e3 * s:+.1f}" for s in self.shift)
            out.append(
                f"the videos were not in step: {ms} ms added to their times, by how the tags move"
            )
        for c, steps in self.steps.items():
            by = np.diff(steps.offsets)
            where = ", ".join(
                f"{1e3 * b:+.0f} ms at {t:.2f} s"
                for t, b in list(zip(steps.change_times, by, strict=True))[:5]
            )
            lost = sorted({names[c] if b > 0 else names[0] for b in by})
            out.append(
                f"{names[c]}: fell out of step with {names[0]} {len(by)} times ({where}"
                f"{', ...' if len(by) > 5 else ''}): frames of {' and '.join(lost)} are missing"
                " without a gap in the time stamps; times were corrected by how the tags move, what"
                " is not certain was left out"
            )
        return out


def sync_cameras(
    rig: Rig, seen: Sequence[StoredObservations], *, told: bool, without: int | None = None
) -> CameraSync:
    """Cameras in step with the first one; offsets that were `told` stay. The views of one that is
    left out, `without`, are gone; where that is the first, its clock is taken for the second's."""
    if without is not None:
        kept = [c for c in range(len(seen)) if c != without]
        part = sync_cameras(
            Rig(tuple(rig.cameras[c] for c in kept)), [seen[c] for c in kept],
            told=told,
        )  # fmt: skip
        gone = seen[without]
        out = list(part.seen)
        out.insert(without, gone.without(np.ones(len(gone.time), bool)))
        shift, frozen, unfit = list(part.shift), list(part.frozen), list(part.unfit)
        shift.insert(without, 0.0)
        frozen.insert(without, 0)
        unfit.insert(without, 0)
        return CameraSync(out, shift, {kept[c]: s for c, s in part.steps.items()}, frozen, unfit)
    seen, frozen = _thawed(seen)
    shift, out, steps, unfit = [0.0], [seen[0]], {}, [0] * len(seen)
    for c, s in enumerate(seen[1:], 1):
        pair = [rig.cameras[0], rig.cameras[c]]
        near = None if told else find_offset(pair, seen[0], s, _REACH)
        begun = 0.0
        if not told and (near is None or near.after >= _CLOSE):
            begun = _begun(pair, seen[0], s)
            s = replace(s, time=s.time + begun)
        changed = find_frame_drops(pair, seen[0], s, _REACH)
        if changed is not None and not len(changed.change_times):
            fits = np.isfinite(changed.time)
            unfit[c] = int((~fits).sum())
            s = s.only(fits)
            near = None
        elif changed is not None:
            steps[c] = changed
            shift.append(begun + float(np.median(changed.offsets)))
            good = np.isfinite(changed.time)
            out.append(replace(s, time=changed.time).only(good))
            continue
        found = near
        if not told and (near is None or begun):
            found = find_offset(pair, seen[0], s, _REACH)
        late = (
            found is not None
            and abs(found.value) > max(_IN_STEP, 4 * found.sigma)
            and found.after < _BETTER * found.before
            and found.after < _CLOSE
        )
        by = found.value if found is not None and late else 0.0
        shift.append(begun + by)
        out.append(replace(s, time=s.time + by))
    return CameraSync(out, shift, steps, frozen, unfit)


def _begun(pair: list[Camera], first: ObservationSource, second: ObservationSource) -> float:
    """s, by about how much the second video began later, if that is more than clocks differ by."""
    far = find_offset(pair, first, second, _APART)
    if far is None or abs(far.value) <= _REACH - 0.05 or far.after > _CLOSE:
        return 0.0
    return far.value if far.after < _BETTER * far.before else 0.0


def together(seen: Sequence[ObservationSource], frames: Int) -> tuple[Float, Float]:
    """Corners (k, m, v, 4, 2) and covariances (k, m, v, 5, 2, 2) of all cameras at the times of
    frames (k,) of the first one."""
    ours = seen[0].part(frames)
    parts = [(ours.corners, ours.covariance), *(interpolate(s, ours.time) for s in seen[1:])]
    return np.stack([p[0] for p in parts], axis=2), np.stack([p[1] for p in parts], axis=2)


def views_of(seen: Sequence[ObservationSource], rows: Int) -> tuple[Float, Float]:
    """As `together`, of single tags: (n, v, 4, 2) and (n, v, 5, 2, 2) for `rows` (n, 2) of frames
    of the first camera and tags."""
    frames, place = np.unique(rows[:, 0], return_inverse=True)
    corners, covariance = together(seen, frames)
    return corners[place, rows[:, 1]], covariance[place, rows[:, 1]]


def _thawed(seen: Sequence[StoredObservations]) -> tuple[list[StoredObservations], list[int]]:
    """Without frames that repeat the picture before although things move: the camera's next picture
    shows it, or another camera does."""
    out, counts = [], []
    for c, s in enumerate(seen):
        wrong = np.zeros(len(s.time), bool)
        for a, b in _repeats(s):
            here = s.part(np.arange(a, min(b + 1, len(s.time)))[[0, -1]]).corners
            after = here[1] if b < len(s.time) else np.full_like(here[0], np.nan)
            if _moved(here[0], after) or any(
                _moves(o, s.time[a], s.time[b - 1]) for k, o in enumerate(seen) if k != c
            ):
                wrong[a + 1 : b] = True
        counts.append(int(wrong.sum()))
        # The others are interpolated; the first has the frames that are asked for.
        out.append(s.only(~wrong) if c else s.without(wrong))
    return out, counts


def _repeats(s: ObservationSource) -> list[tuple[int, int]]:
    """Runs of frames (from, to) in which all tags are at the very same place."""
    same = np.zeros(max(len(s.time) - 1, 0), bool)
    for frames in frame_blocks(len(same), len(s.ids)):
        flat = s.part(np.append(frames, frames[-1] + 1)).corners.reshape(len(frames) + 1, -1)
        there = np.isfinite(flat)
        alike = ((flat[1:] == flat[:-1]) | ~(there[1:] | there[:-1])).all(axis=1)
        same[frames] = alike & there[1:].any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    return [(int(a), int(b) + 1) for a, b in edges.reshape(-1, 2)]


def _moved(a: Float, b: Float) -> Bool:
    return np.asarray((np.abs(a - b) > _MOVES).any())


def _moves(s: ObservationSource, start: float, end: float) -> bool:
    """Whether tags move before a camera within a time, s."""
    rows = np.flatnonzero((s.time >= start) & (s.time <= end))
    if len(rows) < 2:
        return False
    first = s.part(rows[:1]).corners
    parts = (rows[1:][k] for k in frame_blocks(len(rows) - 1, len(s.ids)))
    return any(bool(_moved(s.part(part).corners, first)) for part in parts)
