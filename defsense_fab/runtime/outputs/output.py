"""An output on a thread of its own, which gets the newest frame and never holds the loop up."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Protocol

from ...core.errors import DefsenseError
from ..frames.live_frame import LiveFrame, Quality

# The interface of all outputs.


class Output(Protocol):
    """Sends frames somewhere. `send` raises where it cannot, and may be called again; `trouble` is
    a sentence of what is wrong while the output goes on by itself, None while all is well; `about`
    says in a sentence what it sends where."""

    @property
    def name(self) -> str: ...

    @property
    def about(self) -> str: ...

    @property
    def trouble(self) -> str | None: ...

    def send(self, frame: LiveFrame) -> None: ...

    def close(self) -> None: ...


def signals_of(frame: LiveFrame) -> dict[str, float]:
    """What mappings can name: the controls, and "quality", 1 the best to 0 the worst, unless a
    control has that name."""
    best = max(q.level for q in Quality)
    return {"quality": frame.quality.level / best} | {
        name: finite(value) for name, value in frame.controls.items()
    }


def controls_known(frame: LiveFrame) -> bool:
    """Whether the frame's controls are all that the device has, even if these are none. Until the
    resistances at rest are known there are none yet, and frames are lost."""
    return bool(frame.controls) or frame.quality is not Quality.LOST


def unknown_controls(kind: str, asked: Iterable[str], frame: LiveFrame) -> str | None:
    """A sentence of controls that a mapping names and that are not there, None where all are."""
    there = signals_of(frame)
    missing = sorted({name for name in asked if name not in there})
    if not missing:
        return None
    words = ", ".join(map(repr, missing))
    return f"{kind}: there is no control {words}; mappings can name: {', '.join(there)}"


def finite(value: float) -> float:
    """0 for what is no number: devices and other programs' inputs have no word for that."""
    return float(value) if math.isfinite(value) else 0.0


_SOON, _LATER = 0.1, 5.0  # s before the first new attempt, and at most
_NEWS = 10.0  # s, for which it is told that an output does something else
_HELD_UP = 2.0  # s that sending one frame may take
_HANGS = 3.0  # s after which a thread that does not come back is left to itself
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class OutputStatistics:
    """Frames `given` by the loop, `sent`, and `dropped` because a newer one came or the output was
    in trouble; `failures` to open or to send."""

    given: int
    sent: int
    dropped: int
    failures: int


class NewestWins:
    """Opens an output on a thread, and gives it frames there.

    There is room for one frame: a newer one takes its place. An output that cannot be opened, or
    that raises, is told as `trouble` and tried again, after 0.1 s and then ever later up to 5 s.
    `rate` (Hz) limits how often frames are sent; 0 is no limit.
    """

    def __init__(self, name: str, opener: Callable[[], Output], rate: float = 0.0) -> None:
        self.name = name
        self._opener, self._pause = opener, 1 / rate if rate > 0 else 0.0
        self._output: Output | None = None
        # No lock is shared with the loop, which would wait while a thread that holds it does not
        # run: the newest frame, and a sign that there is one.
        self._slot, self._sign = deque[LiveFrame](maxlen=1), SimpleQueue[None]()
        self._signed = self._sending = False
        self._given = self._sent = self._failures = 0
        self._failure: str | None = None
        self._known_as, self._changed = "", -_NEWS
        self._begun = 0.0  # with the frame that is being sent
        self._stop, self._tried = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"output {name}", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str | None:
        if self._failure is not None:
            return self._failure
        held = time.monotonic() - self._begun
        if self._sending and held > _HELD_UP:
            return f"{self.name}: one frame has taken {held:.0f} s so far; newer ones are dropped"
        return self._output.trouble if self._output is not None else None

    @property
    def about(self) -> str:
        output = self._output
        return output.about if output is not None else f"{self.name}: is not open"

    @property
    def news(self) -> str | None:
        """What it does now, for some seconds after that has become something else than it was."""
        if self._output is None:
            return None
        about, now = self.about, time.monotonic()
        if about != self._known_as:
            self._known_as, self._changed = about, now
        return about if now - self._changed < _NEWS else None

    @property
    def statistics(self) -> OutputStatistics:
        given, sent, under_way = self._given, self._sent, len(self._slot) + self._sending
        return OutputStatistics(given, sent, max(0, given - sent - under_way), self._failures)

    def send(self, frame: LiveFrame) -> None:
        self._slot.append(frame)
        self._given += 1
        if not self._signed:
            self._signed = True
            self._sign.put(None)

    def wait_until_tried(self, seconds: float) -> bool:
        """Whether the output was opened, or could not be, within so many seconds: `about` and
        `trouble` are known from then on."""
        return self._tried.wait(seconds)

    def close(self) -> None:
        """End the thread and close the output. One that hangs in a driver is left to itself."""
        self._stop.set()
        self._sign.put(None)
        self._thread.join(_HANGS)

    def _run(self) -> None:
        wait = _SOON
        while not self._stop.is_set():
            try:
                if self._output is None:
                    opened = self._opener()
                    self._known_as, self._output = opened.about, opened
                    self._failure = None
                    self._tried.set()
                frame = self._next()
                if frame is None:
                    continue
                self._output.send(frame)
            except Exception as error:  # an output's own, of whatever kind: the loop goes on
                self._fail(error)
                self._stop.wait(wait)
                wait = min(2 * wait, _LATER)
                continue
            self._sent, self._sending = self._sent + 1, False
            self._failure, wait = None, _SOON
            pause = self._pause - (time.monotonic() - self._begun)
            if pause > 0:
                self._stop.wait(pause)
        self._shut()

    def _next(self) -> LiveFrame | None:
        """The newest frame, once there is one; None where it was taken already, or at the end."""
        self._sign.get()
        # In this order: a frame that comes meanwhile is taken now, or signed anew.
        self._signed = False
        if self._stop.is_set() or not self._slot:
            return None
        self._begun, self._sending = time.monotonic(), True
        return self._slot.popleft()

    def _fail(self, error: Exception) -> None:
        told = str(error) if isinstance(error, DefsenseError) else f"{self.name}: {_words(error)}"
        if told != self._failure:
            _log.warning("%s", told, exc_info=not isinstance(error, DefsenseError | OSError))
        self._failures, self._sending = self._failures + 1, False
        self._failure = told
        self._tried.set()

    def _shut(self) -> None:
        if self._output is None:
            return
        try:
            self._output.close()
        except Exception as error:  # what is closed need not work any more
            _log.warning("%s: could not be closed: %s", self.name, _words(error))


def _words(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return " ".join(text.split())
