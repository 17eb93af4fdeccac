"""The mode in which cords are optimised before one's eyes, and layouts are compared."""

from __future__ import annotations

from ...core.device.build_folder import build_folder
from ...store.layout import LAYOUT, load_layout
from ..edits.cords import take_cords
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .layout_comparison import ComparedPanel
from .error_map import ErrorMap
from .watched_search import WatchedSearch


class OptimiseMode(Mode):
    """The search runs beside the page; what it comes to is shown and may be taken."""

    label = "Optimise"
    hint = "Let the cords that are not locked move, compare layouts, and take one."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.search = WatchedSearch(bench)
        self.compared = ComparedPanel(bench)
        self.errors = ErrorMap(bench)
        self._stands = False
        bench.on_build_started.append(self._begun)
        bench.on_layout_found.append(self.search.see)

    def add_panel(self) -> None:
        bench, gui = self.bench, self.bench.server.gui
        bench.button("Simulate the poses", "Then errors are known", lambda: bench.build("simulate"))
        bench.button("Optimise the cords", "Simulates the poses first where they changed",
                     lambda: bench.build("optimize"), color="blue")  # fmt: skip
        self._pause = bench.button(
            "Pause", "The search stands still, and goes on", self.pause, visible=False, color="gray"
        )
        self._cancel = bench.button(
            "Cancel", "The last build and the cords stay", bench.builds.cancel,
            visible=False, color="gray",
        )  # fmt: skip
        self._best = bench.button(
            "Take the best so far", "Ends the search; undo brings the drawn cords back",
            self.take_best, visible=False,
        )  # fmt: skip
        bench.button(
            "Take the optimised cords", "Of the last build; undo brings the drawn cords back",
            self.take,
        )  # fmt: skip
        self.search.add_panel()
        with gui.add_folder("Layouts side by side", expand_by_default=False):
            self.compared.add_panel()
        with gui.add_folder("Error map", expand_by_default=False):
            self.errors.add_panel()

    def enter(self) -> None:
        self.search.show(True)
        self.compared.show(True)
        self.errors.enter()

    def leave(self) -> None:
        self.search.show(False)
        self.compared.show(False)
        self.errors.leave()

    def on_build_loaded(self) -> None:
        runs = self.bench.builds.running
        self._running(runs)
        if not runs:
            left = self.bench.build_error is not None and self.search.record.best is not None
            self._best.visible = left
            self.search.done()
        self.compared.load()
        self.errors.load()

    def close(self) -> None:
        self.search.close()
        self.compared.close()
        self.errors.close()

    def pause(self) -> None:
        """Or go on after a pause."""
        builds = self.bench.builds
        if not builds.running:
            self.bench.show_message("Nothing is running that could be paused.")
            return
        self._stands = not self._stands
        self._pause.label = "Go on" if self._stands else "Pause"
        if self._stands:
            builds.pause()
            self.bench.show_message("It pauses at its next step.")
        else:
            builds.resume()
            self.bench.show_message("It goes on.")

    def take(self) -> None:
        """Write the optimised cords in place of those that are drawn."""
        folder = build_folder(self.bench.project.device)
        if not (folder / LAYOUT).exists():
            self.bench.show_message("Optimise the cords first.")
            return
        sensors = [record.sensor() for record in load_layout(folder).by_channel()]
        self.bench.apply(take_cords(sensors))

    def take_best(self) -> None:
        """Write the best cords that the search has come to; it ends."""
        best = self.search.record.best
        if best is None:
            self.bench.show_message("No search has come to cords that keep every limit yet.")
            return
        self.bench.builds.cancel()
        self.bench.apply(take_cords(best.sensors))

    def _begun(self) -> None:
        self.search.begin()
        self._running(True)

    def _running(self, runs: bool) -> None:
        self._stands, self._pause.label = False, "Pause"
        for button in (self._pause, self._cancel, self._best):
            button.visible = runs
