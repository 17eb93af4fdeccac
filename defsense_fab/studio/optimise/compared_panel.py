"""Layouts side by side: as drawn, by eye, the most accurate and the simplest; one is shown and may
be taken."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from pathlib import Path

from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError, StorageError
from ...core.storage.files import digest
from ...optimize.prediction.compare_layouts import (
    ComparedLayout,
    compare_layouts,
    seconds_of,
    weighed_layouts,
)
from ...store.layout import LAYOUT
from ...workflow.build.build import first_outdated
from ...workflow.study.cord_count import studied_layouts
from ..edits.cords import take_cords
from ..workbench.beside import BesideWork, Teller
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest import Latest
from ..workbench.workbench import Workbench
from .compared_words import compared_table, said_of, scatter

_NONE = "none"
_NOTHING = "No layouts yet: optimise the cords first."
_SHOWN = (148, 70, 170)  # purple, beside grey, orange and blue
_STALE = {"body": "body", "mesh": "mesh", "simulate": "poses"}


class ComparedPanel:
    """What the last build weighed is there at once; the rest is computed when it is asked for, in a
    process of its own."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self.layouts: list[ComparedLayout] = []
        self._chosen = _NONE
        self._key: str | None = None  # of the layout that these are about
        self._shown = False
        self._tubes = CordTubes(bench.server, "/compared")
        self.work = BesideWork("comparison", self._progress, self._ended, self._found)
        self.worker = Latest(self._read, bench.fail)

    def add_panel(self) -> None:
        """Numbers, picture, choice."""
        gui, button = self._bench.server.gui, self._bench.button
        self._table = gui.add_markdown(_NOTHING)
        self._picture = gui.add_html("")
        self._list = gui.add_dropdown("Shown", (_NONE,), hint="In purple, over the drawn cords")
        self._list.on_update(lambda event: self._listed(event))
        self._said = gui.add_markdown("")
        self._take = button("Take this layout", "In place of the drawn cords; undo brings these"
                            " back", self.take)  # fmt: skip
        self._weigh = button("Weigh all", "Makes the drawn cords, and such as one lays by eye, on"
                             " trial, with the band of built devices", self.weigh)  # fmt: skip
        self._stop = button("Stop weighing", "What is found stays", self.work.cancel, visible=False)
        self._state = gui.add_markdown("")

    def load(self) -> None:
        """There is another build."""
        self.worker.give(None)

    def show(self, shown: bool) -> None:
        """Whether the chosen one is seen; the caller has the `drawing` lock."""
        self._shown = shown
        self._draw_chosen()

    def choose(self, name: str) -> None:
        """Show the layout of that name in three dimensions."""
        with self._bench.drawing:
            self._chosen = name
            self._draw()

    def take(self) -> None:
        """Write its cords in place of those that are drawn."""
        one = self._one()
        if one is None or not one.sensors:
            self._bench.say("Choose a layout first.")
            return
        self._bench.do(take_cords(one.sensors))

    def weigh(self) -> None:
        """Compute what is not known yet."""
        bench = self._bench
        folder = build_folder(bench.project.device)
        if not self.layouts:
            bench.say(_NOTHING)
            return
        if bench.builds.running:
            bench.say("A build is running; cancel it, or wait for it, and weigh then.")
            return
        stage = first_outdated(bench.project.device, "simulate")
        if stage is not None:
            raise StorageError(
                f"the {_STALE[stage.name]} have changed since they were simulated: press 'Optimise"
                " the cords' first, then weigh"
            )
        if not self.work.begin(_compare, bench.project.folder, folder):
            bench.say("They are being weighed already.")
            return
        self._stop.visible = True

    def close(self) -> None:
        """End what runs."""
        self.work.close()
        self.worker.close()

    def _one(self) -> ComparedLayout | None:
        return next((one for one in self.layouts if one.name == self._chosen), None)

    def _listed(self, event: object) -> None:
        if getattr(event, "client", None) is not None:
            self.choose(self._list.value)

    def _read(self, _: None) -> None:
        device = self._bench.project.device
        folder = build_folder(device)
        try:
            key = digest(folder / LAYOUT)
            weighed, seconds = weighed_layouts(folder), seconds_of(device, folder)
            found = [*weighed, *studied_layouts(device, folder)]
        except (DefsenseError, OSError):
            key, found, seconds = None, [], 0.0
        if key == self._key and found:
            return  # another stage was built: what was weighed still holds
        self.work.cancel()
        with self._bench.drawing:
            self._key, self.layouts = key, _ranked(found)
            self._weigh.label = f"Weigh all (about {_rounded(seconds)} s)" if found else "Weigh all"
            self._state.content = ""
            self._draw()

    def _found(self, one: ComparedLayout) -> None:
        with self._bench.drawing:
            others = [o for o in self.layouts if o.name != one.name]
            self.layouts = _ranked([*others, one])
            self._draw()

    def _progress(self, share: float, told: str) -> None:
        self._state.content = f"{share:.0%}: {told}"

    def _ended(self, problem: str | None) -> None:
        self._stop.visible = False
        self._state.content = "" if problem is None else f"**{problem}**"

    def _draw(self) -> None:
        names = (_NONE, *(one.name for one in self.layouts))
        if self._chosen not in names:
            self._chosen = _NONE
        self._list.options, self._list.value = names, self._chosen
        self._table.content = compared_table(self.layouts) if self.layouts else _NOTHING
        self._picture.content = scatter(self.layouts, self._chosen)
        one = self._one()
        self._said.content = "" if one is None else said_of(one)
        self._draw_chosen()

    def _draw_chosen(self) -> None:
        one = self._one() if self._shown else None
        radius = self._bench.project.device.cord.diameter / 2
        self._tubes.show(() if one is None else one.sensors, _SHOWN, 1.1 * radius)


def _ranked(layouts: Sequence[ComparedLayout]) -> list[ComparedLayout]:
    """By their errors, those without one last."""
    return sorted(layouts, key=lambda one: (math.isnan(one.error), one.error))


def _rounded(seconds: float) -> int:
    """To 5 s: it is no better known."""
    return max(5 * round(seconds / 5), 5)


def _compare(teller: Teller, source: Path, folder: Path) -> None:
    """In the other process."""
    from ...core.device.device_file import load_device
    from ...core.machine.processes import one_blas_thread

    with one_blas_thread():  # as builds have it
        compare_layouts(load_device(source), folder, teller.found, teller.progress)
