"""Display of the guided measurement: the next step, the settling, and the plot so far."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ...calibration.guided_measurement import MeasurementView
from ...calibration.protocol import JigStep
from ...calibration.session import CHANNELS
from ...core.storage.session_manifest import Criterion
from .canvas import Canvas
from .screen import LiveScreen

_STYLES = {"top": "red", "neutral": "green", "bottom": "blue"}
_FACES = {"a": ("BOTTOM", "top"), "b": ("TOP", "bottom")}
_KEYS = {
    "place": "Enter measure   b back (repeat the last)   s skip   q stop (resume later)",
    "settling": "r repeat (slipped)   t take now   b place again   s skip   q stop (resume later)",
    "unplugged": "waiting for the read-out board...   q stop (resume later)",
    "done": "",
}
_PICTURE_WIDTH, _PLOT_WIDTH = 64, 60  # characters, for a picture of 8 rows and for the plot
_BAR_WIDTH = 24


class MeasurementTerminal(LiveScreen):
    """Full-screen display of the measurement; use it as a context manager.

    It rings the bell when the specimen has to be placed on the next jig.

    Args:
        criterion: When a reading has settled.
        thickness: Thickness of the specimen in mm.
        length: Length of the specimen in mm.
    """

    def __init__(self, criterion: Criterion, thickness: float, length: float) -> None:
        self._criterion, self._thickness, self._length = criterion, thickness, length
        super().__init__()
        self._phase = ""

    def show(self, view: MeasurementView) -> None:
        if view.phase == "place" and self._phase == "settling":
            self._console.bell()
        self._phase = view.phase
        self._draw(self.pages(view))

    def pages(self, view: MeasurementView) -> Iterator[Group]:
        """Return pages, each with fewer rows than the one before."""
        for picture, plot in ((8, 14), (6, 9), (4, 6), (0, 6), (0, 0)):
            yield self._page(view, picture, plot)

    def _page(self, view: MeasurementView, picture: int, plot: int) -> Group:
        """Return a page; `picture` and `plot` are numbers of rows, 0 for none."""
        parts: list[object] = [_progress(view)]
        if view.step is not None:
            parts.append(Panel(self._task(view, view.step, picture), padding=(0, 1)))
        parts += [_bars(view), *(_plot(view, plot) if plot else [])]
        parts += [Text(f"! {note}", "yellow") for note in view.notes]
        parts.append(Text(_KEYS[view.phase], "bold"))
        return Group(*parts)  # type: ignore[arg-type]

    def _task(self, view: MeasurementView, step: JigStep, picture: int) -> Group:
        down, up = _FACES[step.face]
        words = Text()
        if view.phase == "unplugged":
            words.append("The read-out board is disconnected. ", "bold red")
            words.append("Connect it again; this step will then be repeated.")
        else:
            words.append("Place the specimen on ")
            words.append("the flat jig" if step.radius is None else f"jig {step.jig}", "bold")
            words.append(", its ")
            words.append(down, "bold " + _STYLES[down.lower()])
            words.append(f" side on the jig, the {up} cord up, and strap it down.")
        rows: list[object] = [words, *(self._picture(step, picture) if picture else [])]
        if view.phase == "settling":
            rows.append(self._settling(view))
        else:
            rows.append(Text(str(self._criterion), "dim"))
        return Group(*rows)  # type: ignore[arg-type]

    def _settling(self, view: MeasurementView) -> Text:
        c, at = self._criterion, view.settling
        out = Text(f"settling: {view.elapsed:4.0f} s   ")
        if at is None:
            out.append(f"waiting for the first {c.window:g} s")
        else:
            style = "green" if at.change < c.tolerance else "yellow"
            out.append(f"change {at.change:.3%}", style)
            out.append(f", limit {c.tolerance:.2%}")
        return out

    def _picture(self, step: JigStep, rows: int) -> list[Text]:
        """Draw the specimen on its jig from the side, to scale, with this number of rows."""
        half, h = self._length / 2, self._thickness
        size = round(_PICTURE_WIDTH * rows / 8), rows
        canvas = Canvas(
            *size,
            (-1.05 * half, 1.05 * half),
            (-0.5 * half, 1.3 * h),
        )
        style = _STYLES["bottom" if step.face == "a" else "top"]
        levels = [(0.0, "white"), (h, "white"), (0.14 * h, style),
                  (0.86 * h, _STYLES["top" if step.face == "a" else "bottom"])]  # fmt: skip
        for height, color in levels:
            canvas.dots(
                (_on_jig(step.radius, s * half / 100, height, h) for s in range(-100, 101)), color
            )
        for height in (-0.25 * h, -0.5 * h):
            canvas.dots(
                (_on_jig(step.radius, s * half / 100, height, h) for s in range(-100, 101)), "dim"
            )
        return canvas.lines()


def _on_jig(radius: float | None, s: float, height: float, thickness: float) -> tuple[float, float]:
    """Return the position of the point `height` above the jig, `s` along the neutral plane."""
    if radius is None:
        return s, height
    angle = s / (radius + thickness / 2)
    return (radius + height) * math.sin(angle), (radius + height) * math.cos(angle) - radius


def _progress(view: MeasurementView) -> Text:
    filled = round(_BAR_WIDTH * view.done / view.total)
    out = Text("calibration  ")
    out.append("━" * filled, "green")
    out.append("━" * (_BAR_WIDTH - filled), "dim")
    out.append(f"  {view.done} of {view.total} readings")
    if view.step is not None:
        out.append(f", round {view.step.turn + 1}")
    out.append(f"   {view.frames} frames written", "dim")
    return out


def _bars(view: MeasurementView) -> Table:
    return bars(dict(zip(CHANNELS, (float(r) for r in view.ohm), strict=True)))


def bars(ohm: dict[str, float], max_ohm: float | None = None) -> Table:
    """Return resistances as bars.

    Args:
        ohm: Resistances in ohm by name; 0 is a short circuit, infinity an open one, NaN unknown.
        max_ohm: Resistance of a full bar; None fits the largest.
    """
    table = Table.grid(padding=(0, 1))
    finite = [r for r in ohm.values() if math.isfinite(r)]
    scale = max_ohm or max(finite, default=1.0) * 1.15 or 1.0
    for name, r in ohm.items():
        filled = round(_BAR_WIDTH * min(r / scale, 1)) if math.isfinite(r) else 0
        value = f"{r:.1f} ohm" if math.isfinite(r) and r > 0 else "short" if r == 0 else "open"
        value = "-" if math.isnan(r) else value
        bar = Text("█" * filled, _STYLES.get(name, "cyan"))
        bar.append("░" * (_BAR_WIDTH - filled), "dim")
        table.add_row(Text(name, _STYLES.get(name, "")), bar, value)
    return table


def _plot(view: MeasurementView, height: int) -> list[Text]:
    """Plot (R - R0)/R0 over strain with `height` rows."""
    if not view.points:
        return [Text("the plot starts with the first reading on the flat jig", "dim")]
    x = max(max(abs(p.strain) for p in view.points) * 1.1, 0.01)
    y = max(max(abs(p.change) for p in view.points) * 1.1, 0.005)
    canvas = Canvas(_PLOT_WIDTH, height, (-x, x), (-y, y))
    canvas.line((-x, 0), (x, 0), "dim")
    canvas.line((0, -y), (0, y), "dim")
    square = [(i * x / _PLOT_WIDTH, j * y / height / 2) for i in (0, 1) for j in (0, 1)]
    for place in ("neutral", "bottom", "top"):
        points = [p for p in view.points if p.place == place]
        canvas.dots(
            ((p.strain + dx, p.change + dy) for p in points for dx, dy in square), _STYLES[place]
        )
    rows = canvas.lines()
    rows[0].append(f" {y:+.1%}", "dim")
    rows[-1].append(f" {-y:+.1%}", "dim")
    legend = Text(f"{-x:+.1%} strain{' ' * (_PLOT_WIDTH - 22)}{x:+.1%}  ", "dim")
    for place in ("top", "neutral", "bottom"):
        legend.append(f" {place}", _STYLES[place])
    return [Text("(R - R0)/R0", "dim"), *rows, legend]


class MeasurementLines:
    """Display of the measurement as plain lines, for logs and programs; it reads no keys."""

    def __init__(self) -> None:
        self._done = -1
        self._shown_notes: set[str] = set()

    def show(self, view: MeasurementView) -> None:
        if view.done != self._done:
            self._done = view.done
            step = view.step
            where = "" if step is None else f"  next: {step.jig}, face {step.face}"
            sys.stderr.write(f"{view.done}/{view.total}{where}\n")
        for note in view.notes:
            if str(note) not in self._shown_notes:
                self._shown_notes.add(str(note))
                sys.stderr.write(f"note: {note}\n")

    def key(self, timeout: float) -> str | None:
        import time

        time.sleep(timeout)
        return None
