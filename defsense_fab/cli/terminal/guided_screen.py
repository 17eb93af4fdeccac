"""Show a guided run in a terminal: full screen, or as plain lines."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.style import Style
from rich.table import Table
from rich.text import Text

from ...core.arrays import Float
from ...core.guided_parts import Bars, Curve, Part, Picture, Plot, draw_picture
from ...core.guided_run import GuidedView
from .keys import Keys

#: Of bars and curves, by their number.
COLORS = ("blue", "green", "red", "magenta", "cyan", "yellow")
_HIGHLIGHT_RGB, _MARK_RGB = (60, 220, 90), (240, 200, 60)
_GRAY = "bright_black"
_STATE_COLORS = {"": "blue", "ok": "green", "fault": "red"}  # of bars, by their state
_BAR_WIDTH, _MIN_BAR_WIDTH, _PLOT_WIDTH = 24, 3, 60  # characters
_MAX_PICTURE_WIDTH, _MIN_PICTURE_WIDTH = 72, 20  # characters
#: Sizes of pictures and plots on pages with fewer and fewer rows; 0 leaves them out.
_PAGE_SCALES = ((1.0, 1.0), (0.75, 0.75), (0.55, 0.55), (0.4, 0.4), (0.4, 0.0), (0.0, 0.0))
_LINE_INTERVAL_S = 10.0
#: Bits of the dots of a braille pattern, by row and column (Unicode 15, 2800-28FF).
_DOT_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))


class GuidedTerminal:
    """Full-screen display of a guided run; use it as a context manager.

    It restores the terminal at the end, and rings the bell when something is complete.

    Args:
        alternative: What the user can do without a terminal, for the error.
    """

    def __init__(self, alternative: str = "give --auto") -> None:
        self._console, self._keys = Console(), Keys(alternative)
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._was_active = False

    def __enter__(self) -> Self:
        """Start to read keys.

        Raises:
            DeviceError: Standard input is not a terminal (`terminal-missing`).
        """
        self._keys.__enter__()
        self._live.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.__exit__(None, None, None)
        self._keys.__exit__(None, None, None)

    def key(self, timeout: float) -> str | None:
        """Return the next key, as `Keys.get` does."""
        return self._keys.get(timeout)

    def show(self, view: GuidedView) -> None:
        """Show the most detailed page that fits the terminal."""
        if view.alert or (self._was_active and view.state.phase == "ready"):
            self._console.bell()
        self._was_active = view.state.phase == "active"
        page = fitting_page(self._console, pages(view, self._console.width))
        self._live.update(page, refresh=True)


class GuidedLines:
    """Display of a guided run as plain lines, for logs and programs; it reads no keys.

    Args:
        interval_s: Time after which a line is repeated in a long step, s.
    """

    def __init__(self, interval_s: float = _LINE_INTERVAL_S) -> None:
        self._interval_s = interval_s
        self._printed_step: tuple[int, int] | None = None
        self._printed_notes: set[tuple[str, str]] = set()
        self._printed_at = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing: the terminal was not changed."""

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        return None

    def show(self, view: GuidedView) -> None:
        """Print a line for each new step, at intervals, and for each new note."""
        now, step = time.monotonic(), (view.state.step, len(view.state.done))
        if step != self._printed_step or now - self._printed_at >= self._interval_s:
            texts = view.status
            if step != self._printed_step:
                texts = (view.instruction.replace("**", ""),)
            self._write("; ".join([view.title, *texts]))
            self._printed_step, self._printed_at = step, now
        for note in view.notes:
            if (note.code, note.where) not in self._printed_notes:
                self._printed_notes.add((note.code, note.where))
                self._write(f"note: {note}")

    def _write(self, line: str) -> None:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()


def fitting_page(console: Console, candidates: Iterable[Group]) -> Group:
    """Return the first page that fits the height of the console.

    If none fits, return the rows of the last page that fit above its last row, which lists the
    keys.
    """
    page = Group()
    for page in candidates:
        if _row_count(console, page) <= console.height:
            return page
    *rows, last = page.renderables
    free_rows, fitting = console.height - _row_count(console, Group(last)), []
    for row in rows:
        free_rows -= _row_count(console, Group(row))
        if free_rows < 0:
            break
        fitting.append(row)
    return Group(*fitting, last)


def _row_count(console: Console, page: Group) -> int:
    return len(console.render_lines(page, pad=False))


def pages(view: GuidedView, width: int) -> Iterator[Group]:
    """Return pages `width` characters wide, each with fewer rows than the one before."""
    pictures = [p for p in view.parts if isinstance(p, Picture)]
    count = max(len(pictures), 1)
    largest = max(24, min(_MAX_PICTURE_WIDTH, (width - 2 * count) // count))
    others = [p for p in view.parts if not isinstance(p, Picture)]
    for picture_scale, plot_scale in _PAGE_SCALES:
        rows: list[RenderableType] = [_title(view), _emphasized(view.instruction)]
        rows += [Text(line, "dim") for line in view.status]
        if picture_scale and pictures:
            picture_width = max(round(picture_scale * largest), _MIN_PICTURE_WIDTH)
            rows.append(Columns([_draw_picture(p, picture_width) for p in pictures]))
        for part in others:
            rows += _draw_part(part, plot_scale)
        rows += [Text(f"! {note}", "yellow") for note in view.notes]
        rows.append(_key_line(view))
        yield Group(*rows)


def _title(view: GuidedView) -> Text:
    out = Text(view.title, "bold cyan")
    if view.progress is not None:
        filled = round(_BAR_WIDTH * view.progress)
        out.append("  " + "━" * filled, "green")
        out.append("━" * (_BAR_WIDTH - filled), _GRAY)
    return out


def _emphasized(text: str) -> Text:
    out = Text()
    for k, words in enumerate(re.split(r"\*\*", text)):
        out.append(words, "bold" if k % 2 else "")
    return out


def _key_line(view: GuidedView) -> Text:
    texts = [
        f"{'Enter' if k.name == 'enter' else k.name} {k.label}" + (f" ({k.hint})" if k.hint else "")
        for k in view.state.keys
        if k.label
    ]
    return Text("   ".join(texts), "bold")


def _draw_part(part: Part, plot_scale: float) -> list[RenderableType]:
    if isinstance(part, Bars):
        return [*([Text(part.title, "dim")] if part.title else []), bar_table(part)]
    if isinstance(part, Plot) and plot_scale:
        return _draw_plot(part, plot_scale)
    return []


def bar_table(bars: Bars) -> Table:
    """Return bars as rows of characters."""
    table = Table.grid(padding=(0, 1))
    count, columns = bars.values.shape
    width = max(_BAR_WIDTH // columns, _MIN_BAR_WIDTH)
    names, texts = bars.names or ("",) * count, bars.texts or ("",) * count
    for k, (name, row, text) in enumerate(zip(names, bars.values, texts, strict=True)):
        color = COLORS[k % len(COLORS)] if bars.has_colors else "green"
        if bars.states:
            color = _STATE_COLORS[bars.states[k]]
        low, high = (2.0, 2.0) if bars.bands is None else bars.bands[k]
        middles = (np.arange(width) + 0.5) / width
        in_band = (low <= middles) & (middles <= high)
        cells = Text()
        for filled in np.ceil(width * np.clip(row, 0, 1)).astype(int):
            cells.append("█" * filled, color)
            cells.append("".join("▒" if b else "░" for b in in_band[filled:]), _GRAY)
            cells.append(" " if columns > 1 else "")
        table.add_row(Text(name, color if bars.has_colors else ""), cells, Text(text, "dim"))
    return table


def _draw_plot(plot: Plot, scale: float) -> list[RenderableType]:
    """Draw a plot with two by four dots per character."""
    width, height = _PLOT_WIDTH, max(round(scale * plot.aspect * _PLOT_WIDTH / 2), 3)
    bits = np.zeros((height, width), int)
    colors = np.full((height, width), "", dtype=object)
    left, right = plot.x
    bottom, top = plot.y

    def draw(x: Float, y: Float, color: str) -> None:
        with np.errstate(invalid="ignore"):
            i = np.round((x - left) / (right - left) * (2 * width - 1))
            j = np.round((top - y) / (top - bottom) * (4 * height - 1))
            is_inside = (i >= 0) & (i < 2 * width) & (j >= 0) & (j < 4 * height)
        for col, row in zip(i[is_inside].astype(int), j[is_inside].astype(int), strict=True):
            bits[row // 4, col // 2] |= _DOT_BITS[row % 4][col % 2]
            colors[row // 4, col // 2] = color

    if plot.has_axes:
        draw(np.linspace(left, right, 2 * width), np.zeros(2 * width), _GRAY)
        draw(np.zeros(4 * height), np.linspace(bottom, top, 4 * height), _GRAY)
    for curve in plot.curves:
        # A point is two by two dots.
        offsets = (0.0,) if curve.is_line else (0.0, 1.0)
        for dx in offsets:
            for dy in offsets:
                x = curve.x + dx * (right - left) / (2 * width - 1)
                draw(x, curve.y + dy * (top - bottom) / (4 * height - 1), _color(curve))
    rows: list[RenderableType] = [_plot_title(plot)] if plot.title else []
    for row_bits, row_colors in zip(bits, colors, strict=True):
        row = Text()
        for dots, color in zip(row_bits, row_colors, strict=True):
            row.append(chr(0x2800 + dots) if dots else " ", color)
        rows.append(row)
    return rows


def _plot_title(plot: Plot) -> Text:
    out = Text(plot.title, "dim")
    for curve in plot.curves:
        if curve.name:
            out.append(f"  {curve.name}", _color(curve))
    return out


def _color(curve: Curve) -> str:
    return _GRAY if curve.color is None else COLORS[curve.color % len(COLORS)]


def _draw_picture(part: Picture, width: int) -> Group:
    """Draw an image with two pixels per character, with its outlines and labels."""
    title = Text(f"{part.name}: ", "bold")
    if part.image is None:
        return Group(title.append(part.caption, "red"), *[Text(" " * width)] * 3)
    title.append(part.caption, "dim")
    h, w = part.image.shape[:2]
    height = max(2, round(width * h / w / 2) * 2)
    pixels = draw_picture(part, (width, height), _HIGHLIGHT_RGB, _MARK_RGB)
    rows = [_pixel_row(pixels[2 * k], pixels[2 * k + 1]) for k in range(height // 2)]
    for outline, label in zip(part.outlines, part.labels, strict=False):
        x, y = (outline.mean(axis=0) * (width / w, height / h)).astype(int)
        y //= 2
        if 0 <= y < len(rows) and 0 <= x <= width - len(label):
            rest = rows[y][x + len(label) :]
            rows[y] = Text.assemble(rows[y][:x], (label, "bold white on blue"), rest)
    return Group(title, *rows)


def _pixel_row(above: NDArray[np.uint8], below: NDArray[np.uint8]) -> Text:
    out = Text()
    for a, b in zip(above.tolist(), below.tolist(), strict=True):
        out.append("▀", Style(color=Color.from_rgb(*a), bgcolor=Color.from_rgb(*b)))
    return out
