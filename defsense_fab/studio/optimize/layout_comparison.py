"""Compare layouts side by side: as drawn, by eye, the most accurate, the simplest, and others."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...core.errors import DefsenseError, StorageError
from ...workflow.build.build import first_outdated
from ...workflow.build.results import layout_digest
from ...workflow.design.compare_layouts import (
    ComparedLayout,
    estimate_seconds,
    tried_layouts,
)
from ...workflow.study.cord_count import studied_layouts
from ..edits.cords import take_cords
from ..workbench.background_job import BackgroundJob
from ..workbench.comparison_job import by_error, round_time, run_comparison
from ..workbench.controls import NONE, on_user
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText, bullet_list, escape_cell, markdown_table
from ..workbench.workbench import Workbench

_NO_LAYOUTS = "No layouts yet. Optimize the cords first."
_COMPARE_LABEL = "Compare all"
_CHOSEN_TUBE_COLOR = (148, 70, 170)  # purple, next to gray, orange and blue
_CHOSEN_TUBE_RADIUS = 1.1  # times the cord's radius
_STAGE_INPUTS = {"body": "body", "mesh": "mesh", "simulate": "poses"}

# Layout of the charts, in pixels of their drawing.
_POINT_COLOR, _CHOSEN_POINT_COLOR = "#1f77b4", "#e68c1e"
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _BOTTOM, _TOP = 300, 170, 44, 8, 34, 12
_POINT_SHIFT = 9  # between points of the same count


class LayoutComparison:
    """Show the layouts of the last build, and compare others in a child process on request.

    Args:
        bench: The workbench.

    Attributes:
        layouts: The compared layouts, by increasing error.
        estimated_time_s: Estimated time of the comparison, s; 0 if unknown.
        job: Compares the layouts.
        worker: Reads the layouts of the last build.
        status: What the comparison does, or its error.
    """

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self.layouts: list[ComparedLayout] = []
        self.estimated_time_s = 0
        self.status = StatusText()
        self._chosen = NONE
        self._layout_digest: str | None = None  # of the build's layout that is compared
        self._is_shown = False
        self._tubes = CordTubes(bench.server, "/compared")
        self.job = BackgroundJob("comparison", self._show_progress, self._end, self._add)
        self.worker = LatestWorker(self._read, bench.status.show_error)

    @property
    def drawn_cords(self) -> set[str]:
        """Names of the cords of the chosen layout that are drawn."""
        return self._tubes.names

    def add_panel(self) -> None:
        """Add the table, the charts and the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._table = gui.add_markdown(_NO_LAYOUTS)
        self._charts = gui.add_html("")
        self._list = gui.add_dropdown(
            "Layout", (NONE,), hint="Choose the layout that is drawn in purple over the cords"
        )
        on_user(self._list, self.choose)
        self._notes = gui.add_markdown("")
        button(
            "Take this layout",
            "Replace the drawn cords by this layout. Undo restores them",
            self.take,
        )
        self._compare = button(
            _COMPARE_LABEL,
            "Make the parts of all layouts on trial and estimate the spread of built devices",
            self.compare,
        )
        self._stop = button(
            "Stop the comparison",
            "Stop and keep the finished layouts",
            self.job.cancel,
            visible=False,
        )
        self.status.add_panel(gui)

    def load(self) -> None:
        """Follow another build."""
        self.worker.give(None)

    def show(self, is_shown: bool) -> None:
        """Show or hide the chosen layout, while the drawing lock is held."""
        self._is_shown = is_shown
        self._draw_chosen()

    def choose(self, name: str) -> None:
        """Draw the layout of this name in the scene."""
        with self._bench.drawing_lock:
            self._chosen = name
            self._draw()

    def take(self) -> None:
        """Replace the drawn cords by those of the chosen layout."""
        layout = self._chosen_layout()
        if layout is None or not layout.sensors:
            self._bench.status.show("Choose a layout first.", "no-layout-chosen")
            return
        self._bench.apply(take_cords(layout.sensors))

    def compare(self) -> None:
        """Compute the missing numbers of the layouts in a child process.

        Raises:
            StorageError: The body, the mesh or the poses have changed since they were simulated.
        """
        bench = self._bench
        if not self.layouts:
            bench.status.show(_NO_LAYOUTS, "no-layouts")
            return
        if bench.builds.is_running:
            bench.status.show("A build is running. Cancel it or wait for it.", "build-running")
            return
        stage = first_outdated(bench.project.device, "simulate")
        if stage is not None:
            raise StorageError(
                f"the {_STAGE_INPUTS[stage.name]} changed after the simulation",
                code="build-outdated",
                action="Optimize the cords again before the comparison",
                stage=stage.name,
            )
        if not self.job.start(run_comparison, bench.project.folder):
            bench.status.show("The comparison is running already.", "comparison-running")
            return
        self._stop.visible = True

    def close(self) -> None:
        """End the comparison and the thread."""
        self.job.close()
        self.worker.close()

    def _chosen_layout(self) -> ComparedLayout | None:
        return next((layout for layout in self.layouts if layout.name == self._chosen), None)

    def _read(self, _: None) -> None:
        device, build = self._bench.project.device, self._bench.results
        try:
            current = layout_digest(build)
            tried, seconds = tried_layouts(build), estimate_seconds(device, build)
            layouts = [*tried, *studied_layouts(device, build.folder)]
        except (DefsenseError, OSError):
            current, layouts, seconds = None, [], 0.0
        if current == self._layout_digest and layouts:
            return  # another stage was built: the comparison is still valid
        self.job.cancel()
        with self._bench.drawing_lock:
            self._layout_digest, self.layouts = current, by_error(layouts)
            self.estimated_time_s = round_time(seconds) if layouts else 0
            time_text = f" (about {self.estimated_time_s} s)" if layouts else ""
            self._compare.label = f"{_COMPARE_LABEL}{time_text}"
            self.status.show("")
            self._draw()

    def _add(self, layout: ComparedLayout) -> None:
        with self._bench.drawing_lock:
            others = [other for other in self.layouts if other.name != layout.name]
            self.layouts = by_error([*others, layout])
            self._draw()

    def _show_progress(self, share: float, message: str) -> None:
        self.status.show(f"{share:.0%}: {message}")

    def _end(self, error: DefsenseError | None, _: None) -> None:
        self._stop.visible = False
        self.status.show("")
        if error is not None:
            self.status.show_error(error)

    def _draw(self) -> None:
        names = (NONE, *(layout.name for layout in self.layouts))
        if self._chosen not in names:
            self._chosen = NONE
        self._list.options, self._list.value = names, self._chosen
        self._table.content = comparison_table(self.layouts) if self.layouts else _NO_LAYOUTS
        self._charts.content = error_charts(self.layouts, self._chosen)
        layout = self._chosen_layout()
        self._notes.content = "" if layout is None else layout_notes(layout)
        self._draw_chosen()

    def _draw_chosen(self) -> None:
        layout = self._chosen_layout() if self._is_shown else None
        radius = _CHOSEN_TUBE_RADIUS * self._bench.project.device.cord.diameter / 2
        self._tubes.show(() if layout is None else layout.sensors, _CHOSEN_TUBE_COLOR, radius)


def comparison_table(layouts: Sequence[ComparedLayout]) -> str:
    """Return a table of layouts in markdown."""
    rows = []
    for layout in layouts:
        band = f"{layout.band[0]:.2f}–{layout.band[1]:.2f}" if layout.band else "?"
        parts = "?" if layout.parts is None else str(layout.parts)
        if layout.problem:
            band, parts = "", "cannot be made"
        name = escape_cell(layout.name)
        name = f"**{name}**" if layout.is_built else name
        count, planes = str(len(layout.sensors)), str(layout.planes)
        rows.append([name, _error_text(layout.error), band, parts, count, planes])
    note = (
        "mm: error in unseen states. 90 %: range of 90 % of built devices by noise and tolerances,"
        " without the cords' memory. Bold: layout of the build. ?: not computed; the errors of a"
        " study's layouts are those of the design."
    )
    if not any(layout.is_studied for layout in layouts):
        note += " `defsense study` adds other numbers of cords."
    table = markdown_table(["Layout", "mm", "90 %", "Parts", "Cords", "Planes"], rows, "lrlr")
    return f"{table}\n\n{note}"


def layout_notes(layout: ComparedLayout) -> str:
    """Return the problem or the warnings of a layout in markdown."""
    notes = [layout.problem] if layout.problem else layout.warnings
    return bullet_list(html.escape(note) for note in notes if note)


def error_charts(layouts: Sequence[ComparedLayout], chosen: str | None) -> str:
    """Return charts of the errors over the numbers of parts and of cords as HTML.

    Args:
        layouts: The layouts; those without an error are left out.
        chosen: Name of the layout that is highlighted, if any.
    """
    shown = [layout for layout in layouts if math.isfinite(layout.error) and layout.error > 0]
    if not shown:
        return ""
    return _chart(shown, chosen, "parts", lambda layout: layout.parts) + _chart(
        shown, chosen, "cords", lambda layout: len(layout.sensors)
    )


@dataclass(frozen=True)
class _Axes:
    """Axes of a chart: linear counts from left to right, logarithmic errors (mm) upwards."""

    low_count: float
    high_count: float
    low_error: float
    high_error: float

    def x(self, count: float) -> float:
        share = (count - self.low_count) / (self.high_count - self.low_count)
        return float(_LEFT + (_WIDTH - _LEFT - _RIGHT) * share)

    def y(self, error: float) -> float:
        share = math.log(self.high_error / error) / math.log(self.high_error / self.low_error)
        return float(_TOP + (_HEIGHT - _BOTTOM - _TOP) * share)


def _chart(
    layouts: Sequence[ComparedLayout],
    chosen: str | None,
    unit: str,
    count_of: Callable[[ComparedLayout], int | None],
) -> str:
    """Return one chart; its text has the color of the page, light or dark."""
    points = [(n, layout) for layout in layouts if (n := count_of(layout)) is not None]
    if not points:
        return ""
    errors = [mm for _, layout in points for mm in (layout.error, *(layout.band or ()))]
    axes = _Axes(
        min(n for n, _ in points) - 0.5,
        max(n for n, _ in points) + 0.5,
        0.8 * min(errors),
        1.25 * max(errors),
    )
    drawing = [
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" font-size="11" fill="currentColor"'
        f' role="img" aria-label="error over {unit}">',
        *_axis_lines(axes, sorted({n for n, _ in points}), unit),
    ]
    for k, (n, layout) in enumerate(points):
        same_count = sum(m == n for m, _ in points[:k])
        x = axes.x(n) + _POINT_SHIFT * (-1) ** same_count * ((same_count + 1) // 2)
        drawing += _point(axes, x, layout, is_chosen=layout.name == chosen)
    return "".join([*drawing, "</svg>"])


def _axis_lines(axes: _Axes, counts: Sequence[int], unit: str) -> list[str]:
    return [
        *(
            f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{axes.y(mm):.1f}"'
            f' y2="{axes.y(mm):.1f}" stroke="currentColor" opacity="0.2"/>'
            f'<text x="{_LEFT - 5}" y="{axes.y(mm) + 4:.1f}" text-anchor="end">{mm:g}</text>'
            for mm in _ticks(axes.low_error, axes.high_error)
        ),
        *(
            f'<text x="{axes.x(n):.1f}" y="{_HEIGHT - 18}" text-anchor="middle">{n}</text>'
            for n in counts
        ),
        f'<text x="{(_LEFT + _WIDTH) / 2}" y="{_HEIGHT - 4}" text-anchor="middle">{unit}</text>',
        f'<text x="2" y="{_TOP - 2}">mm</text>',
    ]


def _point(axes: _Axes, x: float, layout: ComparedLayout, *, is_chosen: bool) -> list[str]:
    """Return the point of a layout, with its range if that is known."""
    color, radius = (_CHOSEN_POINT_COLOR, 6) if is_chosen else (_POINT_COLOR, 4)
    drawing = []
    if layout.band:
        low, high = axes.y(layout.band[0]), axes.y(layout.band[1])
        drawing.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{low:.1f}" y2="{high:.1f}"'
            f' stroke="{color}" stroke-width="2"/>'
        )
    title = f"{html.escape(layout.name)}: {_error_text(layout.error)} mm"
    drawing.append(
        f'<circle cx="{x:.1f}" cy="{axes.y(layout.error):.1f}" r="{radius}" fill="{color}">'
        f"<title>{title}</title></circle>"
    )
    return drawing


def _ticks(low: float, high: float) -> list[float]:
    """Return 1, 2 and 5 times the powers of ten from `low` to `high`."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    candidates = [float(f"{k}e{power}") for power in powers for k in (1, 2, 5)]
    return [mm for mm in candidates if low <= mm <= high]


def _error_text(error: float) -> str:
    return f"{error:.2f}" if math.isfinite(error) else "?"
