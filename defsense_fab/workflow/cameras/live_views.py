"""Calibrate, arrange and check cameras while they see a board that someone holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.cameras.image_sources import ImageSource
from ...capture.cameras.intrinsics import MIN_VIEWS
from ...capture.cameras.rig_check import Diagnosis, diagnose
from ...capture.cameras.view_selection import (
    MAX_STILL_MOTION_PX,
    Coverage,
    corner_motion,
    describe_view,
    is_new,
    measure_coverage,
)
from ...capture.tags.detection import BoardFinder, BoardView, Image
from ...capture.tags.missing_board import explain_missing_board
from ...capture.tags.tag_patterns import CharucoBoard
from ...core.arrays import Float
from ...core.guided_parts import Bars, Part, Picture
from ...core.guided_run import (
    Ending,
    GuidedRun,
    GuidedView,
    GuidedWork,
    Key,
    Phase,
    RunState,
    Screen,
)
from ...core.progress import Notice
from .board_videos import check_sizes, missing_board_action
from .options import MAX_VIEWS
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
IMAGE_TIMEOUT_S = 1.0
MAX_HINTS = 3
EXPLANATION_INTERVAL_S = 3.0  # without a board, between searches for what images show instead
VIEW_KEYS: Mapping[Phase, tuple[Key, ...]] = {
    "active": (Key("enter", "finish", "complete"), Key("q", "stop", "stop")),
}

Opener = Callable[[str], ImageSource]


def calibrate_live(
    source: str,
    name: str,
    board: CharucoBoard,
    out: Path,
    target: int,
    screen: Screen,
    opener: Opener,
    *,
    fisheye: bool,
) -> Calibrated:
    """Calibrate one camera.

    It ends when enough views cover the image, or when the user presses Enter.

    Args:
        source: Address of the camera.
        name: Name of the camera.
        board: The board.
        out: File of the cameras' calibration.
        target: Number of views.
        screen: Screen for the user.
        opener: Opens the camera.
        fisheye: Whether the lens is a fisheye.

    Returns:
        The calibrated camera, which is stored in `out`.

    Raises:
        CaptureError: If the views are too few, or the camera is disconnected.
        KeyboardInterrupt: If the user stops.
    """
    check_new_names(out, [name])
    with closing(opener(source)) as camera:
        camera.start()
        work = BoardViews([camera], [name], board, target, covers_image=True)
        _collect(work, screen)
        views = [instant[0] for instant in work.instants]
        calibrated = calibrate_views(name, camera.size, board, views, target, fisheye=fisheye)
    store_calibrations(out, [calibrated], board)
    return calibrated


def arrange_live(
    sources: Sequence[str],
    board: CharucoBoard,
    calibration: Path,
    target: int,
    screen: Screen,
    opener: Opener,
    *,
    keep: bool,
) -> dict[str, Any]:
    """Find the poses of several cameras; see `solve_rig`."""
    rig = read_rig_for(calibration, [Path(s) for s in sources])
    check_world(rig, calibration, keep)
    instants = _rig_views(sources, rig.cameras, board, target, screen, opener, min_cameras=2)
    return solve_rig(rig, board, instants, calibration, keep=keep)


def check_live(
    sources: Sequence[str],
    board: CharucoBoard,
    calibration: Path,
    target: int,
    screen: Screen,
    opener: Opener,
) -> Diagnosis:
    """Check cameras by a few views, and find out why they do not fit."""
    rig = read_rig_for(calibration, [Path(s) for s in sources])
    min_cameras = min(len(sources), 2)
    instants = _rig_views(
        sources, rig.cameras, board, target, screen, opener, min_cameras=min_cameras
    )
    return diagnose(rig.cameras, board, instants)


def _rig_views(
    sources: Sequence[str],
    cameras: Sequence[Any],
    board: CharucoBoard,
    target: int,
    screen: Screen,
    opener: Opener,
    *,
    min_cameras: int,
) -> list[dict[int, BoardView]]:
    """Collect views of calibrated cameras, each of `min_cameras` or more at one instant."""
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(opener(s))) for s in sources]
        for source in opened:
            source.start()
        check_sizes(cameras, [s.size for s in opened], sources)
        work = BoardViews(opened, [c.name for c in cameras], board, target, min_cameras)
        _collect(work, screen)
    return work.instants


def _collect(work: BoardViews, screen: Screen) -> None:
    run = GuidedRun(work, screen, auto=True, key_interval_s=0.0)
    run.run()
    if run.is_stopped:
        raise KeyboardInterrupt


class _MissingBoard:
    """Explains why a camera has not seen a board yet.

    Args:
        board: The board.

    Attributes:
        reason: What its images show instead; empty if there is no explanation, and once the board
            was found.
    """

    def __init__(self, board: CharucoBoard) -> None:
        self._board, self._was_found = board, False
        self._explained_ns: int | None = None
        self.reason = ""

    def receive(self, view: BoardView | None, image: Image, stamp: int) -> None:
        """Search an image without the board for what it shows, now and then."""
        if view is not None or self._was_found:
            self._was_found, self.reason = True, ""
            return
        if self._explained_ns is None:
            self._explained_ns = stamp
        elif stamp - self._explained_ns >= EXPLANATION_INTERVAL_S * 1e9:
            self._explained_ns = stamp
            self.reason = explain_missing_board([image], self._board)


class BoardViews(GuidedWork):
    """Work of one view: to wait until the board is still and somewhere new.

    Args:
        sources: The cameras, which are open.
        names: Their names.
        board: The board.
        target: Number of views.
        min_cameras: Number of cameras that must see the board at the same time.
        covers_image: Whether views are taken until they cover the image of the only camera, too.

    Attributes:
        instants: Views by number of the camera, for each instant.
    """

    def __init__(
        self,
        sources: Sequence[ImageSource],
        names: Sequence[str],
        board: CharucoBoard,
        target: int,
        min_cameras: int = 1,
        *,
        covers_image: bool = False,
    ) -> None:
        self.keys, self.step_count = VIEW_KEYS, MAX_VIEWS if covers_image else target
        self._sources, self._names, self._board = sources, names, board
        self._target, self._min_cameras = target, min_cameras
        self._finder = BoardFinder(board)
        self._frames: list[tuple[Image, int] | None] = [None] * len(sources)
        self._views: list[BoardView | None] = [None] * len(sources)
        self._missing = [_MissingBoard(board) for _ in sources]
        self._descriptions: list[Float] = []
        self._has_new_view = False
        self._coverage = self._measure_coverage([]) if covers_image else None
        self.instants: list[dict[int, BoardView]] = []

    def receive(self) -> None:
        self._has_new_view = False
        new = [source.read(IMAGE_TIMEOUT_S) for source in self._sources]
        self._frames = [f or old for f, old in zip(new, self._frames, strict=True)]
        frames = [f for f in self._frames if f is not None]
        if len(frames) < len(self._sources) or not any(new):
            return
        previous, self._views = self._views, [self._finder.find(image) for image, _ in frames]
        for missing, view, frame in zip(self._missing, self._views, frames, strict=True):
            missing.receive(view, *frame)
        motions = [
            0.0 if view is None else float(corner_motion([before, view])[1])
            for before, view in zip(previous, self._views, strict=True)
        ]
        visible = {c: view for c, view in enumerate(self._views) if view is not None}
        stamps = [stamp for _, stamp in frames]
        is_simultaneous = (max(stamps) - min(stamps)) / 1e9 <= MAX_TIME_DIFFERENCE_S
        if (
            max(motions) <= MAX_STILL_MOTION_PX
            and is_simultaneous
            and len(visible) >= self._min_cameras
        ):
            c = min(visible)
            description = np.append(
                describe_view(visible[c], self._board, self._sources[c].size),
                sum(2.0**k for k in visible),
            )
            if is_new(description, self._descriptions):
                self._has_new_view = True
                self.instants.append(visible)
                self._descriptions.append(description)
        if self._has_new_view and self._coverage is not None:
            views = [instant[0] for instant in self.instants]
            coverage = self._coverage = self._measure_coverage(views)
            is_covered = coverage.fraction >= MIN_COVERAGE and not coverage.hints
            if len(views) >= self._target and is_covered:
                self.step_count = len(views)

    def _measure_coverage(self, views: Sequence[BoardView]) -> Coverage:
        return measure_coverage(views, self._board, self._sources[0].size, self._target)

    def check(self, *, is_requested: bool) -> Ending | None:
        min_count = 1 if self._coverage is None else MIN_VIEWS
        if is_requested and len(self.instants) >= min_count:
            return "finish"
        return "done" if self._has_new_view else None

    def view(self, state: RunState) -> GuidedView:
        parts: list[Part] = []
        for name, frame, view in zip(self._names, self._frames, self._views, strict=True):
            corners = np.zeros((0, 2)) if view is None else view.corners
            parts.append(
                Picture(
                    name,
                    f"{len(corners)} corners" if len(corners) else "no board",
                    None if frame is None else frame[0],
                    corners[:, None],
                    (),
                    np.ones(len(corners), bool),
                )
            )
        together = " together" if self._min_cameras > 1 else ""
        instruction = f"Hold the board still where the cameras see it{together}."
        if self._coverage is not None:
            hints = self._coverage.hints or ("There are enough views. Press Enter.",)
            instruction = "; ".join(hints[:MAX_HINTS])
            share = self._coverage.cells / max(int(self._coverage.cells.max()), 1)
            parts.append(Bars(share, title="Covered parts of the image"))
        count = len(self.instants)
        return GuidedView(
            state,
            title=f"{', '.join(self._names)}: {count} of {self._target} views",
            instruction=instruction,
            progress=min(count / self._target, 1.0),
            parts=tuple(parts),
            notes=tuple(
                Notice(
                    "board-not-found",
                    f"{name}: the board is not in its images: {missing.reason}."
                    f" {missing_board_action(self._board, missing.reason)}.",
                    name,
                    {"reason": missing.reason},
                )
                for name, missing in zip(self._names, self._missing, strict=True)
                if missing.reason
            ),
            alert=self._has_new_view and state.phase != "done",
        )
