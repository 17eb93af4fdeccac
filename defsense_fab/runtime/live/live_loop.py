"""Run the live loop: samples in, frames out.

The source's thread hands samples over. One thread decodes all of them, because decoders have
memory, and gives the latest frame to the outputs. A second thread solves the surface of the latest
frame for the views. Outputs and views have threads of their own, so that no step waits for a later
one.
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
from ..frames.fixed_decoder import FixedDecoder
from ..frames.live_decoder import LiveDecoder, Reading
from ..frames.live_frame import LiveFrame, Note, Quality
from .frame_slot import FrameSlot
from .loop_status import Latency, LineLoss, LiveStatus, event_note

#: Time that a surface may take, s; it bounds the iterations of its solver.
SURFACE_BUDGET_S = 0.008

_POLL_INTERVAL_S = 0.005  # of sources without a thread of their own
_MAX_AGE_S = 0.5  # a machine that is too slow skips older samples, and stays in time
_MAX_WAITING_SAMPLES = 200  # of a source that waits until they are decoded
_UNKNOWN_MARKER_SD_MM = 1.0  # of markers whose interval is unknown
_MIN_MARKER_SD_MM = 1e-3
_MAX_SILENCE_S = 1.0  # without a sample, after which that is reported
_EVENT_NOTE_S = 5.0  # for which an event is reported
_JOIN_TIMEOUT_S = 3.0


class FrameSink(Protocol):
    """A receiver of frames whose `send` returns at once."""

    @property
    def name(self) -> str: ...

    @property
    def trouble(self) -> Note | None: ...

    @property
    def news(self) -> Note | None: ...

    def send(self, frame: LiveFrame) -> None: ...

    def close(self) -> None: ...


class SurfaceSolver(Protocol):
    """Solve the vertices (v, 3), mm, of markers (m, 3), mm, with standard deviations (m,), mm."""

    def __call__(
        self, markers: Float, sd: Float | None = None, budget: float | None = None
    ) -> Float: ...


class ReadingRecorder(Protocol):
    """A recorder of the raw readings as they arrive."""

    @property
    def trouble(self) -> Note | None: ...

    def add(self, item: StampedSample | Event) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Receivers:
    """Where a loop sends its frames and readings.

    Attributes:
        outputs: Receivers of frames without surfaces.
        views: Receivers of frames with surfaces.
        recorder: Recorder of the raw readings.
        every: Receivers of every decoded frame, also of those that outputs skip.
    """

    outputs: Sequence[FrameSink] = ()
    views: Sequence[FrameSink] = ()
    recorder: ReadingRecorder | None = None
    every: Sequence[FrameSink] = ()


_NO_RECEIVERS = Receivers()


class LiveLoop:
    """The loop of one device. `start` it, and `close` it after use.

    Args:
        source: Source of the samples.
        decoder: Decoder of the readings.
        board_channels: Names of the channels in the order of the read-out board.
        reference: Resistors (c,) of the dividers, ohm, in the model's order of channels; None if
            samples are readings that need no conversion.
        controls: The controls, if the device has any.
        surface: Solver of the surface for the views.
        receivers: Outputs, views and recorder.
        tracks: Returns where cameras see the markers (m, 3), mm, at the time of a sample, s.
        decodes_all: Whether the source, with a thread of its own, waits until samples are decoded.
            Otherwise old samples are skipped if the machine is too slow.
    """

    def __init__(
        self,
        source: Source,
        decoder: LiveDecoder | FixedDecoder,
        board_channels: Sequence[str],
        reference: Float | None,
        *,
        controls: ControlBank | None = None,
        surface: SurfaceSolver | None = None,
        receivers: Receivers = _NO_RECEIVERS,
        tracks: Callable[[float], Float] | None = None,
        decodes_all: bool = False,
    ) -> None:
        self._source, self.decoder = source, decoder
        self._order = [list(board_channels).index(name) for name in decoder.model.channels]
        self._reference, self._controls, self._surface = reference, controls, surface
        self._outputs, self._views = tuple(receivers.outputs), tuple(receivers.views)
        self._recorder, self._every = receivers.recorder, tuple(receivers.every)
        self._tracks, self._decodes_all = tracks, decodes_all
        self._samples_to_decode: deque[StampedSample] = deque()
        self._has_samples, self._stop = threading.Event(), threading.Event()
        self._surface_slot = FrameSlot()
        self._surface_thread = threading.Thread(target=self._solve_surfaces, daemon=True)
        self._thread = threading.Thread(target=self._decode_samples, daemon=True)
        self._dividers: Dividers | None = None
        self._output_latency, self._view_latency = Latency(), Latency()
        self._line_loss = LineLoss()
        self._frame: LiveFrame | None = None
        self._failure: Exception | None = None
        self._samples = self._skipped = 0
        self._event: Note | None = None
        self._event_at, self._is_event_lasting = -np.inf, False
        self._last_sample_at = time.monotonic()
        self._is_silence_reported = False
        self._resources = ExitStack()
        self._number = 0  # of frames, including those that report silence

    def start(self) -> Info:
        """Open the source and start the threads.

        Returns:
            The description that the read-out board gives of itself.

        Raises:
            CaptureError: The source cannot be read.
            LiveError: The board has another number of channels than the model.
        """
        self._source.sink = self._receive
        info = self._source.start()
        try:
            if info.channels != len(self._order):
                names = ", ".join(self.decoder.model.channels)
                raise LiveError(
                    f"the read-out board has {info.channels} channels and"
                    f" {self.decoder.model.device} {len(self._order)} ({names})",
                    code="channels-differ",
                    where=self._source.name,
                    action="Connect the device that the model was trained on",
                    count=info.channels,
                    expected=len(self._order),
                )
            if self._reference is not None:
                self._dividers = Dividers(self._reference, info.full_scale)
            self._last_sample_at = time.monotonic()
        except DefsenseError:
            self._source.close()
            raise
        # More threads of linear algebra would spin between samples, and use three times the CPU.
        self._resources.enter_context(one_blas_thread())
        self._thread.start()
        self._surface_thread.start()
        return info

    def close(self) -> None:
        """End all threads, and close source, outputs, views and recorder."""
        self._stop.set()
        self._has_samples.set()
        self._surface_slot.end()
        for thread in (self._thread, self._surface_thread):
            if thread.is_alive():
                thread.join(_JOIN_TIMEOUT_S)
        self._resources.close()
        self._source.close()
        for sink in (*self._outputs, *self._views, *self._every):
            sink.close()
        if self._recorder is not None:
            self._recorder.close()

    def wait(self, seconds: float) -> bool:
        """Wait until the loop ends, at most for some seconds.

        Returns:
            Whether the loop still runs.

        Raises:
            Exception: The error that ended the loop.
        """
        if self._thread.is_alive():
            self._thread.join(seconds)
        if self._failure is not None:
            raise self._failure
        return self._thread.is_alive()

    @property
    def status(self) -> LiveStatus:
        """The present state of the loop."""
        frame, statistics = self._frame, self._source.statistics
        return LiveStatus(
            frame=frame,
            rate=self._output_latency.rate,
            surface_rate=self._view_latency.rate,
            output_latency=self._output_latency.quantiles,
            view_latency=self._view_latency.quantiles,
            samples=self._samples,
            skipped=self._skipped,
            lost=statistics.lost,
            notes=(*(frame.notes if frame else ()), *self._loop_notes()),
            network=statistics.network,
        )

    @property
    def silence(self) -> float:
        """Time since the last sample arrived, s."""
        return time.monotonic() - self._last_sample_at

    def latencies(self) -> tuple[Float, Float]:
        """Return the latencies (n,) of the last minute, s, to outputs and to views."""
        return self._output_latency.values, self._view_latency.values

    def _loop_notes(self) -> list[Note]:
        notes = []
        is_recent = time.monotonic() - self._event_at < _EVENT_NOTE_S
        if self._event is not None and (self._is_event_lasting or is_recent):
            notes.append(self._event)
        if (silence := self.silence) > _MAX_SILENCE_S:
            text = f"{self._source.name}: no sample for {silence:.0f} s"
            notes.append(Note("no-sample", text, {"seconds": silence}))
        if note := self._line_loss.note(self._source.name):
            notes.append(note)
        for sink in (*self._outputs, *self._views, *self._every):
            notes += [note for note in (sink.trouble, sink.news) if note]
        if self._recorder is not None and self._recorder.trouble:
            notes.append(self._recorder.trouble)
        return notes

    def _receive(self, item: StampedSample | Event) -> None:
        if self._recorder is not None:
            self._recorder.add(item)
        if isinstance(item, Event):
            self._report(event_note(self._source.name, item), is_lasting=item.kind == "gap")
            if item.kind in ("gap", "resumed", "restart"):
                self._line_loss.restart()
            if (
                self._reference is not None and item.data.get("full_scale", 0) > 0
            ):  # another board, or another range of it
                self._dividers = Dividers(self._reference, item.data["full_scale"])
            return
        waiting = self._samples_to_decode
        while self._decodes_all and len(waiting) >= _MAX_WAITING_SAMPLES:
            if self._stop.wait(_POLL_INTERVAL_S):
                return
        self._samples += 1
        waiting.append(item)
        self._last_sample_at = time.monotonic()
        self._line_loss.add(self._last_sample_at, self._source.statistics)
        self._is_event_lasting = False
        self._has_samples.set()

    def _report(self, note: Note | None, *, is_lasting: bool = False) -> None:
        """Report an event for some seconds, or until the next sample."""
        if note is not None:
            self._event, self._event_at, self._is_event_lasting = note, time.monotonic(), is_lasting

    def _decode_samples(self) -> None:
        try:
            while not self._stop.is_set():
                self._has_samples.wait(_POLL_INTERVAL_S)
                self._has_samples.clear()
                frame = self._decode_waiting()
                if frame is not None:
                    self._give(frame)
                    self._is_silence_reported = False
                elif self.silence > _MAX_SILENCE_S and not self._is_silence_reported:
                    self._is_silence_reported = True
                    self._give_lost()
                self._source.drain()  # plays recordings, and raises the error that ended the source
        except Exception as error:  # raised again by `wait`
            self._failure = error
        finally:
            self._surface_slot.end()

    def _decode_waiting(self) -> LiveFrame | None:
        """Decode the samples that wait now, and return the last frame.

        If more arrive than can be decoded, old ones are skipped, and frames are given all the same.
        """
        latest, waiting = None, self._samples_to_decode
        for _ in range(len(waiting)):
            item = waiting.popleft()
            age = time.monotonic() - item.host_ns / 1e9
            if age > _MAX_AGE_S and waiting and not self._decodes_all:
                self._skipped += 1
                continue
            frame = self._decode(item)
            self._skipped += frame is None
            if frame is not None:
                for sink in self._every:
                    sink.send(frame)
            latest = frame or latest
        return latest

    def _decode(self, item: StampedSample) -> LiveFrame | None:
        counts = np.array(item.sample.counts, float)
        if len(counts) != len(self._order):
            text = (
                f"{self._source.name}: samples have {len(counts)} channels instead of"
                f" {len(self._order)}; another program changed the board's settings"
            )
            self._report(Note("channels-differ", text, {"count": len(counts)}))
            return None
        ohms = counts[self._order]
        if self._dividers is not None:
            ohms = self._dividers.resistance(ohms)
        return self.decoder(Reading(item.device_us / 1e6, ohms, item.host_ns / 1e9))

    def _give(self, frame: LiveFrame) -> None:
        """Add the controls to a decoded frame, and hand it to outputs and views."""
        values, confidence = frame.controls, frame.confidence
        if self._controls is not None and self.decoder.has_rest:
            controls = self._controls.update(frame.markers, marker_sd(frame.radius), frame.time)
            values, confidence = controls.values, controls.confidence
            if frame.quality is Quality.LOST:
                confidence = dict.fromkeys(confidence, 0.0)
        self._number += 1
        self._frame = frame = replace(
            frame,
            number=self._number,
            controls=values,
            confidence=confidence,
            tracks=None if self._tracks is None else self._tracks(frame.time),
        )
        for output in self._outputs:
            output.send(frame)
        self._output_latency.add(time.monotonic() - frame.arrived)
        if self._views:
            self._surface_slot.put(frame)

    def _give_lost(self) -> None:
        """Repeat the last frame as a lost one, because no samples arrive."""
        if self._frame is None or self._frame.quality is Quality.LOST:
            return
        text = f"{self._source.name}: no samples arrive"
        self._number += 1
        self._frame = frame = replace(
            self._frame,
            number=self._number,
            arrived=time.monotonic(),
            quality=Quality.LOST,
            confidence=dict.fromkeys(self._frame.confidence, 0.0),
            notes=(Note("board-silent", text),),
        )
        for output in self._outputs:
            output.send(frame)
        if self._views:
            self._surface_slot.put(frame)

    def _solve_surfaces(self) -> None:
        while not self._stop.is_set():
            frame = self._surface_slot.take()
            if frame is None:
                return
            if self._surface is not None:
                try:
                    sd = marker_sd(frame.radius)
                    vertices = self._surface(frame.markers, sd, SURFACE_BUDGET_S)
                except Exception as error:  # raised again by `wait`
                    self._failure = error
                    return
                frame = replace(frame, vertices=vertices)
            for view in self._views:
                view.send(frame)
            self._view_latency.add(time.monotonic() - frame.arrived)


def marker_sd(radius: Float) -> Float:
    """Return standard deviations (m,) along each axis, mm, by the radii of 90 % intervals (m,)."""
    sd = np.maximum(radius / RADIUS_90, _MIN_MARKER_SD_MM)
    return np.asarray(np.where(np.isfinite(radius), sd, _UNKNOWN_MARKER_SD_MM))
