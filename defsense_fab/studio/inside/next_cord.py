"""The controls of the search for the best place of another cord."""

from __future__ import annotations

from collections.abc import Callable

from ...workflow.design.next_cord import NextCord
from ..workbench.controls import on_user
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .next_cord_search import map_text

_SHORT, _THROUGH = "short cords", "from surface to surface"
_MIN_LENGTH_MM, _MAX_LENGTH_MM = 10.0, 1000.0  # of a short cord


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
