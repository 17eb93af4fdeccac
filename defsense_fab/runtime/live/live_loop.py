"""The live loop: samples in, frames out.

The source's thread puts samples down; one thread decodes all of them, since decoders know the past,
and gives the newest frame to the outputs; a second one solves the surface of the newest frame that
there is. Outputs and views have threads of their own. Nothing waits for what comes after it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...capture.readout.source import Event, Source, StampedSample
from ...core.arrays import Float
from ...core.errors import DefsenseError, LiveError
from ...core.machine.processes import one_blas_thread
from ...sensing.serial_frames import Info
from ...sensing.voltage_divider import Dividers
from ..controls.control_bank import ControlBank
from ..controls.pose_amplitudes import RADIUS_90
from ..frames.live_decoder import LiveDecoder, Reading
from ..frames.live_frame import LiveFrame, Quality

_WAIT = 0.005  # s between looks at a source that has no thread of its own
_WAITING = 50  # samples that may wait: a machine that is too slow leaves out, and stays in time
_UNKNOWN = 1.0  # mm, of a marker whose interval is not known
_KEPT = 6000  # latencies: a minute at 100 Hz
#: s that a surface may take: it bounds the rounds of its solver.
BUDGET = 0.008
_SILENT = 1.0  # s without a sample, after which that is said
_TOLD = 5.0  # s, for which it is told what happened


class Sending(Protocol):
    """What frames are given to; it returns at once."""

    @property
    def name(self) -> str: ...

    @property
    def trouble(self) -> str | None: ...

    @property
    def news(self) -> str | None: ...

    def send(self, frame: LiveFrame) -> None: ...

    def close(self) -> None: ...


class Surfaces(Protocol):
    """Vertices (v, 3) mm of markers (m, 3) mm with standard deviations (m,) mm, in about `budget`
    s."""

    def __call__(
        self, markers: Float, sd: Float | None = None, budget: float | None = None
    ) -> Float: ...


class Keeping(Protocol):
    """Takes the raw readings as they come."""

    @property
    def trouble(self) -> str | None: ...

    def add(self, item: StampedSample | Event) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class LiveStatus:
    """The newest frame; samples per second, and of surfaces; s from a sample's arrival until its
    frame was given to outputs, and with its surface to views: median and 99th percentile (NaN:
    none yet); samples that arrived and that were not decoded; notes on all of it."""

    frame: LiveFrame | None
    rate: float
    surfaces: float
    decoded: tuple[float, float]
    shown: tuple[float, float]
    samples: int
    skipped: int
    notes: tuple[str, ...]


class LiveLoop:
    """Of a `source` whose channels come in the order `wired`; `start` it, and `close` it after use.

    `reference` (c,) ohm are the dividers' resistors in the model's order of channels; `tracks` tell
    where cameras saw the markers (m, 3) mm at a sample's time, s."""

    def __init__(
        self, source: Source, decoder: LiveDecoder, wired: Sequence[str], reference: Float, *,
        controls: ControlBank | None = None, surface: Surfaces | None = None,
        outputs: Sequence[Sending] = (), views: Sequence[Sending] = (),
        recorder: Keeping | None = None, tracks: Callable[[float], Float] | None = None,
    ) -> None:  # fmt: skip
        self._source, self._decoder = source, decoder
        self._order = [list(wired).index(name) for name in decoder.model.channels]
        self._reference, self._controls, self._surface = reference, controls, surface
        self._outputs, self._views, self._recorder = tuple(outputs), tuple(views), recorder
        self._tracks = tracks
        self._items: deque[StampedSample] = deque(maxlen=_WAITING)
        self._came, self._stop = threading.Event(), threading.Event()
        self._shape, self._solve = _Slot(), threading.Thread(target=self._solving, daemon=True)
        self._thread = threading.Thread(target=self._decoding, daemon=True)
        self._dividers: Dividers | None = None
        self._decoded, self._shown = _Latency(), _Latency()
        self._frame: LiveFrame | None = None
        self._failure: Exception | None = None
        self._samples = self._skipped = 0
        self._event, self._event_at = "", -np.inf
        self._event_lasts = False
        self._heard = time.monotonic()
        self._told_silent = False
        self._while_live = ExitStack()
        self._number = 0  # of frames: those of silence count, too

    def start(self) -> Info:
        """Open the source. Raises CaptureError where it cannot be read, LiveError where it has
        other channels than the device."""
        self._source.sink = self._take
        info = self._source.start()
        try:
            if info.channels != len(self._order):
                names = ", ".join(self._decoder.model.channels)
                raise LiveError(
                    f"{self._source.name}: the read-out board has {info.channels} channels, and"
                    f" {self._decoder.model.device} {len(self._order)} ({names}); connect the"
                    " device that the model was trained on"
                )
            self._dividers = Dividers(self._reference, info.full_scale)
            self._heard = time.monotonic()
        except DefsenseError:
            self._source.close()
            raise
        # More threads of linear algebra spin between samples, for three times the processor.
        self._while_live.enter_context(one_blas_thread())
        self._thread.start()
        self._solve.start()
        return info

    def close(self) -> None:
        """End all threads, and close source, outputs, views and recorder."""
        self._stop.set()
        self._came.set()
        self._shape.end()
        for thread in (self._thread, self._solve):
            if thread.is_alive():
                thread.join(3.0)
        self._while_live.close()
        self._source.close()
        for each in (*self._outputs, *self._views):
            each.close()
        if self._recorder is not None:
            self._recorder.close()

    def wait(self, seconds: float) -> bool:
        """Whether the loop still runs, after so many s or as soon as it ends. Raises what ended
        it."""
        if self._thread.is_alive():
            self._thread.join(seconds)
        if self._failure is not None:
            raise self._failure
        return self._thread.is_alive()

    @property
    def status(self) -> LiveStatus:
        now = time.monotonic()
        notes = [self._event] if self._event_lasts or now - self._event_at < _TOLD else []
        if time.monotonic() - self._heard > _SILENT:
            notes.append(f"{self._source.name}: no sample for {self.silence:.0f} s")
        for each in (*self._outputs, *self._views):
            notes += [told for told in (each.trouble, each.news) if told]
        if self._recorder is not None and self._recorder.trouble:
            notes.append(self._recorder.trouble)
        frame = self._frame
        return LiveStatus(
            frame, self._decoded.rate, self._shown.rate, self._decoded.quantiles,
            self._shown.quantiles, self._samples, self._skipped,
            (*(frame.notes if frame else ()), *notes),
        )  # fmt: skip

    @property
    def silence(self) -> float:
        """s since the last sample arrived."""
        return time.monotonic() - self._heard

    def latencies(self) -> tuple[Float, Float]:
        """s (n,) of the last minute, to outputs and to views."""
        return self._decoded.values, self._shown.values

    def _take(self, item: StampedSample | Event) -> None:
        if self._recorder is not None:
            self._recorder.add(item)
        if isinstance(item, Event):
            self._tell(_told(self._source.name, item), lasts=item.kind == "gap")
            if item.data.get("full_scale", 0) > 0:  # another board, or another range of it
                self._dividers = Dividers(self._reference, item.data["full_scale"])
            return
        self._samples += 1
        self._skipped += len(self._items) == _WAITING
        self._items.append(item)
        self._heard = time.monotonic()
        self._event_lasts = False
        self._came.set()

    def _tell(self, told: str | None, *, lasts: bool = False) -> None:
        """A note for some seconds, or until samples come again."""
        if told is not None:
            self._event, self._event_at, self._event_lasts = told, time.monotonic(), lasts

    def _decoding(self) -> None:
        try:
            while not self._stop.is_set():
                self._came.wait(_WAIT)
                self._came.clear()
                self._source.drain()
                frame = None
                # Those that wait now: where more come than can be decoded, frames are given still.
                for _ in range(len(self._items)):
                    frame = self._decode(self._items.popleft()) or frame
                if frame is not None:
                    self._give(frame)
                    self._told_silent = False
                elif self.silence > _SILENT and not self._told_silent:
                    self._told_silent = True
                    self._give_lost()
        except Exception as error:  # told by `wait`
            self._failure = error
        finally:
            self._shape.end()

    def _decode(self, item: StampedSample) -> LiveFrame | None:
        assert self._dividers is not None
        counts = np.array(item.sample.counts)
        if len(counts) != len(self._order):
            self._tell(
                f"{self._source.name}: samples of {len(counts)} channels come, where"
                f" {len(self._order)} are connected; another program changed the board's settings"
            )
            return None
        ohms = self._dividers.resistance(counts[self._order])
        return self._decoder(Reading(item.device_us / 1e6, ohms, item.host_ns / 1e9))

    def _give(self, frame: LiveFrame) -> None:
        if self._controls is not None and self._decoder.has_rest:
            found = self._controls.update(frame.markers, deviation(frame.radius), frame.time)
            lost = frame.quality is Quality.LOST
            confidence = dict.fromkeys(found.confidence, 0.0) if lost else found.confidence
            frame = replace(frame, controls=found.values, confidence=confidence)
        self._number += 1
        tracks = None if self._tracks is None else self._tracks(frame.time)
        self._frame = frame = replace(frame, number=self._number, tracks=tracks)
        for each in self._outputs:
            each.send(frame)
        self._decoded.add(time.monotonic() - frame.arrived)
        if self._views:
            self._shape.put(frame)

    def _give_lost(self) -> None:
        """The last frame once more, which is not to be believed: nothing comes from the device."""
        if self._frame is None or self._frame.quality is Quality.LOST:
            return
        note = f"{self._source.name}: nothing comes from the read-out board"
        self._number += 1
        self._frame = frame = replace(
            self._frame, number=self._number, arrived=time.monotonic(),
            quality=Quality.LOST, confidence=dict.fromkeys(self._frame.confidence, 0.0),
            notes=(note,),
        )  # fmt: skip
        for each in self._outputs:
            each.send(frame)
        if self._views:
            self._shape.put(frame)

    def _solving(self) -> None:
        while not self._stop.is_set():
            frame = self._shape.take()
            if frame is None:
                return
            if self._surface is not None:
                try:
                    vertices = self._surface(frame.markers, deviation(frame.radius), BUDGET)
                except Exception as error:
                    self._failure = error
                    return
                frame = replace(frame, vertices=vertices)
            for each in self._views:
                each.send(frame)
            self._shown.add(time.monotonic() - frame.arrived)


def deviation(radius: Float) -> Float:
    """Standard deviation (m,) mm along each axis of markers with the radius (m,) mm of their 90 %
    intervals."""
    return np.asarray(np.where(np.isfinite(radius), np.maximum(radius / RADIUS_90, 1e-3), _UNKNOWN))


def _told(name: str, event: Event) -> str | None:
    if event.kind == "gap":
        return f"{name}: the read-out board is gone ({event.data.get('why', 'no answer')}); waiting"
    if event.kind == "resumed":
        return f"{name}: the read-out board is back"
    if event.kind == "restart":
        return f"{name}: the read-out board started anew"
    return None


class _Slot:
    """Room for one frame, of which a newer one takes the place."""

    def __init__(self) -> None:
        self._changed, self._over = threading.Condition(), False
        self._frame: LiveFrame | None = None

    def put(self, frame: LiveFrame) -> None:
        with self._changed:
            self._frame = frame
            self._changed.notify()

    def take(self) -> LiveFrame | None:
        """The newest, when there is one; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._over or self._frame is not None)
            frame, self._frame = self._frame, None
            return None if self._over else frame

    def end(self) -> None:
        with self._changed:
            self._over = True
            self._changed.notify()


class _Latency:
    """Of the last minute."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    def add(self, seconds: float) -> None:
        self._rows.append((time.monotonic(), seconds))

    @property
    def values(self) -> Float:
        return np.array([s for _, s in tuple(self._rows)])

    @property
    def quantiles(self) -> tuple[float, float]:
        values = self.values
        if not len(values):
            return float("nan"), float("nan")
        return float(np.median(values)), float(np.quantile(values, 0.99))

    @property
    def rate(self) -> float:
        """Per second, over the last three."""
        now = time.monotonic()
        recent = [t for t, _ in tuple(self._rows) if t > now - 3.0]
        return len(recent) / 3.0
