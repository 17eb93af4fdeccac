"""The screen of a guided recording: pictures with the tags found, signals, poses, what is next."""

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
    "ready": "Enter begin   b back   s skip   q stop (resume later)",
    "showing": "r again   s next   q stop (resume later)",
    "done": "",
}
_NARROW = 20  # characters, of a picture at least
_BAR, _TRACE, _COLORS = 20, (60, 5), ("red", "green", "blue", "magenta", "cyan", "yellow")


class CaptureTerminal(LiveScreen):
    """A `CaptureScreen`; enter it before use. Rings the bell when a step is over."""

    def __init__(self) -> None:
        super().__init__()
        self._phase = ""

    def show(self, view: CaptureView) -> None:
        if view.phase == "ready" and self._phase == "showing":
            self._console.bell()
        self._phase = view.phase
        self._draw(pages(view, self._console.width))


def pages(view: CaptureView, width: int) -> Iterator[Group]:
    """All of it, `width` characters wide, with less and less for terminals that are not high."""
    n = max(len(view.cameras), 1)
    wide = max(24, min(58, (width - 2 * n) // n))
    for part, course in ((1.0, True), (0.75, True), (0.6, True), (0.6, False), (0.45, False)):
        yield _page(view, max(round(part * wide), _NARROW), course)
    yield _page(view, 0, course=False)


def _page(view: CaptureView, wide: int, course: bool) -> Group:
    """With pictures that are so wide, none for 0, and the signals' `course`."""
    rows: list[object] = [_head(view), Text(view.next, "bold")]
    if wide:
        rows.append(Columns([_camera(c, wide) for c in view.cameras]))
    rows.append(_tags(view))
    rows += _signals(view, course)
    rows += _poses(view)
    rows += [Text(f"! {note}", "yellow") for note in view.notes]
    rows.append(Text(_KEYS[view.phase], "bold"))
    return Group(*rows)  # type: ignore[arg-type]


def _head(view: CaptureView) -> Text:
    name, seconds = view.steps[view.step]
    out = Text(f"step {view.step + 1} of {len(view.steps)}: ")
    out.append(name, "bold cyan")
    if view.phase == "showing":
        filled = round(_BAR * (1 - view.left / max(seconds, 1e-9)))
        out.append("  " + "━" * filled, "green")
        out.append("━" * (_BAR - filled), "dim")
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


def _signals(view: CaptureView, course: bool) -> list[object]:
    """Bars of (R - R0)/R0, and their `course`."""
    table = Table.grid(padding=(0, 1))
    for width in (None, 8, _BAR):
        table.add_column(no_wrap=True, min_width=width)
    for k, (name, value) in enumerate(zip(view.channels, view.signals, strict=True)):
        color = _COLORS[k % len(_COLORS)]
        if not math.isfinite(value):
            table.add_row(Text(name, color), Text("-"), Text(""))
            continue
        filled = min(_BAR, round(abs(value) / 0.2 * _BAR))
        table.add_row(Text(name, color), Text(f"{value:+7.2%}"), Text("█" * filled, color))
    history = view.history
    if not course or history.ndim != 2 or len(history) < 10:
        return [table]
    with np.errstate(all="ignore"):
        middle = np.nanmedian(history, axis=0)
        change = relative_change(history, middle)
    most = max(float(np.nanmax(np.abs(change), initial=0.0)), 0.02)
    canvas = Canvas(*_TRACE, (0, len(change) - 1), (-most, most))
    for k in range(change.shape[1]):
        good = np.flatnonzero(np.isfinite(change[:, k]))
        canvas.dots(((float(i), float(change[i, k])) for i in good), _COLORS[k % len(_COLORS)])
    beside = Table.grid(padding=(0, 2))
    beside.add_row(Group(*canvas.lines()), table)
    return [beside]


def _poses(view: CaptureView) -> list[object]:
    """How much of each pose's way was seen."""
    if not view.reached:
        return []
    table = Table.grid(padding=(0, 1))
    for name, (most, seen) in view.reached.items():
        bar = Text()
        for part in seen:
            bar.append("███ " if part else "░░░ ", "green" if part else "dim")
        table.add_row(Text(name), bar, Text(f"up to {most:.0%}", "dim"))
    return [Text("of the way from rest to each pose, seen so far:", "dim"), table]


class CaptureLines:
    """A `CaptureScreen` of plain lines, for logs and programs: no keys. One line a step, and one
    every so many s in a long one."""

    def __init__(self, every: float = 10.0) -> None:
        self._step, self._told = -1, set[str]()
        self._every, self._last = every, 0.0

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        return None

    def show(self, view: CaptureView) -> None:
        now = time.monotonic()
        if view.phase == "showing" and (view.step != self._step or now - self._last >= self._every):
            name, seconds = view.steps[view.step]
            begun = view.step != self._step
            self._step, self._last = view.step, now
            covered = ", ".join(f"{n} {seen.mean():.0%}" for n, (_, seen) in view.reached.items())
            self._write(
                f"step {view.step + 1}/{len(view.steps)}: {name},"
                f" {f'{seconds:g} s' if begun else f'{view.left:.0f} s left'};"
                f" {view.several} of {view.tags} tags by several cameras; {view.samples} samples,"
                f" {view.frames} pictures written" + (f"; seen: {covered}" if covered else "")
            )
        for note in view.notes:
            kind = "".join(c for c in note if not c.isdigit())  # not again for every new number
            if kind not in self._told:
                self._told.add(kind)
                self._write(f"note: {note}")

    def _write(self, line: str) -> None:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
