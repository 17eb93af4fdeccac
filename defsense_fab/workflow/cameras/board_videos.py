"""Find a board in videos, and instants at which several cameras saw it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...capture.cameras.image_sources import Video, run_in_threads
from ...capture.cameras.view_selection import choose_views, corner_motion, describe_view
from ...capture.tags.detection import BoardFinder, BoardView, image_size_error
from ...capture.tags.missing_board import explain_missing_board
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ...core.progress import Progress

MAX_INSTANTS = 40  # for each camera but the first
MAX_EXPLAINED_FRAMES = 4  # that are searched again for what they show instead of the board


@dataclass(frozen=True)
class BoardVideo:
    """A board in t frames of a video.

    Attributes:
        size: Width and height of the images, px.
        time: Times of the frames (t,), s.
        views: View of the board in each frame; None where it was not found.
        are_stills: Whether the frames are single images.
    """

    size: tuple[int, int]
    time: Float
    views: tuple[BoardView | None, ...]
    are_stills: bool


def find_boards(
    paths: Sequence[Path],
    board: CharucoBoard,
    rate: float | None,
    progress: Progress,
) -> list[BoardVideo]:
    """Find a board in videos or folders of images.

    Raises:
        CaptureError: A video cannot be read (`video-unreadable`), or does not show the board
            (`board-not-found`).
    """
    videos = [Video(p, rate if not p.is_dir() else rate or 1.0) for p in paths]
    total, done = max(sum(v.expected for v in videos), 1), [0]

    def search(video: Video, stop: threading.Event) -> BoardVideo:
        finder = BoardFinder(board)
        times, views = [], []
        for _, image_time, image in video.frames():
            if stop.is_set():
                break
            times.append(image_time)
            views.append(finder.find(image))
            done[0] += 1
            progress("board", min(done[0] / total, 1.0), f"{done[0]} frames")
        video.close()
        if not times:
            raise CaptureError(
                "no frame can be read",
                code="video-unreadable",
                where=video.path,
                action="Check that the file is not damaged",
            )
        return BoardVideo(video.size, np.array(times), tuple(views), video.path.is_dir())

    board_videos = run_in_threads(search, videos, 4)
    progress("board", 1.0, "done")
    for path, boards in zip(paths, board_videos, strict=True):
        if not any(boards.views):
            raise _missing_error(path, board, rate, len(boards.views))
    return board_videos


def _missing_error(
    path: Path, board: CharucoBoard, rate: float | None, frames: int
) -> CaptureError:
    video = Video(path, rate or 1.0)
    step = -(-frames // MAX_EXPLAINED_FRAMES)
    images = (image for k, _, image in video.frames() if k % step == step // 2)
    reason = explain_missing_board(images, board)
    video.close()
    return CaptureError(
        f"the board was found in none of {frames} frames{': ' if reason else ''}{reason}",
        code="board-not-found",
        where=path,
        action=missing_board_action(board, reason),
        frames=frames,
        reason=reason,
    )


def missing_board_action(board: CharucoBoard, reason: str) -> str:
    """Return what to do about a board that is not found, by what images show instead."""
    size = f"{board.columns} x {board.rows}, {board.dictionary}"
    if not reason:
        return f"Check that board.json describes this board ({size})"
    return (
        f"Use the ChArUco board of board.json ({size}), or state yours with 'defsense capture"
        " board'"
    )


def check_sizes(
    cameras: Sequence[Camera], sizes: Sequence[tuple[int, int]], sources: Sequence[Path | str]
) -> None:
    """Check that images have the sizes of their cameras.

    Raises:
        CaptureError: If a source has another size.
    """
    is_swapped = sorted(sizes) == sorted(c.size for c in cameras)
    hint = ", perhaps because the sources are in another order" if is_swapped else ""
    for size, camera, source in zip(sizes, cameras, sources, strict=True):
        if size != camera.size:
            raise image_size_error(camera, size, source, hint)


def shared_views(
    cameras: Sequence[Camera],
    boards: Sequence[BoardVideo],
    paths: Sequence[Path],
    board: CharucoBoard,
) -> list[dict[int, BoardView]]:
    """Choose instants at which several cameras saw the board.

    The stillest and most different ones are chosen.

    Raises:
        CaptureError: If a video has another size than its camera.
    """
    check_sizes(cameras, [video.size for video in boards], paths)
    motions = [corner_motion(video.views) for video in boards]
    stills = all(video.are_stills for video in boards)
    time = boards[0].time
    period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    instants: list[dict[int, BoardView]] = []
    shapes, speeds = [], []
    times = np.unique(np.concatenate([video.time for video in boards])) if len(boards) > 2 else time
    for instant_time in times:
        views: dict[int, BoardView] = {}
        speed = 0.0
        for c, video in enumerate(boards):
            k = int(np.abs(video.time - instant_time).argmin())
            view = video.views[k]
            if view is not None and abs(video.time[k] - instant_time) <= 0.55 * period:
                views[c] = view
                speed = max(speed, float(motions[c][k]))
        if len(views) > 1:
            first = min(views)
            # Another pair of cameras is another view.
            shapes.append(
                np.append(
                    describe_view(views[first], board, boards[first].size),
                    sum(2.0**c for c in views),
                )
            )
            speeds.append(speed)
            instants.append(views)
    max_views = MAX_INSTANTS * max(len(boards) - 1, 1)
    chosen = choose_views(np.array(shapes), np.array(speeds), max_views, are_stills=stills)
    return [instants[k] for k in chosen]
