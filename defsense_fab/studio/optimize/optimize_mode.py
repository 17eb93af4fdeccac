"""The mode that optimizes the cords while the user watches, and compares layouts."""

from __future__ import annotations

from ...workflow.build.results import has_layout
from ..edits.cords import take_cords
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .error_map import ErrorMap
from .layout_comparison import LayoutComparison
from .watched_search import WatchedSearch

_PAUSE_LABEL, _RESUME_LABEL = "Pause", "Resume"


class OptimizeMode(Mode):
    """Optimize the cords in the background, watch the search, and take a layout.

    Attributes:
        search: The search of the current or last build.
        comparison: The layouts side by side.
        error_map: The error on the surface.
        is_paused: Whether the user has paused the build.
        shows_build_controls: Whether the buttons to pause, cancel and take the best are visible.
    """

    label = "Optimize"
    hint = "Optimize the cords that are not locked, compare layouts, and take one."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.search = WatchedSearch(bench)
        self.comparison = LayoutComparison(bench)
        self.error_map = ErrorMap(bench)
        self.is_paused = self.shows_build_controls = False
        bench.on_build_started.append(self._follow_build)
        bench.on_layout_found.append(self.search.add)

    def add_panel(self) -> None:
        bench, gui = self.bench, self.bench.server.gui
        bench.button(
            "Simulate the poses",
            "Simulate the poses to predict errors",
            lambda: bench.build("simulate"),
        )
        bench.button(
            "Optimize the cords",
            "Optimize the cords. Simulate the poses first if they have changed",
            lambda: bench.build("optimize"),
            color="blue",
        )
        self._pause = bench.button(
            _PAUSE_LABEL, "Pause or resume the build", self.pause, visible=False, color="gray"
        )
        self._cancel = bench.button(
            "Cancel",
            "Stop the build and keep the last build and the cords",
            bench.builds.cancel,
            visible=False,
            color="gray",
        )
        self._take_best = bench.button(
            "Take the best so far",
            "End the search and use its best cords. Undo restores the drawn cords",
            self.take_best,
            visible=False,
        )
        bench.button(
            "Take the optimized cords",
            "Use the cords of the last build. Undo restores the drawn cords",
            self.take,
        )
        self.search.add_panel()
        with gui.add_folder("Layout comparison", expand_by_default=False):
            self.comparison.add_panel()
        with gui.add_folder("Error map", expand_by_default=False):
            self.error_map.add_panel()

    def enter(self) -> None:
        self.search.show(True)
        self.comparison.show(True)
        self.error_map.enter()

    def leave(self) -> None:
        self.search.show(False)
        self.comparison.show(False)
        self.error_map.leave()

    def on_build_loaded(self) -> None:
        is_running = self.bench.builds.is_running
        self._show_build_controls(is_running)
        if not is_running:
            has_failed = self.bench.build_error is not None
            self._take_best.visible = has_failed and self.search.record.best is not None
            self.search.end()
        self.comparison.load()
        self.error_map.load()

    def close(self) -> None:
        self.search.close()
        self.comparison.close()
        self.error_map.close()

    def pause(self) -> None:
        """Pause the build, or resume it after a pause."""
        builds = self.bench.builds
        if not builds.is_running:
            self.bench.status.show("No build is running.", "no-build-running")
            return
        self.is_paused = not self.is_paused
        self._pause.label = _RESUME_LABEL if self.is_paused else _PAUSE_LABEL
        if self.is_paused:
            builds.pause()
            self.bench.status.show("The build pauses at its next step.", "build-pausing")
        else:
            builds.resume()
            self.bench.status.show("The build continues.", "build-resumed")

    def take(self) -> None:
        """Replace the drawn cords by those of the last build."""
        build = self.bench.results
        if not has_layout(build):
            self.bench.status.show("Optimize the cords first.", "not-optimized")
            return
        sensors = [record.sensor() for record in build.layout.by_channel()]
        self.bench.apply(take_cords(sensors))

    def take_best(self) -> None:
        """End the search and replace the drawn cords by its best ones."""
        best = self.search.record.best
        if best is None:
            self.bench.status.show(
                "The search has not found cords within all limits yet.", "no-cords-found"
            )
            return
        self.bench.builds.cancel()
        self.bench.apply(take_cords(best.sensors))

    def _follow_build(self) -> None:
        self.search.start()
        self._show_build_controls(True)

    def _show_build_controls(self, is_running: bool) -> None:
        self.is_paused, self._pause.label = False, _PAUSE_LABEL
        self.shows_build_controls = is_running
        for button in (self._pause, self._cancel, self._take_best):
            button.visible = is_running
