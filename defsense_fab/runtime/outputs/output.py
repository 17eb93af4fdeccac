"""The interface of outputs, and the thread that sends the latest frame to one of them."""

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
from ..frames.live_frame import LiveFrame, Note, Quality

_FIRST_RETRY_S, _MAX_RETRY_S = 0.1, 5.0  # delays before an output is tried again
_NEWS_S = 10.0  # for which a change of what an output does is reported
_MAX_SEND_S = 2.0  # longer sends are reported
_CLOSE_TIMEOUT_S = 3.0  # after which a thread that hangs is abandoned
_log = logging.getLogger(__name__)


class Output(Protocol):
    """A receiver of frames.

    Attributes:
        name: Name of its kind.
        about: Description of what it sends where.
        trouble: What is wrong while the output continues to work, or None.
    """

    @property
    def name(self) -> str: ...

    @property
    def about(self) -> str: ...

    @property
    def trouble(self) -> Note | None: ...

    def send(self, frame: LiveFrame) -> None:
        """Send a frame; after an exception it may be called again."""

    def close(self) -> None: ...


def mappable_values(frame: LiveFrame) -> dict[str, float]:
    """Return the values that mappings can name.

    These are the controls, and "quality" from 1 (the best) to 0, unless a control has that name.
    """
    best = max(q.level for q in Quality)
    return {"quality": frame.quality.level / best} | {
        name: finite_or_zero(value) for name, value in frame.controls.items()
    }


def has_all_controls(frame: LiveFrame) -> bool:
    """Return whether the frame has all controls of the device, even if it has no controls.

    Until the resistances at rest are known, frames are lost and have no controls yet.
    """
    return bool(frame.controls) or frame.quality is not Quality.LOST


def unknown_controls_note(kind: str, names: Iterable[str], frame: LiveFrame) -> Note | None:
    """Return a note on mapped controls that the frame does not have, if any.

    Args:
        kind: Name of the output.
        names: Names of the controls that its mapping uses.
        frame: A frame with all controls.
    """
    known = mappable_values(frame)
    unknown = sorted({name for name in names if name not in known})
    if not unknown:
        return None
    text = f"{kind}: unknown control {', '.join(map(repr, unknown))}; known: {', '.join(known)}"
    return Note("unknown-control", text, {"controls": unknown, "known": list(known)})


def finite_or_zero(value: float) -> float:
    """Return a finite value, and 0 for others, which devices and programs cannot represent."""
    return float(value) if math.isfinite(value) else 0.0


@dataclass(frozen=True)
class OutputStatistics:
    """Counts of an output.

    Attributes:
        received: Frames that the loop has given to it.
        sent: Frames that were sent.
        dropped: Frames that were dropped, because a newer one came or the output failed.
        failures: Failures to open the output or to send.
    """

    received: int
    sent: int
    dropped: int
    failures: int


class LatestFrameSender:
    """Open an output on its own thread, and send it the latest frame there.

    There is room for one frame: a newer one replaces it, so that the loop never waits. An output
    that cannot be opened, or that raises, is reported as `trouble` and tried again after 0.1 s,
    then after growing delays of up to 5 s.

    Args:
        name: Name of the output.
        opener: Function that opens the output.
        rate: Largest number of frames per second, Hz; 0 for no limit.
    """

    def __init__(self, name: str, opener: Callable[[], Output], rate: float = 0.0) -> None:
        self.name = name
        self._opener, self._min_interval = opener, 1 / rate if rate > 0 else 0.0
        self._output: Output | None = None
        # The loop shares no lock with this thread, because it would wait whenever the thread that
        # holds the lock does not run. It shares the newest frame and a signal that there is one.
        self._slot, self._signal = deque[LiveFrame](maxlen=1), SimpleQueue[None]()
        self._is_signalled = self._is_sending = False
        self._received = self._sent = self._failures = 0
        self._failure: Note | None = None
        self._last_about, self._about_changed_at = "", -_NEWS_S
        self._send_started_at = 0.0
        self._stop, self._was_tried = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"output {name}", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> Note | None:
        """Why frames are not sent, or what the output reports; None if all is well."""
        if self._failure is not None:
            return self._failure
        duration = time.monotonic() - self._send_started_at
        if self._is_sending and duration > _MAX_SEND_S:
            text = f"{self.name}: sending one frame has taken {duration:.0f} s; others are dropped"
            return Note("send-slow", text, {"seconds": duration})
        return self._output.trouble if self._output is not None else None

    @property
    def about(self) -> str:
        """Description of what the output sends where."""
        output = self._output
        return output.about if output is not None else f"{self.name}: not open"

    @property
    def news(self) -> Note | None:
        """What the output does now, for some seconds after that has changed."""
        if self._output is None:
            return None
        about, now = self.about, time.monotonic()
        if about != self._last_about:
            self._last_about, self._about_changed_at = about, now
        return Note("output-changed", about) if now - self._about_changed_at < _NEWS_S else None

    @property
    def is_open(self) -> bool:
        """Whether the output has been opened."""
        return self._output is not None

    @property
    def statistics(self) -> OutputStatistics:
        """Counts so far."""
        received, sent = self._received, self._sent
        in_progress = len(self._slot) + self._is_sending
        dropped = max(0, received - sent - in_progress)
        return OutputStatistics(received, sent, dropped, self._failures)

    def send(self, frame: LiveFrame) -> None:
        """Send a frame soon, unless a newer one comes; returns at once."""
        self._slot.append(frame)
        self._received += 1
        if not self._is_signalled:
            self._is_signalled = True
            self._signal.put(None)

    def wait_until_tried(self, seconds: float) -> bool:
        """Wait until the output was opened or has failed to open.

        Returns:
            Whether that happened within `seconds`; then `about` and `trouble` are known.
        """
        return self._was_tried.wait(seconds)

    def close(self) -> None:
        """End the thread and close the output; a thread that hangs in a driver is abandoned."""
        self._stop.set()
        self._signal.put(None)
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _run(self) -> None:
        delay = _FIRST_RETRY_S
        while not self._stop.is_set():
            try:
                if self._output is None:
                    opened = self._opener()
                    self._last_about, self._output = opened.about, opened
                    self._failure = None
                    self._was_tried.set()
                frame = self._next()
                if frame is None:
                    continue
                self._output.send(frame)
            except Exception as error:  # of any library: the loop continues
                self._record_failure(error)
                self._stop.wait(delay)
                delay = min(2 * delay, _MAX_RETRY_S)
                continue
            self._sent, self._is_sending = self._sent + 1, False
            self._failure, delay = None, _FIRST_RETRY_S
            pause = self._min_interval - (time.monotonic() - self._send_started_at)
            if pause > 0:
                self._stop.wait(pause)
        self._close_output()

    def _next(self) -> LiveFrame | None:
        """Wait for the next frame; None if it was taken already, or at the end."""
        self._signal.get()
        # In this order: a frame that arrives now is either taken or signalled again.
        self._is_signalled = False
        if self._stop.is_set() or not self._slot:
            return None
        self._send_started_at, self._is_sending = time.monotonic(), True
        return self._slot.popleft()

    def _record_failure(self, error: Exception) -> None:
        if isinstance(error, DefsenseError):
            failure = Note.from_error(error)
        else:
            failure = Note("output-failed", f"{self.name}: {_one_line(error)}")
        if self._failure is None or failure.text != self._failure.text:
            is_expected = isinstance(error, DefsenseError | OSError)
            _log.warning("%s", failure, exc_info=not is_expected)
        self._failures, self._is_sending = self._failures + 1, False
        self._failure = failure
        self._was_tried.set()

    def _close_output(self) -> None:
        if self._output is None:
            return
        try:
            self._output.close()
        except Exception as error:  # the output may no longer work
            _log.warning("%s: could not be closed: %s", self.name, _one_line(error))


def _one_line(error: Exception) -> str:
    text = str(error) or type(error).__name__
    return " ".join(text.split())
