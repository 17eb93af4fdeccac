"""Calibrate, arrange and check cameras while they see a board that someone holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...capture.cameras.image_sources import ImageSource, Webcam
from ...capture.cameras.intrinsics import MIN_VIEWS
from ...capture.cameras.rig_check import Diagnosis, diagnose
from ...capture.cameras.view_selection import (
    MAX_STILL_MOTION_PX,
    corner_motion,
    describe_view,
    is_new,
    measure_coverage,
)
from ...capture.tags.detection import BoardFinder, BoardView, Image
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float, Int
from .board_videos import check_sizes
from .recorded_views import (
    Calibrated,
    calibrate_views,
    check_new_names,
    check_world,
    read_rig_for,
    solve_rig,
    store_calibrations,
)

MAX_TIME_DIFFERENCE_S = 0.04  # between simultaneous frames of several cameras
MIN_COVERAGE = 0.9  # share of the image's cells with which a calibration ends automatically
MAX_VIEWS = 80


@dataclass(frozen=True)
class BoardShown:
    """The state of a calibration, for a screen.

    Attributes:
        names: Names of the cameras.
        images: Their images.
        corners: Corners of the board in each image (k, 2), px.
        cells: Corners in each cell of the image of a single camera; None for several.
        taken: Number of views taken.
        wanted: Number of views needed.
        hints: What to do next.
        flash: Whether a view was just taken.
    """

    names: tuple[str, ...]
    images: tuple[Image, ...]
    corners: tuple[Float, ...]
    cells: Int | None
    taken: int
    wanted: int
    hints: tuple[str, ...] = field(default=())
    flash: bool = False


class BoardScreen(Protocol):
    """Shows a calibration, and reads keys: an interface."""

    def show(self, shown: BoardShown) -> None: ...

    def key(self, timeout: float) -> str | None: ...


Opener = Callable[[str], ImageSource]


def calibrate_live(
    source: str,
    name: str,
    board: CharucoBoard,
    out: Path,
    wanted: int,
    screen: BoardScreen,
    opener: Opener = Webcam,
    *,
    fisheye: bool = False,
) -> list[Calibrated]:
    """Calibrate one camera.

    It ends when enough views cover the image, or when the user presses Enter.

    Raises:
        CaptureError: If the views are too few, or the camera is disconnected.
    """
    check_new_names(out, [name])
    finder = BoardFinder(board)
    views: list[BoardView] = []
    descriptions: list[Float] = []
    previous: BoardView | None = None
    with closing(opener(source)) as camera:
        camera.start()
        coverage = measure_coverage(views, board, camera.size, wanted)
        while True:
            frame = camera.read(1.0)
            key = screen.key(0.0)
            if key == "q":
                raise KeyboardInterrupt
            if key == "enter" and len(views) >= MIN_VIEWS:
                break
            if frame is None:
                continue
            view = finder.find(frame[0])
            is_taken = False
            if view is not None:
                is_still = float(corner_motion([previous, view])[1]) <= MAX_STILL_MOTION_PX
                description = describe_view(view, board, camera.size)
                if is_still and is_new(description, descriptions):
                    is_taken = True
                    views.append(view)
                    descriptions.append(description)
                    coverage = measure_coverage(views, board, camera.size, wanted)
            previous = view
            corners = np.zeros((0, 2)) if view is None else view.corners
            screen.show(
                BoardShown(
                    (name,),
                    (frame[0],),
                    (corners,),
                    coverage.cells,
                    len(views),
                    wanted,
                    coverage.hints or ("there are enough views; press Enter",),
                    is_taken,
                )
            )
            is_enough = len(views) >= wanted and coverage.fraction >= MIN_COVERAGE
            if (is_enough and not coverage.hints) or len(views) >= MAX_VIEWS:
                break
        calibrated = [calibrate_views(name, camera.size, board, views, wanted, fisheye=fisheye)]
    store_calibrations(out, calibrated, board)
    return calibrated


def arrange_live(
    sources: Sequence[str],
    board: CharucoBoard,
    calibration: Path,
    wanted: int,
    screen: BoardScreen,
    opener: Opener = Webcam,
    *,
    keep: bool = False,
) -> dict[str, Any]:
    """Find the poses of several cameras; see `solve_rig`."""
    rig = read_rig_for(calibration, [Path(s) for s in sources])
    check_world(rig, calibration, keep)
    instants = _collect_views(sources, rig.cameras, board, wanted, screen, opener, several=True)
    return solve_rig(rig, board, instants, calibration, keep=keep)


def check_live(
    sources: Sequence[str],
    board: CharucoBoard,
    calibration: Path,
    wanted: int,
    screen: BoardScreen,
    opener: Opener = Webcam,
) -> Diagnosis:
    """Check cameras by a few views, and find out why they do not fit."""
    rig = read_rig_for(calibration, [Path(s) for s in sources])
    several = len(sources) > 1
    instants = _collect_views(sources, rig.cameras, board, wanted, screen, opener, several=several)
    return diagnose(rig.cameras, board, instants)


def _collect_views(
    sources: Sequence[str],
    cameras: Sequence[Any],
    board: CharucoBoard,
    wanted: int,
    screen: BoardScreen,
    opener: Opener,
    *,
    several: bool,
) -> list[dict[int, BoardView]]:
    """Collect views of instants at which the board is still and somewhere new."""
    finder = BoardFinder(board)
    instants: list[dict[int, BoardView]] = []
    descriptions: list[Float] = []
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(opener(s))) for s in sources]
        for source in opened:
            source.start()
        check_sizes(cameras, [s.size for s in opened], sources)
        frames: list[tuple[Image, int] | None] = [None] * len(opened)
        previous: list[BoardView | None] = [None] * len(opened)
        while len(instants) < wanted:
            key = screen.key(0.0)
            if key == "q":
                raise KeyboardInterrupt
            if key == "enter" and instants:
                break
            for c, source in enumerate(opened):
                frames[c] = source.read(1.0) or frames[c]
            images = [f for f in frames if f is not None]
            if len(images) < len(opened):
                continue
            views = [finder.find(f[0]) for f in images]
            stamps = [f[1] for f in images]
            is_still = all(
                v is None or float(corner_motion([before, v])[1]) <= MAX_STILL_MOTION_PX
                for before, v in zip(previous, views, strict=True)
            )
            previous = list(views)
            visible = {c: v for c, v in enumerate(views) if v is not None}
            is_taken = False
            is_simultaneous = (max(stamps) - min(stamps)) / 1e9 <= MAX_TIME_DIFFERENCE_S
            if is_still and is_simultaneous and len(visible) >= (2 if several else 1):
                c = min(visible)
                description = np.append(
                    describe_view(visible[c], board, cameras[c].size), sum(2.0**k for k in visible)
                )
                if is_new(description, descriptions):
                    is_taken = True
                    instants.append(visible)
                    descriptions.append(description)
            hint = "hold the board still where the cameras see it" + (" together" * several)
            screen.show(
                BoardShown(
                    tuple(c.name for c in cameras),
                    tuple(f[0] for f in images),
                    tuple(np.zeros((0, 2)) if v is None else v.corners for v in views),
                    None,
                    len(instants),
                    wanted,
                    (hint,),
                    is_taken,
                )
            )
    return instants
