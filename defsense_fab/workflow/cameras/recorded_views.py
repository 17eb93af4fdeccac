"""Calibrate, arrange and check cameras from recorded views of a board."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.cameras.extrinsics import estimate_extrinsics
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
from ...capture.tags.detection import BoardView
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.camera import Camera, check_names
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ...report.cameras_page import write_report
from .board_videos import MAX_INSTANTS, check_sizes, find_boards, shared_views

MAX_VIEWS, TARGET_VIEWS = 60, 25  # of a calibration
_RIG_METADATA = ("error", "board_error")  # only of cameras with known poses
MAX_RIG_ERROR = 0.5  # px, and mm


@dataclass(frozen=True)
class Calibrated:
    """A calibrated camera.

    Attributes:
        intrinsics: Its calibration.
        coverage: How much of the image the views cover.
        views: The views.
        data: Plain values for reports.
    """

    intrinsics: Intrinsics
    coverage: Coverage
    views: tuple[BoardView, ...]
    data: dict[str, Any]


def calibrate_views(
    name: str,
    size: tuple[int, int],
    board: CharucoBoard,
    views: Sequence[BoardView],
    target: int = TARGET_VIEWS,
    *,
    fisheye: bool,
) -> Calibrated:
    """Calibrate a camera from chosen views.

    Args:
        name: Name of the camera.
        size: Width and height of its images, px.
        board: The board.
        views: Views of the board.
        target: Number of views that were requested.
        fisheye: Whether the lens is a fisheye.

    Raises:
        CaptureError: If the views do not determine the camera.
    """
    intrinsics = calibrate_camera(name, size, board, views, fisheye=fisheye)
    coverage = measure_coverage(views, board, size, target)
    camera = intrinsics.camera
    data = {
        "name": name,
        "size": list(size),
        "error": intrinsics.error,
        "views": len(views),
        "left_out": int((~intrinsics.used).sum()),
        "focal": camera.focal.tolist(),
        "focal_sigma": intrinsics.sigma[:2].tolist(),
        "center": camera.matrix[:2, 2].tolist(),
        "distortions": camera.distortions.tolist(),
        "coverage": coverage.fraction,
        "errors": intrinsics.errors.tolist(),
        "hints": list(coverage.hints),
    }
    return Calibrated(intrinsics, coverage, tuple(views), data)


def calibrate_recorded(
    paths: Sequence[Path],
    names: Sequence[str],
    board: CharucoBoard,
    out: Path,
    rate: float | None,
    progress: Progress,
    *,
    fisheye: bool,
) -> list[Calibrated]:
    """Calibrate cameras from videos, and store them.

    Args:
        paths: Video of each camera.
        names: Name of each camera.
        board: The board.
        out: File of cameras; those of the same name are replaced.
        rate: Frames per second of image sequences.
        progress: Receives progress.
        fisheye: Whether the lenses are fisheyes.

    Raises:
        CaptureError: If a camera cannot be calibrated.
    """
    check_new_names(out, names)
    calibrated = []
    for name, boards in zip(names, find_boards(paths, board, rate, progress), strict=True):
        frames = np.flatnonzero([v is not None for v in boards.views])
        views = [boards.views[k] for k in frames]
        visible = [v for v in views if v is not None]
        descriptions = np.array([describe_view(v, board, boards.size) for v in visible])
        chosen = choose_views(
            descriptions,
            corner_motion(boards.views)[frames],
            MAX_VIEWS,
            are_stills=boards.are_stills,
            allow_motion=True,
        )
        progress("solve", 0.0, name)
        chosen_views = [visible[k] for k in chosen]
        calibrated.append(calibrate_views(name, boards.size, board, chosen_views, fisheye=fisheye))
    progress("solve", 1.0, "done")
    store_calibrations(out, calibrated, board)
    return calibrated


def check_new_names(out: Path, names: Sequence[str]) -> None:
    """Check, before any work, that cameras of these names can be stored in a file.

    Names that it holds already are calibrated again.

    Raises:
        CaptureError: If a name is invalid.
    """
    present = [c.name for c in read_rig(out).cameras] if out.exists() else []
    check_names([*(n for n in present if n not in names), *names])


def store_calibrations(out: Path, calibrated: Sequence[Calibrated], board: CharucoBoard) -> None:
    """Put calibrations into a file of cameras, and write a report next to it."""
    cameras: dict[str, Camera] = {}
    metadata: dict[str, Any] = {}
    if out.exists():
        rig = read_rig(out)
        # Their relative poses are no longer known.
        cameras = {
            camera.name: replace(camera, rotation=np.eye(3), translation=np.zeros(3))
            for camera in rig.cameras
        }
        metadata = plain_metadata(rig)
        for key in _RIG_METADATA:
            metadata.pop(key, None)
    for calibration in calibrated:
        camera = calibration.intrinsics.camera
        metadata[f"sigma_{camera.name}"] = calibration.intrinsics.sigma.tolist()
        metadata[f"error_{camera.name}"] = calibration.intrinsics.error
        cameras[camera.name] = camera
    metadata |= _board_metadata(board) | {"adjusted": False}
    write_rig(out, list(cameras.values()), metadata)
    report_calibrations(out, calibrated)


def report_calibrations(out: Path, calibrated: Sequence[Calibrated]) -> None:
    """Write the report of calibrations next to the file of the cameras."""
    write_report(
        out.with_suffix(".html"),
        [
            (calibration.intrinsics, calibration.coverage, calibration.views)
            for calibration in calibrated
        ],
    )


def _board_metadata(board: CharucoBoard) -> dict[str, Any]:
    return {
        "square": board.scale * board.square,
        "square_measured": board.measured is not None,
        "date": time.strftime("%Y-%m-%d"),
    }


def arrange_recorded(
    paths: Sequence[Path],
    board: CharucoBoard,
    calibration: Path,
    rate: float | None,
    progress: Progress,
    *,
    keep: bool,
) -> dict[str, Any]:
    """Find the poses of cameras from videos that were taken at the same time, and store them.

    See `solve_rig`.
    """
    rig = read_rig_for(calibration, paths)
    check_world(rig, calibration, keep)
    boards = find_boards(paths, board, rate, progress)
    instants = shared_views(rig.cameras, boards, paths, board)
    progress("solve", 0.0, f"{len(instants)} boards")
    return solve_rig(rig, board, instants, calibration, progress, keep=keep)


def intrinsics_sigma(rig: Rig, name: str) -> Float:
    """Return standard deviations (9,) of a camera's parameters; zero (fixed) if unknown."""
    try:
        sigma = np.array(rig.metadata.get(f"sigma_{name}", []), float)
    except (TypeError, ValueError):
        return np.zeros(9)
    is_valid = sigma.shape == (9,) and np.isfinite(sigma).all() and (sigma >= 0).all()
    return sigma if is_valid else np.zeros(9)


def plain_metadata(rig: Rig) -> dict[str, Any]:
    """Return the part of a file's metadata that can be written again."""
    types = (bool, int, float, str)
    return {
        key: value
        for key, value in rig.metadata.items()
        if isinstance(value, types)
        or (isinstance(value, list) and all(isinstance(v, types) for v in value))
    }


def check_world(rig: Rig, calibration: Path, keep: bool) -> None:
    """Check that a file has a world that can be kept.

    Raises:
        CaptureError: If it has none.
    """
    if keep and not rig.placed:
        raise CaptureError(
            "does not state the poses of the cameras, so there is no world to keep",
            code="camera-poses-missing",
            where=calibration,
            action="Arrange the cameras without keeping the world",
        )


def solve_rig(
    rig: Rig,
    board: CharucoBoard,
    instants: Sequence[dict[int, BoardView]],
    out: Path,
    progress: Progress = silent,
    *,
    keep: bool,
) -> dict[str, Any]:
    """Find the poses of cameras, and store them.

    Args:
        rig: The calibrated cameras.
        board: The board.
        instants: Views of each instant by camera.
        out: File of the cameras.
        progress: Receives progress.
        keep: Whether to keep the world of the file, in which the first camera stays in place. By
            default the first camera becomes the origin.

    Returns:
        Plain values for reports.
    """
    sigma = [intrinsics_sigma(rig, c.name) for c in rig.cameras]
    solved = estimate_extrinsics(
        rig.cameras, board, instants, sigma if any(s.any() for s in sigma) else None
    )
    progress("solve", 1.0, "done")
    check = check_rig(solved.cameras, board, instants)
    metadata = plain_metadata(rig) | _board_metadata(board)
    metadata |= {"adjusted": True, "error": solved.error, "board_error": check.corner_error}
    first = rig.cameras[0]
    cameras = solved.cameras if not keep else [_to_world(c, first) for c in solved.cameras]
    write_rig(out, cameras, metadata)
    distances = [float(np.linalg.norm(c.center - solved.cameras[0].center)) for c in solved.cameras]
    return {
        "error": solved.error,
        "errors": solved.errors.tolist(),
        "boards": len(instants),
        "shared": solved.shared.tolist(),
        "distances": distances,
        "names": [c.name for c in solved.cameras],
        "length_error": check.corner_error,
        "square_measured": board.measured is not None,
        "warnings": _rig_warnings(solved.error, check.corner_error),
        "frame": f"the world of {out}" if keep else f"of camera {first.name}",
    }


def _to_world(camera: Camera, first: Camera) -> Camera:
    """Move a camera from the frame of the first camera to that camera's world."""
    R, t = camera.rotation, camera.translation
    return replace(camera, rotation=R @ first.rotation, translation=R @ first.translation + t)


def _rig_warnings(error: float, corner_error: float) -> list[str]:
    """Return warnings about poses with large errors."""
    if not (error > MAX_RIG_ERROR or corner_error > MAX_RIG_ERROR):
        return []
    return [
        f"The corners have errors of {error:.2f} px and {corner_error:.2f} mm, so do not measure"
        " with these poses. Check that the videos were started at the same time, that the board was"
        " held still, and that it is flat."
    ]


def check_recorded(
    paths: Sequence[Path],
    board: CharucoBoard,
    calibration: Path,
    rate: float | None,
    progress: Progress,
) -> Diagnosis:
    """Check by new views whether a calibration is still valid, and find out why it is not."""
    rig = read_rig_for(calibration, paths)
    boards = find_boards(paths, board, rate, progress)
    if len(paths) > 1:
        return diagnose(rig.cameras, board, shared_views(rig.cameras, boards, paths, board))
    check_sizes(rig.cameras, [boards[0].size], paths)
    views = [{0: v} for v in boards[0].views if v is not None]
    return diagnose(rig.cameras, board, views[:: max(len(views) // MAX_INSTANTS, 1)])


def read_rig_for(calibration: Path, paths: Sequence[Path]) -> Rig:
    """Read the cameras of a file, one for each source.

    Raises:
        CaptureError: If the numbers differ.
    """
    rig = read_rig(calibration)
    if len(rig.cameras) != len(paths):
        names = ", ".join(c.name for c in rig.cameras)
        raise CaptureError(
            f"has {len(rig.cameras)} cameras ({names}), but there are {len(paths)} sources",
            code="camera-count-differs",
            where=calibration,
            action="Give one source for each camera, in this order",
            cameras=len(rig.cameras),
            count=len(paths),
        )
    return rig
