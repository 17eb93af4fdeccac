"""Show the error of the device's surface in a state as colors on the surface."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from ...core.errors import DefsenseError
from ...workflow.build.results import Build, SurfaceErrors, surface_errors
from ..workbench.colors import VIRIDIS, ColorScale, color_bar, unlit_mesh
from ..workbench.controls import on_user
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench

_OFF = "off"
_MIN_RANGE_MM = 1e-6  # of the color scale
_NOT_OPTIMIZED = "Optimize the cords first. The map shows the error of the optimized cords."
_NO_STATE = "Choose a state."


class ErrorMap:
    """Show the errors of the last build's report, one state at a time, on one scale.

    Args:
        bench: The workbench.

    Attributes:
        worker: Computes and draws the map.
        bar: The color bar as HTML; empty while no state is shown.
        status: What the panel shows. Its code is "not-optimized", "no-state", "loading" or "shown".
        shown_error: Root mean square error of the shown state over the surface, mm, or None.
    """

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._errors: SurfaceErrors | None = None
        self._build: Build = bench.results
        self._mesh: Any = None
        self._state, self._is_active = _OFF, False
        self.bar, self.status = "", StatusText(_NOT_OPTIMIZED, "not-optimized")
        self.shown_error: float | None = None
        self.worker = LatestWorker(self._update, bench.status.show_error)

    @property
    def is_shown(self) -> bool:
        """Whether the map is in the scene."""
        return self._mesh is not None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown(
            "State", (_OFF,), hint="Choose the state whose error is shown on the surface"
        )
        on_user(self._list, self.choose)
        self._is_deformed = gui.add_checkbox(
            "Deformed", True, hint="Show the deformed surface instead of the surface at rest"
        )
        on_user(self._is_deformed, lambda _: self.choose(self._state))
        self._bar = gui.add_html("")
        self.status.add_panel(gui)

    def load(self) -> None:
        """Follow another build; its poses are read once a state is chosen."""
        self._build, self._errors = self._bench.results, None
        try:
            names = tuple(self._build.layout.prediction.per_state)
        except (DefsenseError, OSError):
            names = ()
        self._list.options = (_OFF, *(name for name in names if name != "rest"))
        if names:
            self._show_status("no-state", _NO_STATE)
        else:
            self._show_status("not-optimized", _NOT_OPTIMIZED)
        self.choose(_OFF)

    def choose(self, state: str) -> None:
        """Show the error in a state, or nothing for "off"."""
        self._state = self._list.value = state
        self.worker.give(None)

    def enter(self) -> None:
        """Show the map, while the drawing lock is held."""
        self._is_active = True
        self.worker.give(None)

    def leave(self) -> None:
        """Hide the map, while the drawing lock is held."""
        self._is_active = False
        self._remove()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _update(self, _: None) -> None:
        state, loaded = self._state, self._errors
        if state != _OFF and self._is_active and loaded is None:
            self._show_status("loading", "Reading the poses ...")
            loaded = self._errors = surface_errors(self._build)
            self._list.options = (_OFF, *loaded.names)
            self._list.value = state
        with self._bench.drawing_lock:
            self._remove()
            if loaded is not None and state in loaded.names and self._is_active:
                self._draw(loaded, state)
            elif loaded is not None:
                self.bar = self._bar.content = ""
                self._show_status("no-state", _NO_STATE)

    def _draw(self, errors: SurfaceErrors, state: str) -> None:
        index = errors.names.index(state)
        is_deformed = self._is_deformed.value
        vertices = errors.rest + errors.moved[index] if is_deformed else errors.rest
        scale = ColorScale(0.0, max(errors.highest, _MIN_RANGE_MM), VIRIDIS)
        self._mesh = self._bench.server.scene.add_glb(
            "/error_map",
            unlit_mesh(vertices, errors.faces, scale.colors(errors.error[index])),
            cast_shadow=False,
            receive_shadow=False,
        )
        if self._bench.body is not None:
            self._bench.body.visible = False
        largest = float(errors.error.max())
        beyond = f"; brightest color: up to {largest:.3g}" if largest > scale.high else ""
        note = f"the same for all states{beyond}"
        self.bar = self._bar.content = color_bar(scale, "Error", "mm", note)
        prediction = self._build.layout.prediction
        expected = {**prediction.per_state, **prediction.held_out}.get(state)
        mean = errors.mean(index)
        lines = [
            f"State: {html.escape(state)}"
            f" ({'held out of' if errors.held_out[index] else 'used in'} the optimization)",
            f"Error over the surface without noise (RMS): **{mean:.2f} mm**",
            f"Largest error: {float(np.max(errors.error[index])):.2f} mm",
        ]
        if expected is not None:
            lines.append(f"Error at the markers with noise: **{expected:.2f} mm**")
        lines.append("The map shows the cords of the last build; its report has the same numbers.")
        self._show_status("shown", "  \n".join(lines))
        self.shown_error = mean

    def _show_status(self, status: str, text: str) -> None:
        self.shown_error = None
        self.status.show(text, status)

    def _remove(self) -> None:
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
            if self._bench.body is not None:
                self._bench.body.visible = True
