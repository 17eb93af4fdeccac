"""From videos of several cameras to tracks of markers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ..cameras.rig_file import Rig, read_rig
from ..clocks.clock_fit import even_frame_times
from ..tags.tag_patterns import dictionary
from ..tracking.observations import ObservationSource, StoredObservations, observe
from ..tracking.reconstruction import reconstruct
from ..tracking.track_filters import find_reachable
from .camera_sync import views_of
from .located_tags import Count, LocatedTags
from .standing_cameras import locate
from .tag_size import measured_size
from .video_detection import VideoDetections, detect_video

#: Of tags that several cameras see: if fewer of them agree, the calibration is wrong.
_AGREEING = 0.5
_USED = 0.9  # of the views, that agree where all is well
_SCALE = 0.03  # by which the located size of tags differs where the cameras' order is in no doubt
_WRONG = 0.07  # by which it may differ from the one that was told: "fit to page" takes up to 6 %
#: px, root mean square, and so many medians of it: views of a tag that miss by more are not of one
#: instant, or not of one tag.
_ODD, _ODDER = 0.3, 8.0
_APART = 0.5  # of the tags that several cameras see in a frame
_MANY = 20  # places, to tell what is odd
_FAR = 1e6  # s, offsets at most
_DISAGREE = 0.25  # px: a median above which the cameras are not in step, or have moved
_SHORT = 0.25  # s, difference of length that is worth a word
_CLOSE = 1.5  # px that a permutation of cameras must fit by to be believed


@dataclass(frozen=True)
class VideoTracks:
    """Tracks in the first camera's frame, the number of cameras that each place is from (t, m), and
    what there is to say of their quality; of the tags `outlined` (k,), where several cameras saw
    them, the `corners` (t, k, 4, 3) mm, in single precision."""

    tracks: Tracks
    cameras: Count
    quality: dict[str, Any]
    outlined: Int
    corners: NDArray[np.float32]


def process_videos(
    paths: Sequence[Path],
    calibration: Path,
    size: float,
    family: str,
    *,
    rate: float | None = None,
    offsets: Sequence[float] | None = None,
    world: bool = False,
    progress: Progress = silent,
) -> VideoTracks:
    """Tags of `size` mm in videos of the cameras in `calibration`, in its order; `rate` Hz of image
    sequences; `offsets` s, by which each camera's clock is behind the first one's; in the frame of
    the first camera, or in the `world` of the calibration: `quality` says which. Raises
    CaptureError for files that do not belong together, and where no tag can be located."""
    if not 0.1 <= size <= 1000:
        raise CaptureError(f"tag size {size:g} mm: give the side of the black square, 0.1 to 1000")
    rig = read_rig(calibration)
    tags = dictionary(family)
    if len(paths) != len(rig.cameras):
        names = ", ".join(c.name for c in rig.cameras)
        raise CaptureError(
            f"{calibration}: has {len(rig.cameras)} cameras ({names}), there are {len(paths)}"
            " videos; give one for each, in this order"
        )
    if not rig.placed:
        raise CaptureError(
            f"{calibration}: does not say where the cameras stand; run 'defsense capture camera"
            " arrange'"
        )
    if len({p.resolve() for p in paths}) < len(paths):
        raise CaptureError("the same video is given twice")
    check_offsets(offsets, len(paths))
    watched = detect_video(paths, rig.cameras, tags, rate, progress)
    first = rig.cameras[0]
    still = replace(first, rotation=np.eye(3), translation=np.zeros(3))  # the world's own axes
    found = assemble(
        watched, rig, size, [str(p) for p in paths], offsets, progress, still if world else first
    )
    frame = f"the world of {calibration}" if world else f"of camera {first.name}"
    return replace(found, quality={**found.quality, "frame": frame})


def assemble(
    watched: Sequence[VideoDetections],
    rig: Rig,
    size: float,
    names: Sequence[str],
    offsets: Sequence[float] | None = None,
    progress: Progress = silent,
    frame: Camera | None = None,
    outlined: Int | None = None,
) -> VideoTracks:
    """Tracks from what the cameras saw, at the times of the first one and in its frame, or in that
    of the camera `frame`; where no offsets are given they are found. Of the tags `outlined`
    (k,) the corners are kept. Raises CaptureError where the cameras do not agree."""
    told = check_offsets(offsets, len(watched))
    numbers = [w.tags.survey() for w in watched]
    ids = np.unique(np.concatenate([n for n, _ in numbers]))
    seen: list[StoredObservations] = []
    for w, s in zip(watched, told, strict=True):
        first = np.append(True, np.diff(w.time) > 0)  # a frame that came twice counts once
        # Stamps come late by some ms, each by another time, which looks like motion.
        seen.append(observe(even_frame_times(w.time[first]).time + s, w.tags.only(first), ids))
    time = seen[0].time
    outlined = np.intersect1d(ids, outlined if outlined is not None else [])
    column = np.searchsorted(ids, outlined)
    standing = locate(
        rig, seen, size, frame or rig.cameras[0], column, offsets is not None, progress
    )
    found = standing.located
    _check(found, rig, standing.seen, size, names)
    progress("tracks", 0.7, "looking for what cannot be")
    odd = _odd(found)
    apart = _apart(found, odd)
    odd |= apart[:, None] & (found.cameras >= 2)
    points, sigma = found.points, found.sigma
    points[odd] = np.nan
    points[standing.shaken(time)] = np.nan
    keep = find_reachable(time, points, sigma)
    wrong = int((np.isfinite(points[..., 0]) & ~keep).sum())
    points[~keep], sigma[~keep] = np.nan, np.nan
    there = keep.any(axis=0)
    if not there.any():
        raise CaptureError(f"{', '.join(names)}: no tag could be located in any frame")
    number = np.flatnonzero(np.append(True, np.diff(watched[0].time) > 0))
    cameras = np.where(keep, found.cameras, np.int8(0))
    found.corners[cameras[:, column] < 2] = np.nan
    if not there.all():
        points, sigma, cameras = points[:, there], sigma[:, there], cameras[:, there]
    tracks = Tracks(time, ids[there], points, sigma, number)
    progress("tracks", 1.0, "done")
    twice = [again for _, again in numbers]
    quality = _quality(watched, twice, found, keep, wrong, tracks, cameras, size, names)
    quality["offsets"] = [a + b for a, b in zip(told, standing.shift, strict=True)]
    quality["disagreeing"] = int(odd.sum())
    quality["moved"] = [move.record for move in standing.moves]
    quality["warnings"] += standing.warnings(names, offsets is not None)
    shared = found.seen >= 3
    out = shared & (found.cameras >= 2) & (found.cameras < found.seen)
    if out.sum() > (1 - _USED) * max(shared.sum(), 1):
        quality["warnings"].append(
            f"of the tags that three cameras see, one disagrees on {out.sum() / shared.sum():.0%},"
            f" first at {time[out.any(axis=1)][0]:.2f} s, and was left out there: was it moved?"
        )
    if apart.any():
        quality["warnings"].append(
            f"in {int(apart.sum())} frames, the first at {time[apart][0]:.2f} s, the cameras' views"
            " of most tags disagree: a camera was moved, or its times jump; what they see together"
            " there was left out"
        )
    if odd.any():
        quality["warnings"].append(
            f"{int(odd.sum())} places were left out: the cameras' views of the tag disagree"
        )
    if (quality["residual"] or 0.0) > _DISAGREE:
        quality["warnings"].append(
            f"the cameras' views miss each other by {quality['residual']:.2f} px: they are not in"
            " step, or one was moved since it was arranged; places may be wrong by millimetres"
        )
    return VideoTracks(tracks, cameras, quality, outlined, found.corners)


def check_offsets(offsets: Sequence[float] | None, count: int) -> list[float]:
    """Offsets (count,) s by the first camera's clock, zero where none are given. Raises
    CaptureError."""
    if offsets is None:
        return [0.0] * count
    if len(offsets) != count:
        raise CaptureError(f"offsets: {len(offsets)} given for {count} cameras; give one for each")
    if not all(abs(s) < _FAR for s in offsets):
        raise CaptureError(
            f"offsets {', '.join(f'{s:g}' for s in offsets)}: give seconds, what is to be added to"
            " each video's times"
        )
    return [s - offsets[0] for s in offsets]


def _odd(found: LocatedTags) -> Bool:
    """Places (t, m) of which the views miss each other much more than those of the others do."""
    several = (found.cameras >= 2) & np.isfinite(found.miss)
    if several.sum() < _MANY:
        return np.zeros(several.shape, bool)
    limit = max(_ODD, _ODDER * float(np.median(found.miss[several])))
    # A tag whose corners are told to be less exact than those of others may miss by more.
    sigma = np.linalg.norm(found.sigma, axis=2)
    less = np.maximum(sigma / max(float(np.median(sigma[several])), 1e-12), 1.0)
    return np.asarray(several & (found.miss > limit * np.where(np.isfinite(less), less, 1.0)))


def _apart(found: LocatedTags, odd: Bool) -> Bool:
    """Frames (t,) in which the cameras' views of most tags disagree: those that seem to agree do so
    by chance."""
    several = found.seen >= 2
    wrong = several & (odd | (found.cameras < 2))
    return np.asarray(wrong.sum(axis=1) > _APART * np.maximum(several.sum(axis=1), 1))


def _check(
    found: LocatedTags,
    rig: Rig,
    seen: Sequence[ObservationSource],
    size: float,
    names: Sequence[str],
) -> None:
    """Raises CaptureError where cameras disagree, or tags are of another size than told."""
    several = found.seen >= 2
    if len(rig.cameras) < 2 or several.sum() < 3:
        return
    agreeing = float((found.cameras[several] >= 2).mean())
    scale = float(np.nanmedian(found.sides)) / size if agreeing else 0.0
    believable = agreeing >= _AGREEING and abs(scale - 1) <= _WRONG
    right = believable and abs(scale - 1) <= _SCALE
    used = float(found.cameras[several].sum() / found.seen[several].sum())
    if right and used >= _USED and float(np.nanmedian(found.miss)) <= _DISAGREE:
        return
    rows = np.argwhere(several)
    some = rows[:: max(len(rows) // (200 if len(rig.cameras) < 5 else 30), 1)]
    other = _permuted(rig, *views_of(seen, some), size, found)
    if other is not None:
        pairs = ", ".join(
            f"{name} is of {rig.cameras[k].name}" for name, k in zip(names, other, strict=True)
        )
        raise CaptureError(
            f"the videos are in another order than the cameras: it seems that {pairs}"
        )
    if believable:
        return
    if agreeing < _AGREEING:
        raise CaptureError(
            "the views do not fit the calibration: of the tags that several cameras see, only"
            f" {agreeing:.0%} agree; has a camera been moved, or is a video of another camera?"
            " Run 'defsense capture camera check', then arrange again; where videos began more than"
            " some seconds apart, tell by how much (--offsets)"
        )
    guess = next(
        (u for u, f in (("m", 1e3), ("cm", 10.0), ("inches", 25.4)) if 0.8 < scale * f < 1.25),
        None,
    )
    why = (
        f"the calibration is in {guess}, it must be in mm"
        if guess
        else f"measure the black square of a tag (--tag-size {scale * size:.2f}?), and the board's"
        " squares; or has a camera been moved?"
    )
    raise CaptureError(
        f"tags of {size:g} mm look {scale * size:.3g} mm large to these cameras: {why}"
    )


def _permuted(
    rig: Rig, corners: Float, covariance: Float, size: float, told: LocatedTags
) -> tuple[int, ...] | None:
    """Cameras in the order that fits some tags (n, v, 4, 2) better than that which was `told`, if
    any."""
    agree = told.cameras[told.seen >= 2]
    fit = float(np.median(told.miss[told.cameras >= 2])) if (agree >= 2).any() else np.inf
    best: tuple[float, tuple[int, ...]] | None = None
    for order in list(itertools.permutations(range(len(rig.cameras))))[1:]:
        cameras = [rig.cameras[k] for k in order]
        # Corners are without distortion but in pixels of the camera that was told.
        moved = np.stack(
            [
                (corners[:, c] - was.matrix[:2, 2]) / was.focal * is_.focal + is_.matrix[:2, 2]
                for c, (was, is_) in enumerate(zip(rig.cameras, cameras, strict=True))
            ],
            axis=1,
        )
        found = reconstruct(cameras, moved[:, None], covariance[:, None], size)
        many = found.seen >= 2
        if (found.cameras[many] < 2).mean() > 0.2:
            continue
        scale = float(np.nanmedian(found.sides)) / size
        miss, more = float(np.nanmedian(found.miss)), found.cameras[many].mean() - agree.mean()
        if miss < _CLOSE and abs(scale - 1) <= _SCALE and (more > 0.3 or miss < fit / 2):
            best = min(best or (np.inf, order), (miss, order))
    return best[1] if best else None


def _quality(
    watched: Sequence[VideoDetections],
    twice: Sequence[Int],
    found: LocatedTags,
    keep: Any,
    wrong: int,
    tracks: Tracks,
    cameras: Count,
    size: float,
    names: Sequence[str],
) -> dict[str, Any]:
    """Plain numbers on what was found, and warnings."""
    several, one = cameras >= 2, cameras == 1
    sigma = np.linalg.norm(tracks.sigma, axis=-1)
    videos, warnings = [], []
    for name, w in zip(names, watched, strict=True):
        t = w.timing
        videos.append(
            {
                "name": name, "frames": len(w.time), "expected": w.expected,
                "missing": t.missing, "repeated": t.repeated, "period": t.period,
                "tags_per_frame": float(w.tags.count.mean()),
            }
        )  # fmt: skip
        if w.expected > len(w.time) + 1:
            warnings.append(
                f"{name}: ends early, after {len(w.time)} of {w.expected} frames; is it damaged?"
            )
        if t.missing or t.repeated:
            warnings.append(
                f"{name}: {t.missing} frames missing and {t.repeated} repeated, by its time stamps"
            )
    spans = [w.time[-1] - w.time[0] for w in watched]
    if len(spans) > 1 and max(spans) - min(spans) > _SHORT:
        told = ", ".join(f"{s:.1f}" for s in spans)
        warnings.append(f"the videos are of different length ({told} s): the rest is from fewer")
    if several.any() and one.sum() > several.sum():
        warnings.append("most places are from one camera alone: their depth is uncertain")
    if one.any() and not several.any() and len(watched) > 1:
        warnings.append("all places are from one camera alone: their depth is uncertain")
    for name, w, again in zip(names, watched, twice, strict=True):
        if not w.tags.count.any():
            warnings.append(f"{name}: shows no tag in any frame; is it the right video?")
        if len(again):
            numbers = ", ".join(map(str, again.tolist()))
            warnings.append(
                f"{name}: shows tags {numbers} twice at once; print each number once, or cover what"
                " is a reflection"
            )
    never = sorted(set(tracks.ids.tolist()) - set(tracks.ids[several.any(axis=0)].tolist()))
    if never and len(watched) > 1:
        warnings.append(f"tags {', '.join(map(str, never))} were never seen by two cameras at once")
    measured = measured_size(np.where(keep, found.sides, np.nan), size)
    if measured is not None and measured.warning is not None:
        warnings.append(measured.warning)
    with np.errstate(all="ignore"):
        return {
            "frames": len(tracks.time),
            "markers": len(tracks.ids),
            "seen": float(tracks.seen.mean()),
            "by_several": float(several.mean()),
            "by_one": float(one.mean()),
            "impossible": wrong,
            "residual": _median(found.miss[keep & (found.cameras >= 2)]),
            "sigma_several": _median(sigma[several]),
            "sigma_one": _median(sigma[one]),
            "size": None if measured is None else measured.side,
            "size_sigma": None if measured is None else measured.sigma,
            "tag_size": size,
            "videos": videos,
            "warnings": warnings,
        }


def _median(values: Float) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
