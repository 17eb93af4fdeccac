"""The search for the best place of another cord, and its controls."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane
from ...core.device.device import Sensor
from ...workflow.design.body_section import BodySection
from ...workflow.design.layout_judge import LayoutJudge
from ...workflow.design.next_cord import NextCord, map_next_cord
from ..workbench.controls import on_user
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench

_SHORT, _THROUGH = "short cords", "from surface to surface"
_MIN_LENGTH_MM, _MAX_LENGTH_MM = 10.0, 1000.0  # of a short cord


@dataclass(frozen=True)
class SearchRequest:
    """A search for the best place of another cord.

    Attributes:
        judge: Predicts the error of the cords.
        body: The body.
        plane: The plane of the cord.
        sensors: The present cords.
        length: Length of the cord, mm; None for cords from surface to surface.
    """

    judge: LayoutJudge
    body: BodySection
    plane: Plane
    sensors: Sequence[Sensor]
    length: float | None


class NextCordSearch:
    """Search for the best place of another cord, one search at a time, on a thread.

    Args:
        on_progress: Called with the completed share (0 to 1), and with None when no search runs.
        on_map: Called with the coarse map and with the fine one.
        on_error: Called with the error of a search.
    """

    def __init__(
        self,
        on_progress: Callable[[float | None], None],
        on_map: Callable[[SearchRequest, NextCord], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._on_progress, self._on_map = on_progress, on_map
        self._lock = threading.Lock()
        self._request: SearchRequest | None = None
        self._worker = LatestWorker(self._search, on_error)

    def start(self, request: SearchRequest) -> None:
        """Start a search; it replaces the running one."""
        with self._lock:
            self._request = request
        self._worker.give(request)

    def cancel(self) -> None:
        """End the running search without a map, within some hundredths of a second."""
        with self._lock:
            self._request = None

    def wait(self, timeout_s: float) -> bool:
        """Wait until no search runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def close(self) -> None:
        """End the search and its thread."""
        self.cancel()
        self._worker.close()

    def _search(self, request: SearchRequest) -> None:
        if self._request is not request:
            return
        try:
            self._on_progress(0.0)
            for cord_map in map_next_cord(
                request.judge, request.body, request.plane, request.sensors, request.length
            ):
                if self._request is not request:
                    return
                self._on_progress(cord_map.share if cord_map.is_fine else 0.0)
                if cord_map.share == 1.0:
                    self._on_map(request, cord_map)
        finally:
            self._on_progress(None)


class NextCordPanel:
    """Controls of the search; visible while the section shows the benefit of another cord.

    Args:
        bench: The workbench.
        on_change: Called when a user has chosen other cords to try.
        on_cancel: Called to cancel the search.
        on_draw: Called to draw the best cord.

    Attributes:
        status: What the search does or has found. Its code is "searching", "cancelled", "found" or
            that of an error.
        cord_map: The map whose numbers are shown, or None.
    """

    def __init__(
        self,
        bench: Workbench,
        on_change: Callable[[], None],
        on_cancel: Callable[[], None],
        on_draw: Callable[[], None],
    ) -> None:
        gui = bench.server.gui
        self.status = StatusText()
        self.cord_map: NextCord | None = None
        self._folder = gui.add_folder("Another cord", visible=False)
        with self._folder:
            self._kind = gui.add_dropdown(
                "Cords to try",
                (_SHORT, _THROUGH),
                hint="Short cords show the best place. Cords from surface to surface can be made",
            )
            self._length = gui.add_number(
                "Length (mm)",
                30.0,
                min=_MIN_LENGTH_MM,
                max=_MAX_LENGTH_MM,
                step=1.0,
                hint="Set the length of a short cord",
            )
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self.status.add_panel(gui)
            self._draw = bench.button(
                "Draw the best cord", "Add the orange cord", on_draw, disabled=True
            )
            self._cancel = bench.button(
                "Cancel the search",
                "Stop the search and keep the shown map",
                on_cancel,
                visible=False,
            )
        for control in (self._kind, self._length):
            on_user(control, lambda _: on_change())
        self._kind.on_update(lambda _: self._show_length())

    @property
    def is_searching(self) -> bool:
        """Whether the progress of a search is shown."""
        return bool(self._bar.visible)

    @property
    def length(self) -> float | None:
        """Length of the cords to try, mm; None from surface to surface."""
        return float(self._length.value) if self._kind.value == _SHORT else None

    def set_default_length(self, length: float) -> None:
        """Set the length of short cords, mm."""
        self._length.value = length

    def choose(self, length: float | None) -> None:
        """Choose which cords are tried.

        Args:
            length: Length of short cords, mm, or None for cords from surface to surface.
        """
        self._kind.value = _THROUGH if length is None else _SHORT
        if length is not None:
            self._length.value = length
        self._show_length()

    def show(self, is_visible: bool) -> None:
        """Show or hide the controls."""
        self._folder.visible = is_visible

    def show_progress(self, share: float | None) -> None:
        """Show the completed share (0 to 1) of a search, or None when no search runs."""
        self._bar.visible = self._cancel.visible = share is not None
        self._bar.value = 100 * (share or 0.0)

    def show_start(self) -> None:
        """Show that a search has started."""
        self._forget_map()
        self.status.show("Searching for the best place of another cord ...", "searching")

    def show_cancelled(self) -> None:
        """Show that the search was canceled."""
        self._forget_map()
        text = "Canceled. Move the plane or choose other cords to search again."
        self.status.show(text, "cancelled")

    def show_error(self, error: Exception) -> None:
        """Show the error of a search."""
        self._forget_map()
        self.status.show_error(error, "The search")

    def show_map(self, cord_map: NextCord) -> None:
        """Show the numbers of a map."""
        self.cord_map, self._draw.disabled = cord_map, cord_map.best is None
        self.status.show(map_text(cord_map, self.length), "found")

    def _forget_map(self) -> None:
        self.cord_map, self._draw.disabled = None, True

    def _show_length(self) -> None:
        self._length.visible = self._kind.value == _SHORT


def map_text(cord_map: NextCord, length: float | None) -> str:
    """Return the best place, the decrease of the error and the tried cords in markdown."""
    kind = "from surface to surface" if length is None else f"of {length:g} mm"
    if not cord_map.tried:
        return (
            f"No cord {kind} fits in this plane next to the present cords. Move the plane, or try"
            " other cords or lengths."
        )
    tried = f"{cord_map.tried} cords {kind} were tried, {cord_map.step:.1f} mm apart"
    if cord_map.best is None:
        return f"No cord here lowers the expected error of {cord_map.error:.2f} mm. {tried}."
    middle = format_point(cord_map.ends[cord_map.best].mean(axis=0))
    best_error = cord_map.error - cord_map.best_drop
    return (
        f"Best place: **{cord_map.error:.2f} → {best_error:.2f} mm** near {middle}."
        f" {tried}, judged in unseen states by the fast decoders."
    )


def drop_text(cord_map: NextCord, rest: Float) -> str:
    """Return the effect of a cord through a point (3,) mm at rest."""
    distances = np.linalg.norm(cord_map.points - rest, axis=1)
    index = int(distances.argmin()) if len(distances) else -1
    if index < 0 or np.isnan(cord_map.drop[index]) or distances[index] > cord_map.step:
        return "No cord fits here"
    change = f"{-cord_map.drop[index]:+.2f}"
    return f"Change of the expected error by a cord here: {change} mm"
