"""Display of a guided recording: pictures with detected tags, signals, poses, next step."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator

import numpy as np
from rich.columns import Columns
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ...capture.sessions.guided_recording import CameraView, CaptureView
from ...sensing.response import relative_change
from .canvas import Canvas
from .picture import GREEN, YELLOW, picture
from .screen import LiveScreen

_KEYS = {
    "ready": "Enter start   b back   s skip   q stop (resume later)",
    "showing": "r again   s next   q stop (resume later)",
    "done": "",
}
_MIN_PICTURE_WIDTH = 20  # characters
_BAR_WIDTH = 20
_TRACE_SIZE = 60, 5  # characters and rows
_COLORS = ("red", "green", "blue", "magenta", "cyan", "yellow")


class CaptureTerminal(LiveScreen):
    """Full-screen display of the recording; it rings the bell when a step is complete."""

    def __init__(self) -> None:
        super().__init__()
        self._phase = ""

    def show(self, view: CaptureView) -> None:
        if view.phase == "ready" and self._phase == "showing":
            self._console.bell()
        self._phase = view.phase
        self._draw(pages(view, self._console.width))


def pages(view: CaptureView, width: int) -> Iterator[Group]:
    """Return pages `width` characters wide, each with fewer rows than the one before."""
    n = max(len(view.cameras), 1)
    picture_width = max(24, min(58, (width - 2 * n) // n))
    for scale, has_trace in ((1.0, True), (0.75, True), (0.6, True), (0.6, False), (0.45, False)):
        yield _page(view, max(round(scale * picture_width), _MIN_PICTURE_WIDTH), has_trace)
    yield _page(view, 0, has_trace=False)


def _page(view: CaptureView, picture_width: int, has_trace: bool) -> Group:
    """Return a page with pictures of this width (0 for none), with or without the trace."""
    rows: list[object] = [_head(view), Text(view.next, "bold")]
    if picture_width:
        rows.append(Columns([_camera(c, picture_width) for c in view.cameras]))
    rows.append(_tags(view))
    rows += _signals(view, has_trace)
    rows += _poses(view)
    rows += [Text(f"! {note}", "yellow") for note in view.notes]
    rows.append(Text(_KEYS[view.phase], "bold"))
    return Group(*rows)  # type: ignore[arg-type]


def _head(view: CaptureView) -> Text:
    name, seconds = view.steps[view.step]
    out = Text(f"step {view.step + 1} of {len(view.steps)}: ")
    out.append(name, "bold cyan")
    if view.phase == "showing":
        filled = round(_BAR_WIDTH * (1 - view.left / max(seconds, 1e-9)))
        out.append("  " + "━" * filled, "green")
        out.append("━" * (_BAR_WIDTH - filled), "dim")
        out.append(f" {view.left:.0f} s")
    elif view.phase == "ready":
        out.append(f"  ({seconds:.0f} s; press Enter)", "yellow")
    out.append(f"   {view.samples} samples, {view.frames} pictures written", "dim")
    return out


def _camera(shown: CameraView, width: int) -> Group:
    title = Text(f"{shown.name} ", "bold")
    if shown.image is None:
        return Group(title + Text("no picture", "red"), *[Text(" " * width)] * 3)
    title.append(f"{len(shown.ids)} tags, {shown.rate:.0f} frames/s", "dim")
    marks = [
        (quad, GREEN if both else YELLOW)
        for quad, both in zip(shown.outlines, shown.shared, strict=True)
    ]
    labels = [
        (quad.mean(axis=0), str(number))
        for quad, number in zip(shown.outlines, shown.ids, strict=True)
    ]
    return Group(title, *picture(shown.image, width, marks, labels))


def _tags(view: CaptureView) -> Text:
    out = Text(f"tags: {view.several} of {view.tags} by several cameras", "green")
    out.append(f", {view.single} by one", "yellow")
    if math.isfinite(view.residual):
        out.append(f"   residual {view.residual:.2f} px", "green" if view.residual < 0.5 else "red")
    return out


def _signals(view: CaptureView, has_trace: bool) -> list[object]:
    """Return bars of (R - R0)/R0, and their trace over time."""
    table = Table.grid(padding=(0, 1))
    for width in (None, 8, _BAR_WIDTH):
        table.add_column(no_wrap=True, min_width=width)
    for k, (name, value) in enumerate(zip(view.channels, view.signals, strict=True)):
        color = _COLORS[k % len(_COLORS)]
        if not math.isfinite(value):
            table.add_row(Text(name, color), Text("-"), Text(""))
            continue
        filled = min(_BAR_WIDTH, round(abs(value) / 0.2 * _BAR_WIDTH))
        table.add_row(Text(name, color), Text(f"{value:+7.2%}"), Text("█" * filled, color))
    history = view.history
    if not has_trace or history.ndim != 2 or len(history) < 10:
        return [table]
    with np.errstate(all="ignore"):
        median = np.nanmedian(history, axis=0)
        change = relative_change(history, median)
    limit = max(float(np.nanmax(np.abs(change), initial=0.0)), 0.02)
    canvas = Canvas(*_TRACE_SIZE, (0, len(change) - 1), (-limit, limit))
    for k in range(change.shape[1]):
        valid = np.flatnonzero(np.isfinite(change[:, k]))
        canvas.dots(((float(i), float(change[i, k])) for i in valid), _COLORS[k % len(_COLORS)])
    columns = Table.grid(padding=(0, 2))
    columns.add_row(Group(*canvas.lines()), table)
    return [columns]


def _poses(view: CaptureView) -> list[object]:
    """Return how much of each pose was recorded."""
    if not view.reached:
        return []
    table = Table.grid(padding=(0, 1))
    for name, (most, parts) in view.reached.items():
        bar = Text()
        for part in parts:
            bar.append("███ " if part else "░░░ ", "green" if part else "dim")
        table.add_row(Text(name), bar, Text(f"up to {most:.0%}", "dim"))
    return [Text("recorded so far, from rest to each pose:", "dim"), table]


class CaptureLines:
    """Display of the recording as plain lines, for logs and programs; it reads no keys.

    Args:
        interval: Time after which a line is repeated in a long step, in s.
    """

    def __init__(self, interval: float = 10.0) -> None:
        self._step, self._printed_notes = -1, set[str]()
        self._interval, self._last = interval, 0.0

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        return None

    def show(self, view: CaptureView) -> None:
        now = time.monotonic()
        if view.phase == "showing" and (
            view.step != self._step or now - self._last >= self._interval
        ):
            name, seconds = view.steps[view.step]
            is_new = view.step != self._step
            self._step, self._last = view.step, now
            covered = ", ".join(f"{n} {parts.mean():.0%}" for n, (_, parts) in view.reached.items())
            self._write(
                f"step {view.step + 1}/{len(view.steps)}: {name},"
                f" {f'{seconds:g} s' if is_new else f'{view.left:.0f} s left'};"
                f" {view.several} of {view.tags} tags by several cameras; {view.samples} samples,"
                f" {view.frames} pictures written" + (f"; recorded: {covered}" if covered else "")
            )
        for note in view.notes:
            kind = "".join(c for c in note if not c.isdigit())  # a changed number is not a new note
            if kind not in self._printed_notes:
                self._printed_notes.add(kind)
                self._write(f"note: {note}")

    def _write(self, line: str) -> None:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
