"""Show a guided run in the browsers of a server, whose buttons and keys control it."""

from __future__ import annotations

import queue
import time
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.guided_parts import Bars, Curve, Part, Picture, Plot, draw_picture
from ...core.guided_run import GuidedView
from .client import Client
from .live_messages import (
    GuidedBars,
    GuidedCurve,
    GuidedKey,
    GuidedPicture,
    GuidedPlot,
    GuidedState,
    PressKey,
)
from .live_place import Handler
from .messages import Arrays, Event, Request

PICTURE_WIDTH = 480  # pixels
#: Color-blind people can distinguish highlighted outlines from others.
HIGHLIGHT_RGB, MARK_RGB = (0, 158, 115), (230, 159, 0)
_TEXT_INTERVAL_S, _PICTURE_INTERVAL_S = 0.1, 0.2  # between updates
_JPEG_QUALITY = 80
_DIGITS = 4  # of shares and coordinates in plots


class Publisher(Protocol):
    """Sends messages to all browsers, as `WebServer` does."""

    def publish(self, event: Event) -> None: ...

    def publish_arrays(self, arrays: Arrays) -> None: ...


class GuidedScreen:
    """Shows a guided run on the pages of a server; browsers press its keys, on any thread.

    Args:
        server: Sends events and arrays to the browsers.
        title: Title of the run.

    Attributes:
        view: The state that is shown, or None before the first one.
        text_interval_s: Time between updates of the texts and the plots, s.
        picture_interval_s: Time between updates of the pictures, s.
    """

    def __init__(self, server: Publisher, title: str) -> None:
        self._server, self._title = server, title
        self._keys = queue.SimpleQueue[str]()
        self.view: GuidedView | None = None
        self.text_interval_s, self.picture_interval_s = _TEXT_INTERVAL_S, _PICTURE_INTERVAL_S
        self._shown_at = self._pictures_shown_at = 0.0
        self._alerts, self._was_active = 0, False
        self._state = GuidedState(run=title, title="Preparing ...")
        server.publish(self._state)

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that the screen handles."""
        return {PressKey: self.handle_key}

    def press(self, key: str) -> None:
        """Press a key, such as "enter" or "q"."""
        self._keys.put(key)

    def key(self, timeout: float) -> str | None:
        """Return the next key, or None if none is pressed within `timeout` seconds."""
        try:
            return self._keys.get(timeout=timeout) if timeout > 0 else self._keys.get_nowait()
        except queue.Empty:
            return None

    def show(self, view: GuidedView) -> None:
        """Show the state of the run, at most once in each interval."""
        phase = view.state.phase
        self._alerts += view.alert or (self._was_active and phase == "ready")
        self._was_active = phase == "active"
        now = time.monotonic()
        if now - self._shown_at < self.text_interval_s and phase != "done":
            return
        self._shown_at = now
        self.view = view
        state = guided_state(self._title, view, self._alerts)
        if state != self._state:
            self._state = state
            self._server.publish(state)
        if now - self._pictures_shown_at >= self.picture_interval_s:
            self._pictures_shown_at = now
            for part in view.parts:
                if isinstance(part, Picture) and part.image is not None:
                    self._server.publish_arrays(_picture_arrays(part))

    def handle_key(self, _: Client, request: PressKey) -> None:
        """Press a key, unless the run has reached another step or phase meanwhile."""
        if (request.step, request.phase) == (self._state.step, self._state.phase):
            self.press(request.key)

    def close(self) -> None:
        """Remove the screen from the pages."""
        self._server.publish(GuidedState(run=""))


def guided_state(run: str, view: GuidedView, alerts: int = 0) -> GuidedState:
    """Return the message that describes the state of a guided run.

    Args:
        run: Title of the run.
        view: The state.
        alerts: How often the user was alerted.
    """
    state = view.state
    return GuidedState(
        run=run,
        phase=state.phase,
        step=state.step,
        done=sorted(state.done),
        title=view.title,
        instruction=view.instruction,
        status=list(view.status),
        progress=view.progress,
        keys=[
            GuidedKey(name=key.name, label=key.label, action=key.action, hint=key.hint)
            for key in state.keys
        ],
        parts=[_part(part) for part in view.parts],
        notes=[str(note) for note in view.notes],
        alerts=alerts,
    )


def picture_jpeg(part: Picture) -> NDArray[np.uint8]:
    """Return a camera's picture with its outlines as JPEG (n,), at most PICTURE_WIDTH wide."""
    import cv2

    assert part.image is not None
    h, w = part.image.shape[:2]
    width = min(w, PICTURE_WIDTH)
    size = width, max(2, round(width * h / w))
    rgb = draw_picture(part, size, HIGHLIGHT_RGB, MARK_RGB, line_width=2)
    _, content = cv2.imencode(
        ".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    )
    return np.asarray(content, np.uint8).ravel()


def _part(part: Part) -> GuidedBars | GuidedPlot | GuidedPicture:
    if isinstance(part, Picture):
        return GuidedPicture(
            name=part.name,
            caption=part.caption,
            array=_array_name(part),
            has_image=part.image is not None,
        )
    if isinstance(part, Plot):
        return GuidedPlot(
            title=part.title,
            curves=[_curve(curve) for curve in part.curves],
            x=list(part.x),
            y=list(part.y),
            aspect=part.aspect,
            has_axes=part.has_axes,
        )
    return _bars(part)


def _bars(bars: Bars) -> GuidedBars:
    return GuidedBars(
        title=bars.title,
        names=list(bars.names),
        texts=list(bars.texts),
        values=_rounded(np.clip(np.nan_to_num(bars.values), 0, 1)),
        bands=[] if bars.bands is None else _rounded(np.clip(bars.bands, 0, 1)),
        states=list(bars.states),
        colors=list(range(len(bars.values))) if bars.has_colors else [],
    )


def _curve(curve: Curve) -> GuidedCurve:
    is_valid = np.isfinite(curve.x) & np.isfinite(curve.y)
    return GuidedCurve(
        name=curve.name,
        x=_rounded(curve.x[is_valid]),
        y=_rounded(curve.y[is_valid]),
        color=curve.color,
        is_line=curve.is_line,
    )


def _picture_arrays(part: Picture) -> Arrays:
    return Arrays(name=_array_name(part), arrays={"jpeg": picture_jpeg(part)})


def _array_name(part: Picture) -> str:
    return f"guided-picture-{part.name}"


def _rounded(values: Float) -> list[Any]:
    rounded: list[Any] = np.round(np.asarray(values, float), _DIGITS).tolist()
    return rounded
