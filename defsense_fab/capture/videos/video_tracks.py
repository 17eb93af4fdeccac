"""Make tracks of markers from videos of several cameras."""

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
from .camera_sync import Count, TrackWarning, views_of_tags
from .located_tags import LocatedTags, locate_scene
from .track_quality import measure_quality
from .video_detection import VideoDetections, detect_videos

#: Share of the tags seen by several cameras on which they agree; fewer mean a wrong calibration.
MIN_AGREEMENT = 0.5
MIN_USED_VIEWS = 0.9  # share of the views that agree with a right calibration
MAX_SCALE_ERROR = 0.03  # of the tags' size, if the order of the cameras is certain
MAX_PRINT_SCALE_ERROR = 0.07  # of the stated size: "fit to page" shrinks by up to 6 %
#: Root mean square, and relative to the median: with a larger residual, views of a tag are not of
#: one instant, or not of one tag.
MIN_OUTLIER_PX, OUTLIER_FACTOR = 0.3, 8.0
MAX_DISAGREEMENT = 0.5  # share of the tags that several cameras see in a frame
MIN_POSITIONS = 20  # from which outliers are determined
MAX_OFFSET_S = 1e6
MAX_RESIDUAL_PX = 0.25  # median; with more, cameras are not synchronous or were moved
MAX_ORDER_RESIDUAL_PX = 1.5  # of a credible order of the cameras


@dataclass(frozen=True)
class VideoTracks:
    """Tracks of m markers in the frame of a camera.

    Attributes:
        tracks: The tracks.
        cameras: Number of cameras of each position (t, m).
        quality: Values of `quality.json`; its `warnings` are `TrackWarning`s.
        outlined: Tags whose corners are kept (k,).
        corners: Their corners, where several cameras saw them (t, k, 4, 3), mm, in single
            precision.
    """

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
    """Make tracks from video files.

    Args:
        paths: Videos in the order of the calibration's cameras.
        calibration: File of the cameras.
        size: Side of the tags, mm.
        family: Family of the tags.
        rate: Frames per second of image sequences, Hz.
        offsets: Times to be added to those of each video, s; found by default.
        world: Whether tracks are in the world of the calibration instead of the first camera's
            frame; `quality` states the frame.
        progress: Receives progress.

    Raises:
        CaptureError: If files do not belong together, or no tag can be located.
    """
    if not 0.1 <= size <= 1000:
        raise CaptureError(
            f"a tag size of {size:g} mm is not possible",
            code="tag-size-out-of-range",
            where="size",
            action="Give the side of the black square, 0.1 to 1000 mm",
        )
    rig = read_rig(calibration)
    tags = dictionary(family)
    if len(paths) != len(rig.cameras):
        names = ", ".join(c.name for c in rig.cameras)
        raise CaptureError(
            f"has {len(rig.cameras)} cameras ({names}), but there are {len(paths)} videos",
            code="camera-count-differs",
            where=calibration,
            action="Give one video for each camera, in this order",
            cameras=len(rig.cameras),
            count=len(paths),
        )
    if not rig.placed:
        raise CaptureError(
            "does not state the poses of the cameras",
            code="camera-poses-missing",
            where=calibration,
            action="Run 'defsense capture camera arrange'",
        )
    if len({p.resolve() for p in paths}) < len(paths):
        raise CaptureError(
            "the same video is given twice",
            code="video-repeated",
            where="videos",
            action="Give one video for each camera",
        )
    check_offsets(offsets, len(paths))
    detections = detect_videos(paths, rig.cameras, tags, rate, progress)
    first = rig.cameras[0]
    world_camera = replace(first, rotation=np.eye(3), translation=np.zeros(3))  # the world's axes
    tracks = assemble(
        detections,
        rig,
        size,
        [str(p) for p in paths],
        offsets,
        progress,
        world_camera if world else first,
    )
    frame = f"the world of {calibration}" if world else f"of camera {first.name}"
    return replace(tracks, quality={**tracks.quality, "frame": frame})


def assemble(
    detections: Sequence[VideoDetections],
    rig: Rig,
    size: float,
    names: Sequence[str],
    offsets: Sequence[float] | None = None,
    progress: Progress = silent,
    frame: Camera | None = None,
    outlined: Int | None = None,
) -> VideoTracks:
    """Make tracks from detections, at the times of the first camera's frames.

    Args:
        detections: Detections in each video.
        rig: The cameras.
        size: Side of the tags, mm.
        names: Names of the videos.
        offsets: Times to be added to those of each video, s; found by default.
        progress: Receives progress.
        frame: Camera in whose frame the tracks are; the first one by default.
        outlined: Tags whose corners are kept (k,).

    Raises:
        CaptureError: If the cameras do not agree, or no tag can be located.
    """
    given_offsets = check_offsets(offsets, len(detections))
    surveys = [video.tags.survey() for video in detections]
    ids = np.unique(np.concatenate([n for n, _ in surveys]))
    observations: list[StoredObservations] = []
    for video, offset in zip(detections, given_offsets, strict=True):
        is_new = np.append(True, np.diff(video.time) > 0)  # a repeated frame counts once
        # Stamps are late by different times of some ms, which looks like motion.
        observations.append(
            observe(
                even_frame_times(video.time[is_new]).time + offset, video.tags.only(is_new), ids
            )
        )
    time = observations[0].time
    outlined = np.intersect1d(ids, outlined if outlined is not None else [])
    column = np.searchsorted(ids, outlined)
    scene = locate_scene(
        rig, observations, size, frame or rig.cameras[0], column, offsets is not None, progress
    )
    located = scene.located
    _check_cameras(located, rig, scene.seen, size, names)
    progress("tracks", 0.7, "removing impossible positions")
    is_outlier = _find_outliers(located)
    disagreeing = _disagreeing_frames(located, is_outlier)
    is_outlier |= disagreeing[:, None] & (located.cameras >= 2)
    points, sigma = located.points, located.sigma
    points[is_outlier] = np.nan
    points[scene.is_moving(time)] = np.nan
    is_kept = find_reachable(time, points, sigma)
    impossible = int((np.isfinite(points[..., 0]) & ~is_kept).sum())
    points[~is_kept], sigma[~is_kept] = np.nan, np.nan
    has_position = is_kept.any(axis=0)
    if not has_position.any():
        raise CaptureError(
            "no tag could be located in any frame",
            code="no-tag-located",
            where=", ".join(names),
            action="Check that the tags are visible and that the calibration is right",
        )
    number = np.flatnonzero(np.append(True, np.diff(detections[0].time) > 0))
    cameras = np.where(is_kept, located.cameras, np.int8(0))
    located.corners[cameras[:, column] < 2] = np.nan
    if not has_position.all():
        points, sigma, cameras = (
            points[:, has_position],
            sigma[:, has_position],
            cameras[:, has_position],
        )
    tracks = Tracks(time, ids[has_position], points, sigma, number)
    progress("tracks", 1.0, "done")
    repeated = [repeated_numbers for _, repeated_numbers in surveys]
    quality = measure_quality(
        detections, repeated, located, is_kept, impossible, tracks, cameras, size, names
    )
    quality["offsets"] = [a + b for a, b in zip(given_offsets, scene.shift, strict=True)]
    quality["disagreeing"] = int(is_outlier.sum())
    quality["moved"] = [move.record for move in scene.moves]
    quality["warnings"] += scene.warnings(names, offsets is not None)
    quality["warnings"] += _agreement_warnings(
        located, is_outlier, disagreeing, time, quality["residual"]
    )
    return VideoTracks(tracks, cameras, quality, outlined, located.corners)


def _agreement_warnings(
    located: LocatedTags,
    is_outlier: Bool,
    disagreeing: Bool,
    time: Float,
    residual: float | None,
) -> list[TrackWarning]:
    """Return warnings about cameras that disagree."""
    warnings: list[TrackWarning] = []
    by_three = located.seen >= 3
    disagrees = by_three & (located.cameras >= 2) & (located.cameras < located.seen)
    if disagrees.sum() > (1 - MIN_USED_VIEWS) * max(by_three.sum(), 1):
        share, first = disagrees.sum() / by_three.sum(), time[disagrees.any(axis=1)][0]
        warnings.append(
            TrackWarning(
                "Of the tags that three cameras see, one camera disagrees on"
                f" {share:.0%}, first at {first:.2f} s, and was left out there. Check whether it"
                " was moved.",
                "camera-disagrees",
            )
        )
    if disagreeing.any():
        warnings.append(
            TrackWarning(
                f"In {int(disagreeing.sum())} frames, the first at {time[disagreeing][0]:.2f} s,"
                " the cameras' views of most tags disagree, because a camera was moved or its"
                " times jump. These positions were left out.",
                "cameras-disagree",
            )
        )
    if is_outlier.any():
        warnings.append(
            TrackWarning(
                f"{int(is_outlier.sum())} positions were left out, because the cameras' views of"
                " the tag disagree.",
                "positions-left-out",
            )
        )
    if (residual or 0.0) > MAX_RESIDUAL_PX:
        warnings.append(
            TrackWarning(
                f"The cameras' views differ by {residual:.2f} px, because they are not"
                " synchronous or one was moved since the calibration. Positions may be wrong by"
                " millimeters.",
                "residual-large",
            )
        )
    return warnings


def check_offsets(offsets: Sequence[float] | None, count: int) -> list[float]:
    """Return offsets relative to the first one (count,), s; zero if none are given.

    Raises:
        CaptureError: If they are invalid.
    """
    if offsets is None:
        return [0.0] * count
    if len(offsets) != count:
        raise CaptureError(
            f"{len(offsets)} offsets are given for {count} cameras",
            code="offset-count-differs",
            where="offsets",
            action="Give one offset for each camera",
            count=len(offsets),
        )
    if not all(abs(s) < MAX_OFFSET_S for s in offsets):
        raise CaptureError(
            f"{', '.join(f'{s:g}' for s in offsets)} are not valid offsets",
            code="offset-invalid",
            where="offsets",
            action="Give the seconds to be added to each video's times",
        )
    return [s - offsets[0] for s in offsets]


def _find_outliers(located: LocatedTags) -> Bool:
    """Return positions (t, m) whose views differ much more than those of the others."""
    by_several = (located.cameras >= 2) & np.isfinite(located.miss)
    if by_several.sum() < MIN_POSITIONS:
        return np.zeros(by_several.shape, bool)
    limit = max(MIN_OUTLIER_PX, OUTLIER_FACTOR * float(np.median(located.miss[by_several])))
    # A tag with less exact corners may have a larger residual.
    sigma = np.linalg.norm(located.sigma, axis=2)
    relative_sigma = np.maximum(sigma / max(float(np.median(sigma[by_several])), 1e-12), 1.0)
    return np.asarray(
        by_several
        & (located.miss > limit * np.where(np.isfinite(relative_sigma), relative_sigma, 1.0))
    )


def _disagreeing_frames(located: LocatedTags, is_outlier: Bool) -> Bool:
    """Return frames (t,) in which the cameras' views of most tags disagree.

    The views that seem to agree in these frames do so by chance.
    """
    by_several = located.seen >= 2
    is_wrong = by_several & (is_outlier | (located.cameras < 2))
    return np.asarray(
        is_wrong.sum(axis=1) > MAX_DISAGREEMENT * np.maximum(by_several.sum(axis=1), 1)
    )


def _check_cameras(
    located: LocatedTags,
    rig: Rig,
    observations: Sequence[ObservationSource],
    size: float,
    names: Sequence[str],
) -> None:
    """Raise CaptureError if cameras disagree, or tags have another size than stated."""
    by_several = located.seen >= 2
    if len(rig.cameras) < 2 or by_several.sum() < 3:
        return
    agreement = float((located.cameras[by_several] >= 2).mean())
    scale = float(np.nanmedian(located.sides)) / size if agreement else 0.0
    is_credible = agreement >= MIN_AGREEMENT and abs(scale - 1) <= MAX_PRINT_SCALE_ERROR
    is_right = is_credible and abs(scale - 1) <= MAX_SCALE_ERROR
    used = float(located.cameras[by_several].sum() / located.seen[by_several].sum())
    if is_right and used >= MIN_USED_VIEWS and float(np.nanmedian(located.miss)) <= MAX_RESIDUAL_PX:
        return
    rows = np.argwhere(by_several)
    sample = rows[:: max(len(rows) // (200 if len(rig.cameras) < 5 else 30), 1)]
    order = _find_order(rig, *views_of_tags(observations, sample), size, located)
    if order is not None:
        pairs = ", ".join(
            f"{name} is of {rig.cameras[k].name}" for name, k in zip(names, order, strict=True)
        )
        raise CaptureError(
            f"the videos are in another order than the cameras: it seems that {pairs}",
            code="camera-order-differs",
            where="videos",
            action="Give the videos in the order of the cameras",
            order=order,
        )
    if is_credible:
        return
    if agreement < MIN_AGREEMENT:
        raise CaptureError(
            "the views do not fit the calibration: of the tags that several cameras see, only"
            f" {agreement:.0%} agree",
            code="calibration-wrong",
            where="cameras",
            action=(
                "Run 'defsense capture camera check' to see whether a camera was moved, or give the"
                " offsets of videos that started more than some seconds apart"
            ),
        )
    guess = next(
        (u for u, f in (("m", 1e3), ("cm", 10.0), ("inches", 25.4)) if 0.8 < scale * f < 1.25),
        None,
    )
    why = f", because the calibration is in {guess}" if guess else ""
    raise CaptureError(
        f"tags of {size:g} mm look {scale * size:.3g} mm large to these cameras{why}",
        code="calibration-unit-wrong" if guess else "tag-size-wrong",
        where="cameras",
        action=(
            "Calibrate in mm"
            if guess
            else f"Measure the black square of a tag ({scale * size:.2f} mm?) and the board's"
            " squares, and check whether a camera was moved"
        ),
        unit=guess,
        measured=scale * size,
    )


def _find_order(
    rig: Rig, corners: Float, covariance: Float, size: float, located: LocatedTags
) -> tuple[int, ...] | None:
    """Return the order of cameras that fits better than the stated one, if there is one.

    Args:
        rig: The cameras in the stated order.
        corners: Corners of some tags (n, v, 4, 2), px.
        covariance: Their covariances (n, v, 5, 2, 2), px^2.
        size: Side of the tags, mm.
        located: Tags located in the stated order.
    """
    agreement = located.cameras[located.seen >= 2]
    residual = (
        float(np.median(located.miss[located.cameras >= 2])) if (agreement >= 2).any() else np.inf
    )
    best: tuple[float, tuple[int, ...]] | None = None
    for order in list(itertools.permutations(range(len(rig.cameras))))[1:]:
        cameras = [rig.cameras[k] for k in order]
        # Corners are without distortion, but in pixels of the stated camera.
        converted = np.stack(
            [
                (corners[:, c] - old.matrix[:2, 2]) / old.focal * new.focal + new.matrix[:2, 2]
                for c, (old, new) in enumerate(zip(rig.cameras, cameras, strict=True))
            ],
            axis=1,
        )
        candidate = reconstruct(cameras, converted[:, None], covariance[:, None], size)
        by_several = candidate.seen >= 2
        if (candidate.cameras[by_several] < 2).mean() > 0.2:
            continue
        scale = float(np.nanmedian(candidate.sides)) / size
        candidate_residual, gain = (
            float(np.nanmedian(candidate.miss)),
            candidate.cameras[by_several].mean() - agreement.mean(),
        )
        if (
            candidate_residual < MAX_ORDER_RESIDUAL_PX
            and abs(scale - 1) <= MAX_SCALE_ERROR
            and (gain > 0.3 or candidate_residual < residual / 2)
        ):
            best = min(best or (np.inf, order), (candidate_residual, order))
    return best[1] if best else None
