"""By how much the device misses its own surface in every state, as colours on it."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...report.surface_errors import SurfaceErrors, surface_errors
from ...store.build import Build
from ...store.layout import LayoutRecord, load_layout
from ..workbench.latest import Latest
from ..workbench.workbench import Workbench
from .color_scale import color_bar, colored

_OFF = "off"
_NOTHING = "Nothing is optimised yet: the map is of the optimised cords."


@dataclass(frozen=True)
class _Known:
    errors: SurfaceErrors
    layout: LayoutRecord


class ErrorMap:
    """Of the cords of the last build, by the numbers of its report; one state at a time, on one
    scale for all."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._known: _Known | None = None
        self._mesh: Any = None
        self._state, self._entered = _OFF, False
        self.worker = Latest(self._work, bench.fail)

    def add_panel(self) -> None:
        """The state, and the scale."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown("State", (_OFF,), hint="Its error on the surface")
        self._list.on_update(lambda event: self._asked(event))
        self._moved = gui.add_checkbox("Deformed", True, hint="Or on the body at rest")
        self._moved.on_update(lambda event: self._asked(event))
        self._bar = gui.add_html("")
        self._told = gui.add_markdown(_NOTHING)

    def load(self) -> None:
        """There is another build; its poses are read when a state is chosen."""
        folder = build_folder(self._bench.project.device)
        self._known = None
        try:
            names = tuple(load_layout(folder).prediction.per_state)
        except (DefsenseError, OSError):
            names = ()
        self._list.options = (_OFF, *(n for n in names if n != "rest"))
        self._told.content = "Choose a state." if names else _NOTHING
        self.choose(_OFF)

    def choose(self, state: str) -> None:
        """Show a state, or nothing."""
        self._state = self._list.value = state
        self.worker.give(None)

    def enter(self) -> None:
        """The caller has the `drawing` lock."""
        self._entered = True
        self.worker.give(None)

    def leave(self) -> None:
        """The caller has the `drawing` lock."""
        self._entered = False
        self._remove()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _asked(self, event: Any) -> None:
        if event.client is not None:
            self.choose(self._list.value)

    def _work(self, _: None) -> None:
        state, known = self._state, self._known
        if state != _OFF and self._entered and known is None:
            self._told.content = "Reading the poses ..."
            folder = build_folder(self._bench.project.device)
            build = Build(folder)
            known = self._known = _Known(surface_errors(build), build.layout)
            self._list.options = (_OFF, *known.errors.names)
            self._list.value = state
        with self._bench.drawing:
            self._remove()
            if known is not None and state in known.errors.names and self._entered:
                self._draw(known, state)
            elif known is not None:
                self._bar.content, self._told.content = "", "Choose a state."

    def _draw(self, known: _Known, state: str) -> None:
        errors, at = known.errors, known.errors.names.index(state)
        vertices = errors.rest + errors.moved[at] if self._moved.value else errors.rest
        mesh = colored(vertices, errors.faces, errors.error[at], errors.highest)
        self._mesh = self._bench.server.scene.add_mesh_trimesh("/error_map", mesh)
        if self._bench.body is not None:
            self._bench.body.visible = False
        self._bar.content = color_bar(errors.highest, float(errors.error.max()), "mm, all states")
        told = known.layout.prediction
        expected = {**told.per_state, **told.held_out}.get(state)
        noise = "" if expected is None else f"; **{expected:.2f} mm** at the markers with noise"
        seen = "held out of the design" if errors.held_out[at] else "designed for"
        self._told.content = (
            f"{html.escape(state)} ({seen}): **{errors.mean(at):.2f} mm** over the surface without"
            f" noise, at most {float(np.max(errors.error[at])):.2f} mm{noise}. Of the cords of the"
            " last build, as its report has it."
        )

    def _remove(self) -> None:
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
            if self._bench.body is not None:
                self._bench.body.visible = True
