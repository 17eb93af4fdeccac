"""Frames of any rate to pictures of a fixed one."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ...core.arrays import Float

_GAP = 1.0  # s without a frame, after which the surface stood still and then jumped
_SAME = 1e-6  # of a picture's time: a frame this near to it is at the same time


class FrameResampler:
    """Interpolates linearly between frames at the pictures' times, `fps` of them a second from the
    first frame on. Over a gap of more than a second the last shape is held until the picture
    before the next frame. A clock that goes back, as of a board that was restarted, is taken to go
    on from the last frame."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._start = self._time = 0.0
        self._last: Float | None = None
        self._next = 0

    def add(self, time: float, vertices: Float) -> Iterator[tuple[int, Float]]:
        """The pictures up to a frame at a `time` (s): their numbers, which rise, and vertices
        (v, 3) mm. Of a gap there are the first and the last alone."""
        if self._last is None:
            self._start, self._time, self._last = time, time, vertices
        elif time < self._time:
            self._start -= self._time - time
            self._time = time
        last, before = self._last, self._time - self._start
        now = time - self._start
        self._last, self._time = vertices, time
        if now - before > _GAP:
            until = math.ceil(now * self._fps - _SAME) - 1
            yield from ((k, last) for k in sorted({self._next, until}))
            self._next, last, before = until + 1, vertices, now
        while self._next <= now * self._fps + _SAME:
            share = (self._next / self._fps - before) / (now - before) if now > before else 1.0
            yield self._next, last + min(max(share, 0.0), 1.0) * (vertices - last)
            self._next += 1
