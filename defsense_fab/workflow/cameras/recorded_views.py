"""Cameras calibrated, arranged and checked from recorded views of a board."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.cameras.extrinsics import estimate_extrinsics
from ...capture.cameras.image_sources import Video, run_in_threads
from ...capture.cameras.intrinsics import Intrinsics, calibrate_camera
from ...capture.cameras.rig_check import Diagnosis, check_rig, diagnose
from ...capture.cameras.rig_file import Rig, read_rig, write_rig
from ...capture.cameras.view_selection import (
    Coverage,
    choose_views,
    corner_motion,
    describe_view,
    measure_coverage,
)
from ...capture.tags.detection import BoardFinder, BoardView, image_size_error
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.camera import Camera, check_names
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ...report.cameras_page import write_report

#: Views that a calibration is made of at most, and that are wanted.
MOST, WANTED = 60, 25
_TOGETHER = 40  # instants of several cameras
_ARRANGED = ("error", "board_error")  # what is only known of cameras that were arranged
_BAD = 0.5  # px, and mm: more is no good arrangement


@dataclass(frozen=True)
class Seen:
    """A board in t frames of a video: image `size`; `time` (t,) s; the `views`, None where it was
    not found; `stills` where the frames are single pictures."""

    size: tuple[int, int]
    time: Float
    views: tuple[BoardView | None, ...]
    stills: bool


def look(
    paths: Sequence[Path],
    board: CharucoBoard,
    rate: float | None = None,
    progress: Progress = silent,
) -> list[Seen]:
    """Find the board in videos or folders of images. Raises CaptureError for what is none."""
    videos = [Video(p, rate if not p.is_dir() else rate or 1.0) for p in paths]
    total, done = max(sum(v.expected for v in videos), 1), [0]

    def one(video: Video, stop: threading.Event) -> Seen:
        finder = BoardFinder(board)
        times, views = [], []
        for _, at, image in video.frames():
            if stop.is_set():
                break
            times.append(at)
            views.append(finder.find(image))
            done[0] += 1
            progress("board", min(done[0] / total, 1.0), f"{done[0]} frames")
        video.close()
        if not times:
            raise CaptureError(
                f"{video.path}: none of its frames can be read; check that the file is not damaged"
            )
        return Seen(video.size, np.array(times), tuple(views), video.path.is_dir())

    out = run_in_threads(one, videos, 4)
    progress("board", 1.0, "done")
    for path, seen in zip(paths, out, strict=True):
        if not any(seen.views):
            raise CaptureError(
                f"{path}: the board was found in none of {len(seen.views)} frames; check"
                f" that board.json describes this board ({board.columns} x {board.rows},"
                f" {board.dictionary})"
            )
    return out


@dataclass(frozen=True)
class Calibrated:
    """A camera's calibration, and what its views covered; plain numbers in `data`."""

    intrinsics: Intrinsics
    coverage: Coverage
    views: tuple[BoardView, ...]
    data: dict[str, Any]


def calibrate_views(
    name: str, size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView],
    wanted: int = WANTED, *, fisheye: bool = False,
) -> Calibrated:  # fmt: skip
    """A camera from chosen views, of which so many were wanted. Raises CaptureError where they do
    not tell."""
    found = calibrate_camera(name, size, board, views, fisheye=fisheye)
    covered = measure_coverage(views, board, size, wanted)
    c = found.camera
    data = {
        "name": name, "size": list(size), "error": found.error, "views": len(views),
        "left_out": int((~found.used).sum()), "focal": c.focal.tolist(),
        "focal_sigma": found.sigma[:2].tolist(), "center": c.matrix[:2, 2].tolist(),
        "distortions": c.distortions.tolist(), "coverage": covered.fraction,
        "errors": found.errors.tolist(), "hints": list(covered.hints),
    }  # fmt: skip
    return Calibrated(found, covered, tuple(views), data)


def calibrate_cameras(
    paths: Sequence[Path], names: Sequence[str], board: CharucoBoard, out: Path,
    rate: float | None = None, progress: Progress = silent, *, fisheye: bool = False,
) -> list[Calibrated]:  # fmt: skip
    """Intrinsics of the cameras that took these videos, into the file `out`, where they take the
    place of cameras of the same name. Raises CaptureError."""
    check_new_names(out, names)
    done = []
    for name, seen in zip(names, look(paths, board, rate, progress), strict=True):
        there = np.flatnonzero([v is not None for v in seen.views])
        views = [seen.views[k] for k in there]
        kept = [v for v in views if v is not None]
        d = np.array([describe_view(v, board, seen.size) for v in kept])
        chosen = choose_views(
            d, corner_motion(seen.views)[there], MOST, are_stills=seen.stills, allow_motion=True
        )
        progress("solve", 0.0, name)
        views_ = [kept[k] for k in chosen]
        done.append(calibrate_views(name, seen.size, board, views_, fisheye=fisheye))
    progress("solve", 1.0, "done")
    store(out, done, board)
    return done


def check_new_names(out: Path, names: Sequence[str]) -> None:
    """Raises CaptureError, before any work, for names that the file `out` cannot get: those that
    it has already are calibrated anew."""
    there = [c.name for c in read_rig(out).cameras] if out.exists() else []
    check_names([*(n for n in there if n not in names), *names])


def store(out: Path, done: Sequence[Calibrated], board: CharucoBoard) -> None:
    """Put calibrations into a file of cameras, with a report beside it."""
    cameras: dict[str, Camera] = {}
    metadata: dict[str, Any] = {}
    if out.exists():
        rig = read_rig(out)
        # Where one of them stands to the others is not known any more.
        cameras = {
            c.name: replace(c, rotation=np.eye(3), translation=np.zeros(3)) for c in rig.cameras
        }
        metadata = plain(rig)
        for key in _ARRANGED:
            metadata.pop(key, None)
    for d in done:
        c = d.intrinsics.camera
        metadata[f"sigma_{c.name}"] = d.intrinsics.sigma.tolist()
        metadata[f"error_{c.name}"] = d.intrinsics.error
        cameras[c.name] = c
    metadata |= _about(board) | {"adjusted": False}
    write_rig(out, list(cameras.values()), metadata)
    write_report(out.with_suffix(".html"), [(d.intrinsics, d.coverage, d.views) for d in done])


def _about(board: CharucoBoard) -> dict[str, Any]:
    return {
        "square": board.scale * board.square,
        "square_measured": board.measured is not None,
        "date": time.strftime("%Y-%m-%d"),
    }


def arrange_cameras(
    paths: Sequence[Path], board: CharucoBoard, calibration: Path,
    rate: float | None = None, progress: Progress = silent, *, keep: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Where the cameras stand that took these videos at the same time, into their file; see
    `finish_arranging`."""
    rig = rig_of(calibration, paths)
    check_world(rig, calibration, keep)
    seen = look(paths, board, rate, progress)
    instants = together(rig.cameras, seen, paths, board)
    progress("solve", 0.0, f"{len(instants)} boards")
    return finish_arranging(rig, board, instants, calibration, progress, keep=keep)


def sigma_of(rig: Rig, name: str) -> Float:
    """Standard deviations (9,) of a camera's parameters; zero, so that they stay as they are, where
    its file does not say."""
    try:
        sigma = np.array(rig.metadata.get(f"sigma_{name}", []), float)
    except (TypeError, ValueError):
        return np.zeros(9)
    known = sigma.shape == (9,) and np.isfinite(sigma).all() and (sigma >= 0).all()
    return sigma if known else np.zeros(9)


def plain(rig: Rig) -> dict[str, Any]:
    """Of a file's metadata what can be written again."""
    one = (bool, int, float, str)
    return {
        key: value
        for key, value in rig.metadata.items()
        if isinstance(value, one)
        or (isinstance(value, list) and all(isinstance(v, one) for v in value))
    }


def check_world(rig: Rig, calibration: Path, keep: bool) -> None:
    """Raises CaptureError where the file has no world that could be kept."""
    if keep and not rig.placed:
        raise CaptureError(
            f"{calibration}: does not say where the cameras stood, so that there is no world to"
            " keep; arrange them without --keep-world"
        )


def finish_arranging(
    rig: Rig, board: CharucoBoard, instants: Sequence[dict[int, BoardView]], out: Path,
    progress: Progress = silent, *, keep: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Solve and write; the numbers to tell. The first camera becomes the world's origin; or the
    world is one that others made, to `keep`, in which that camera stays where it was."""
    sigma = [sigma_of(rig, c.name) for c in rig.cameras]
    found = estimate_extrinsics(
        rig.cameras, board, instants, sigma if any(s.any() for s in sigma) else None
    )
    progress("solve", 1.0, "done")
    checked = check_rig(found.cameras, board, instants)
    metadata = plain(rig) | _about(board)
    metadata |= {"adjusted": True, "error": found.error, "board_error": checked.corner_error}
    first = rig.cameras[0]
    cameras = found.cameras if not keep else [_seen_from(c, first) for c in found.cameras]
    write_rig(out, cameras, metadata)
    distances = [float(np.linalg.norm(c.center - found.cameras[0].center)) for c in found.cameras]
    return {
        "error": found.error, "errors": found.errors.tolist(), "boards": len(instants),
        "shared": found.shared.tolist(), "distances": distances,
        "names": [c.name for c in found.cameras], "length_error": checked.corner_error,
        "square_measured": board.measured is not None,
        "warnings": _doubts(found.error, checked.corner_error),
        "frame": f"the world of {out}" if keep else f"of camera {first.name}",
    }  # fmt: skip


def _seen_from(camera: Camera, first: Camera) -> Camera:
    """A camera that stands in the frame of the `first`, in that one's world."""
    R, t = camera.rotation, camera.translation
    return replace(camera, rotation=R @ first.rotation, translation=R @ first.translation + t)


def _doubts(error: float, length: float) -> list[str]:
    """What there is to say of an arrangement that is not as good as it should be."""
    if not (error > _BAD or length > _BAD):
        return []
    return [
        f"the corners are off by {error:.2f} px and {length:.2f} mm; do not measure with these"
        " poses: check that the videos were started at the same time, that the board was held"
        " still, and that it is flat"
    ]


def check_cameras(
    paths: Sequence[Path], board: CharucoBoard, calibration: Path,
    rate: float | None = None, progress: Progress = silent,
) -> Diagnosis:  # fmt: skip
    """Whether the calibration still holds, by new views of the board, and why not."""
    rig = rig_of(calibration, paths)
    seen = look(paths, board, rate, progress)
    if len(paths) > 1:
        return diagnose(rig.cameras, board, together(rig.cameras, seen, paths, board))
    check_sizes(rig.cameras, [seen[0].size], paths)
    views = [{0: v} for v in seen[0].views if v is not None]
    return diagnose(rig.cameras, board, views[:: max(len(views) // _TOGETHER, 1)])


def check_sizes(
    cameras: Sequence[Camera], sizes: Sequence[tuple[int, int]], sources: Sequence[Path | str]
) -> None:
    """Raises CaptureError for a source whose images are not of its camera's size."""
    swapped = sorted(sizes) == sorted(c.size for c in cameras)
    more = "; the sources may be in another order than the cameras" if swapped else ""
    for size, camera, source in zip(sizes, cameras, sources, strict=True):
        if size != camera.size:
            raise image_size_error(camera, size, source, more)


def rig_of(calibration: Path, paths: Sequence[Path]) -> Rig:
    """The cameras of a file, one for each video or camera. Raises CaptureError."""
    rig = read_rig(calibration)
    if len(rig.cameras) != len(paths):
        names = ", ".join(c.name for c in rig.cameras)
        raise CaptureError(
            f"{calibration}: has {len(rig.cameras)} cameras ({names}), but {len(paths)}"
            " sources were given; give one for each camera, in this order"
        )
    return rig


def together(
    cameras: Sequence[Camera], seen: Sequence[Seen], paths: Sequence[Path], board: CharucoBoard
) -> list[dict[int, BoardView]]:
    """Instants at which several cameras saw the board, the most different of the stillest ones.
    Raises CaptureError for a video of another size than its camera's."""
    check_sizes(cameras, [s.size for s in seen], paths)
    moves = [corner_motion(s.views) for s in seen]
    stills = all(s.stills for s in seen)
    time = seen[0].time
    period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    found: list[dict[int, BoardView]] = []
    shapes, speeds = [], []
    times = np.unique(np.concatenate([s.time for s in seen])) if len(seen) > 2 else time
    for at in times:
        views: dict[int, BoardView] = {}
        speed = 0.0
        for c, s in enumerate(seen):
            k = int(np.abs(s.time - at).argmin())
            view = s.views[k]
            if view is not None and abs(s.time[k] - at) <= 0.55 * period:
                views[c] = view
                speed = max(speed, float(moves[c][k]))
        if len(views) > 1:
            first = min(views)
            # Another pair of cameras is another view, too.
            shapes.append(
                np.append(
                    describe_view(views[first], board, seen[first].size), sum(2.0**c for c in views)
                )
            )
            speeds.append(speed)
            found.append(views)
    most = _TOGETHER * max(len(seen) - 1, 1)
    chosen = choose_views(np.array(shapes), np.array(speeds), most, are_stills=stills)
    return [found[k] for k in chosen]
