"""Cameras calibrated, arranged and checked while they look at a board that someone holds."""

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
from .recorded_views import (
    Calibrated,
    calibrate_views,
    check_new_names,
    check_sizes,
    check_world,
    finish_arranging,
    rig_of,
    store,
)

_TOGETHER = 0.04  # s between frames of several cameras that count as simultaneous
_COVERED = 0.9  # of the picture's cells, with which a calibration may end by itself
_MOST = 80


@dataclass(frozen=True)
class BoardShown:
    """What a screen shows: by camera its name, picture, and corners (k, 2) px of the board; the
    cells that are covered (one camera) or None; views taken and wanted; words on what to do."""

    names: tuple[str, ...]
    images: tuple[Image, ...]
    corners: tuple[Float, ...]
    cells: Int | None
    taken: int
    wanted: int
    hints: tuple[str, ...] = field(default=())
    flash: bool = False


class BoardScreen(Protocol):
    """Shows, and reads keys."""

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
    """One camera; ends when so many views cover the picture, or at a key (enter). Raises
    CaptureError where they are too few then, or the camera is gone."""
    check_new_names(out, [name])
    finder = BoardFinder(board)
    kept: list[BoardView] = []
    shapes: list[Float] = []
    last: BoardView | None = None
    with closing(opener(source)) as camera:
        camera.start()
        covered = measure_coverage(kept, board, camera.size, wanted)
        while True:
            frame = camera.read(1.0)
            pressed = screen.key(0.0)
            if pressed == "q":
                raise KeyboardInterrupt
            if pressed == "enter" and len(kept) >= MIN_VIEWS:
                break
            if frame is None:
                continue
            view = finder.find(frame[0])
            taken = False
            if view is not None:
                still = float(corner_motion([last, view])[1]) <= MAX_STILL_MOTION_PX
                shape = describe_view(view, board, camera.size)
                if still and is_new(shape, shapes):
                    taken = True
                    kept.append(view)
                    shapes.append(shape)
                    covered = measure_coverage(kept, board, camera.size, wanted)
            last = view
            corners = np.zeros((0, 2)) if view is None else view.corners
            screen.show(
                BoardShown(
                    (name,), (frame[0],), (corners,), covered.cells, len(kept), wanted,
                    covered.hints or ("there are enough views: press Enter",), taken,
                )
            )  # fmt: skip
            enough = len(kept) >= wanted and covered.fraction >= _COVERED
            if (enough and not covered.hints) or len(kept) >= _MOST:
                break
        done = [calibrate_views(name, camera.size, board, kept, wanted, fisheye=fisheye)]
    store(out, done, board)
    return done


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
    """Several cameras at once; as `calibrate_live`, and `finish_arranging`."""
    rig = rig_of(calibration, [Path(s) for s in sources])
    check_world(rig, calibration, keep)
    instants = _gather(sources, rig.cameras, board, wanted, screen, opener, several=True)
    return finish_arranging(rig, board, instants, calibration, keep=keep)


def check_live(
    sources: Sequence[str],
    board: CharucoBoard,
    calibration: Path,
    wanted: int,
    screen: BoardScreen,
    opener: Opener = Webcam,
) -> Diagnosis:
    """A few views, whether they fit, and why not."""
    rig = rig_of(calibration, [Path(s) for s in sources])
    several = len(sources) > 1
    instants = _gather(sources, rig.cameras, board, wanted, screen, opener, several=several)
    return diagnose(rig.cameras, board, instants)


def _gather(
    sources: Sequence[str],
    cameras: Sequence[Any],
    board: CharucoBoard,
    wanted: int,
    screen: BoardScreen,
    opener: Opener,
    *,
    several: bool,
) -> list[dict[int, BoardView]]:
    """Views of instants at which the board is still and somewhere new."""
    finder = BoardFinder(board)
    kept: list[dict[int, BoardView]] = []
    shapes: list[Float] = []
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(opener(s))) for s in sources]
        for source in opened:
            source.start()
        check_sizes(cameras, [s.size for s in opened], sources)
        frames: list[tuple[Image, int] | None] = [None] * len(opened)
        last: list[BoardView | None] = [None] * len(opened)
        while len(kept) < wanted:
            pressed = screen.key(0.0)
            if pressed == "q":
                raise KeyboardInterrupt
            if pressed == "enter" and kept:
                break
            for c, source in enumerate(opened):
                frames[c] = source.read(1.0) or frames[c]
            there = [f for f in frames if f is not None]
            if len(there) < len(opened):
                continue
            views = [finder.find(f[0]) for f in there]
            stamps = [f[1] for f in there]
            still = all(
                v is None or float(corner_motion([a, v])[1]) <= MAX_STILL_MOTION_PX
                for a, v in zip(last, views, strict=True)
            )
            last = list(views)
            seen = {c: v for c, v in enumerate(views) if v is not None}
            taken = False
            near = (max(stamps) - min(stamps)) / 1e9 <= _TOGETHER
            if still and near and len(seen) >= (2 if several else 1):
                c = min(seen)
                shape = np.append(
                    describe_view(seen[c], board, cameras[c].size), sum(2.0**k for k in seen)
                )
                if is_new(shape, shapes):
                    taken = True
                    kept.append(seen)
                    shapes.append(shape)
            hint = "hold the board still where the cameras see it" + (" together" * several)
            screen.show(
                BoardShown(
                    tuple(c.name for c in cameras), tuple(f[0] for f in there),
                    tuple(np.zeros((0, 2)) if v is None else v.corners for v in views),
                    None, len(kept), wanted, (hint,), taken,
                )
            )  # fmt: skip
    return kept
