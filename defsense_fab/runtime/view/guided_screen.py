"""Show a guided run in the panel of a page: instructions, buttons, plots and pictures."""

from __future__ import annotations

import html
import queue
import time
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.guided_parts import Bars, Part, Picture, Plot, draw_picture
from ...core.guided_run import GuidedView, Key
from .live_scene import LINES

PICTURE_WIDTH = 320  # pixels
#: Color-blind people can distinguish highlighted outlines from others.
HIGHLIGHT_RGB, MARK_RGB = (0, 158, 115), (230, 159, 0)
EMPTY_COLOR = "rgba(128,128,128,.25)"
BAND_COLOR = "rgba(0,158,115,.3)"
#: Of bars by their state, distinct for color-blind people (Okabe & Ito 2008).
STATE_COLORS = {"": "#0072b2", "ok": "#009e73", "fault": "#d55e00"}
_PLOT_WIDTH = 260  # pixels
_TEXT_INTERVAL_S, _PICTURE_INTERVAL_S = 0.25, 0.5  # between updates


class GuidedScreen:
    """Shows a guided run; buttons press its keys, on any thread.

    Args:
        server: The viser server.
        folder: Folder of the panel that holds the controls; None for the panel itself.
        title: Name of the new folder in it.
        lock: Held while the screen is removed; None if nothing else draws on the page.

    Attributes:
        view: The state that is shown, or None before the first one.
        pictures: The shown pictures (h, PICTURE_WIDTH, 3) by the names of the cameras.
        text_interval_s: Time between updates of the texts and the plots, s.
        picture_interval_s: Time between updates of the pictures, s.
    """

    def __init__(
        self,
        server: Any,
        folder: Any,
        title: str,
        lock: AbstractContextManager[Any] | None = None,
    ) -> None:
        self._gui, self._lock = server.gui, lock or nullcontext()
        self._keys = queue.SimpleQueue[str]()
        self.view: GuidedView | None = None
        self.pictures: dict[str, NDArray[np.uint8]] = {}
        self.text_interval_s, self.picture_interval_s = _TEXT_INTERVAL_S, _PICTURE_INTERVAL_S
        self._drawn_at = self._pictures_drawn_at = 0.0
        self._button_groups: dict[tuple[Key, ...], Any] = {}
        self._camera_handles: dict[str, tuple[Any, Any]] = {}
        with folder or nullcontext():
            self._folder = self._gui.add_folder(title)
        with self._folder:
            self._text = self._gui.add_markdown("Preparing ...")
            self._buttons_folder = self._gui.add_folder(None)
            self._pictures_folder = self._gui.add_folder(None)
            self._parts = self._gui.add_html("")

    def press(self, key: str) -> None:
        """Press a key, such as "enter" or "q"."""
        self._keys.put(key)

    def key(self, timeout: float) -> str | None:
        """Return the next key, or None if none is pressed within `timeout` seconds."""
        try:
            return self._keys.get(timeout=timeout)
        except queue.Empty:
            return None

    def show(self, view: GuidedView) -> None:
        """Show the state of the run, at most once in each interval."""
        now = time.monotonic()
        if now - self._drawn_at < self.text_interval_s and view.state.phase != "done":
            return
        self._drawn_at = now
        self.view = view
        self._text.content = view_text(view)
        self._show_buttons(view.state.keys)
        parts = "".join(map(part_html, view.parts))
        if self._parts.content != parts:
            self._parts.content = parts
        if now - self._pictures_drawn_at >= self.picture_interval_s:
            self._pictures_drawn_at = now
            self._show_pictures([p for p in view.parts if isinstance(p, Picture)])

    def close(self) -> None:
        """Remove the screen from the page."""
        with self._lock:
            self._folder.remove()

    def _show_buttons(self, keys: tuple[Key, ...]) -> None:
        """Show a button for each key that has a label, and hide those of other phases."""
        names = {key.label.capitalize(): key.name for key in keys if key.label}
        if names and keys not in self._button_groups:
            with self._buttons_folder:
                group = self._gui.add_button_group("Step", tuple(names))
            group.on_click(lambda _: self.press(names[group.value]))
            self._button_groups[keys] = group
        for other, group in self._button_groups.items():
            group.visible = other == keys

    def _show_pictures(self, pictures: list[Picture]) -> None:
        for part in pictures:
            image, text = small_picture(part), f"{part.name}: {part.caption}"
            self.pictures[part.name] = image
            if part.name not in self._camera_handles:
                with self._pictures_folder:
                    handles = (
                        self._gui.add_markdown(text),
                        self._gui.add_image(image, format="jpeg"),
                    )
                self._camera_handles[part.name] = handles
                continue
            text_handle, image_handle = self._camera_handles[part.name]
            text_handle.content, image_handle.image = text, image


def view_text(view: GuidedView) -> str:
    """Return the step, the instruction, what was received and the warnings in markdown."""
    notes = [f"- **{note}**" for note in view.notes]
    return "\n\n".join([f"#### {view.title}", view.instruction, *view.status, *notes])


def small_picture(part: Picture) -> NDArray[np.uint8]:
    """Return a camera's picture (h, PICTURE_WIDTH, 3) RGB with its outlines.

    It is gray if there is no recent picture.
    """
    if part.image is None:
        return np.full((PICTURE_WIDTH * 9 // 16, PICTURE_WIDTH, 3), 128, np.uint8)
    h, w = part.image.shape[:2]
    size = PICTURE_WIDTH, max(2, round(PICTURE_WIDTH * h / w))
    return draw_picture(part, size, HIGHLIGHT_RGB, MARK_RGB, line_width=2)


def part_html(part: Part) -> str:
    """Return bars, a plot or a table as HTML; empty for a picture."""
    if isinstance(part, Picture):
        return ""
    title = html.escape(part.title)
    if isinstance(part, Plot):
        body, title = _plot_svg(part), title + _legend(part)
    else:
        body = _bars_html(part)
    return f'<div style="font-size:11px;line-height:1.4">{body}<div>{title}</div></div>'


def _bars_html(bars: Bars) -> str:
    count, rows = len(bars.values), []
    names, texts = bars.names or ("",) * count, bars.texts or ("",) * count
    for k, (name, row, text) in enumerate(zip(names, bars.values, texts, strict=True)):
        color = _color(k if bars.has_colors else 0)
        if bars.states:
            color = STATE_COLORS[bars.states[k]]
        band = "" if bars.bands is None else _band_html(*bars.bands[k])
        boxes = "".join(
            f'<span style="flex:1;margin-right:2px;position:relative;background:{EMPTY_COLOR}">'
            f'{band}<span style="display:block;position:relative;height:9px;'
            f'width:{100 * np.clip(share, 0, 1):.0f}%;background:{color}"></span></span>'
            for share in row
        )
        rows.append(
            '<div style="display:flex;align-items:center;gap:4px"><span style="width:25%;overflow:'
            f'hidden;text-overflow:ellipsis">{html.escape(name)}</span><span style="flex:1;display:'
            f'flex">{boxes}</span><span style="width:24%;text-align:right">{html.escape(text)}'
            "</span></div>"
        )
    return "".join(rows)


def _band_html(low: float, high: float) -> str:
    """Return the expected range of a bar, which the bar is drawn over."""
    left, right = (100 * np.clip(share, 0, 1) for share in (low, high))
    return (
        f'<span style="position:absolute;left:{left:.1f}%;width:{right - left:.1f}%;top:-3px;'
        f'bottom:-3px;background:{BAND_COLOR}"></span>'
    )


def _plot_svg(plot: Plot) -> str:
    height = round(_PLOT_WIDTH * plot.aspect)
    (left, right), (bottom, top) = plot.x, plot.y

    def pixels(x: Any, y: Any) -> tuple[Any, Any]:
        return (x - left) / (right - left) * _PLOT_WIDTH, (top - y) / (top - bottom) * height

    x0, y0 = pixels(0.0, 0.0)
    axes = f"M0 {y0:.1f}H{_PLOT_WIDTH}M{x0:.1f} 0V{height}" if plot.has_axes else ""
    shapes = [f'<path d="{axes}" stroke="currentColor" opacity=".4"/>']
    for curve in plot.curves:
        is_valid = np.isfinite(curve.x) & np.isfinite(curve.y)
        x, y = pixels(curve.x[is_valid], curve.y[is_valid])
        color = _color(curve.color)
        if curve.is_line:
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            shapes.append(f'<polyline points="{points}" fill="none" stroke="{color}"/>')
        else:
            shapes += [
                f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="{color}"/>'
                for a, b in zip(x, y, strict=True)
            ]
    return (
        f'<svg width="{_PLOT_WIDTH}" height="{height}"'
        f' style="background:rgba(128,128,128,.12)">{"".join(shapes)}</svg>'
    )


def _legend(plot: Plot) -> str:
    return "".join(
        f' <span style="color:{_color(curve.color)}">{html.escape(curve.name)}</span>'
        for curve in plot.curves
        if curve.name
    )


def _color(number: int | None) -> str:
    return "gray" if number is None else LINES[number % len(LINES)]
