"""Layouts side by side: as drawn, by eye, the most accurate and the simplest; one is shown and may
be taken."""

from __future__ import annotations

import html
import math
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError, StorageError
from ...core.storage.files import digest
from ...optimize.prediction.compare_layouts import (
    compare_layouts,
    ComparedLayout,
    estimate_seconds,
    load_tried_layouts,
)
from ...store.layout import LAYOUT
from ...workflow.build.build import first_outdated
from ...workflow.study.cord_count import studied_layouts
from ..edits.cords import take_cords
from ..workbench.background_job import BackgroundJob, JobReporter
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench

# What the page says of layouts that are compared, and the picture of their errors.

_BLUE, _ORANGE = "#1f77b4", "#e68c1e"
_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 300, 170, 44, 34, 12


def compared_table(layouts: Sequence[ComparedLayout]) -> str:
    """Markdown: a row a layout."""
    lines = ["| layout | mm | 90 % | parts | cords | planes |", "|---|---:|---|---:|---:|---:|"]
    for one in layouts:
        band = f"{one.band[0]:.2f}–{one.band[1]:.2f}" if one.band else "?"
        parts = "cannot be made" if one.problem else "?" if one.parts is None else str(one.parts)
        name = f"**{html.escape(one.name)}**" if one.taken else html.escape(one.name)
        lines.append(
            f"| {name} | {_mm(one.error)} | {'' if one.problem else band} | {parts} |"
            f" {len(one.sensors)} | {one.planes} |"
        )
    lines += ["", "error on unseen states; 90 %: of built devices; bold: taken by the build; parts"
              " ?: not made on trial, as designed"]  # fmt: skip
    if not any(one.name.startswith("study") for one in layouts):
        lines[-1] += "; `defsense study` adds other numbers of cords"
    return "\n".join(lines)


def said_of(one: ComparedLayout) -> str:
    """Markdown: what there is to say of one layout."""
    notes = [one.problem] if one.problem else list(one.warnings)
    return "\n".join(f"- {html.escape(note)}" for note in notes if note)


def scatter(layouts: Sequence[ComparedLayout], chosen: str | None) -> str:
    """HTML: error with its band against the number of parts, and against that of cords."""
    shown = [one for one in layouts if math.isfinite(one.error) and one.error > 0]
    if not shown:
        return ""
    return _picture(shown, chosen, "parts", lambda one: one.parts) + _picture(
        shown, chosen, "cords", lambda one: len(one.sensors)
    )


def _picture(
    layouts: Sequence[ComparedLayout],
    chosen: str | None,
    what: str,
    count: Callable[[ComparedLayout], int | None],
) -> str:
    """On a logarithmic scale; in the colour of the page's text, legible in light and dark."""
    placed = [(n, one) for one in layouts if (n := count(one)) is not None]
    if not placed:
        return ""
    low, high = min(n for n, _ in placed) - 0.5, max(n for n, _ in placed) + 0.5
    errors = [mm for _, one in placed for mm in (one.error, *(one.band or ()))]
    bottom, top = 0.8 * min(errors), 1.25 * max(errors)
    room = _WIDTH - _LEFT - 8, _HEIGHT - _BOTTOM - _TOP

    def x(n: float) -> float:
        return float(_LEFT + room[0] * (n - low) / (high - low))

    def y(mm: float) -> float:
        return float(_TOP + room[1] * math.log(top / mm) / math.log(top / bottom))

    out = [
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" font-size="11" fill="currentColor"'
        f' role="img" aria-label="error against {what}">'
    ]
    out += [
        f'<line x1="{_LEFT}" x2="{_WIDTH - 8}" y1="{y(mm):.1f}" y2="{y(mm):.1f}"'
        ' stroke="currentColor" opacity="0.2"/>'
        f'<text x="{_LEFT - 5}" y="{y(mm) + 4:.1f}" text-anchor="end">{mm:g}</text>'
        for mm in _ticks(bottom, top)
    ]
    out += [
        f'<text x="{x(n):.1f}" y="{_HEIGHT - 18}" text-anchor="middle">{n}</text>'
        for n in sorted({n for n, _ in placed})
    ]
    out += [
        f'<text x="{(_LEFT + _WIDTH) / 2}" y="{_HEIGHT - 4}" text-anchor="middle">{what}</text>',
        f'<text x="2" y="{_TOP - 2}">mm</text>',
    ]
    for k, (n, one) in enumerate(placed):
        beside = sum(m == n for m, _ in placed[:k])
        at = x(n) + 9 * (-1) ** beside * ((beside + 1) // 2)
        color, size = (_ORANGE, 6) if one.name == chosen else (_BLUE, 4)
        if one.band:
            low_y, high_y = y(one.band[0]), y(one.band[1])
            out.append(
                f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{low_y:.1f}" y2="{high_y:.1f}"'
                f' stroke="{color}" stroke-width="2"/>'
            )
        told = f"{html.escape(one.name)}: {_mm(one.error)} mm"
        out.append(
            f'<circle cx="{at:.1f}" cy="{y(one.error):.1f}" r="{size}" fill="{color}">'
            f"<title>{told}</title></circle>"
        )
    return "".join([*out, "</svg>"])


def _ticks(bottom: float, top: float) -> list[float]:
    """1, 2 and 5 times powers of ten between the two."""
    powers = range(math.floor(math.log10(bottom)), math.ceil(math.log10(top)) + 1)
    every = [float(f"{k}e{power}") for power in powers for k in (1, 2, 5)]
    return [mm for mm in every if bottom <= mm <= top]


def _mm(error: float) -> str:
    return f"{error:.2f}" if math.isfinite(error) else "?"


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
        self.work = BackgroundJob("comparison", self._progress, self._ended, self._found)
        self.worker = LatestWorker(self._read, bench.show_error)

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
        with self._bench.drawing_lock:
            self._chosen = name
            self._draw()

    def take(self) -> None:
        """Write its cords in place of those that are drawn."""
        one = self._one()
        if one is None or not one.sensors:
            self._bench.show_message("Choose a layout first.")
            return
        self._bench.apply(take_cords(one.sensors))

    def weigh(self) -> None:
        """Compute what is not known yet."""
        bench = self._bench
        folder = build_folder(bench.project.device)
        if not self.layouts:
            bench.show_message(_NOTHING)
            return
        if bench.builds.running:
            bench.show_message("A build is running; cancel it, or wait for it, and weigh then.")
            return
        stage = first_outdated(bench.project.device, "simulate")
        if stage is not None:
            raise StorageError(
                f"the {_STALE[stage.name]} have changed since they were simulated: press 'Optimise"
                " the cords' first, then weigh"
            )
        if not self.work.start(_compare, bench.project.folder, folder):
            bench.show_message("They are being weighed already.")
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
            weighed, seconds = load_tried_layouts(folder), estimate_seconds(device, folder)
            found = [*weighed, *studied_layouts(device, folder)]
        except (DefsenseError, OSError):
            key, found, seconds = None, [], 0.0
        if key == self._key and found:
            return  # another stage was built: what was weighed still holds
        self.work.cancel()
        with self._bench.drawing_lock:
            self._key, self.layouts = key, _ranked(found)
            self._weigh.label = f"Weigh all (about {_rounded(seconds)} s)" if found else "Weigh all"
            self._state.content = ""
            self._draw()

    def _found(self, one: ComparedLayout) -> None:
        with self._bench.drawing_lock:
            others = [o for o in self.layouts if o.name != one.name]
            self.layouts = _ranked([*others, one])
            self._draw()

    def _progress(self, share: float, told: str) -> None:
        self._state.content = f"{share:.0%}: {told}"

    def _ended(self, error: DefsenseError | None, _: None) -> None:
        self._stop.visible = False
        self._state.content = "" if error is None else f"**{error}**"

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


def _compare(reporter: JobReporter, source: Path, folder: Path) -> None:
    """In the other process."""
    from ...core.device.device_file import load_device
    from ...core.machine.processes import one_blas_thread

    with one_blas_thread():  # as builds have it
        compare_layouts(load_device(source), folder, reporter.item, reporter.progress)
