"""Guided measurement: which jig is next, whether the reading has settled, and the results so far.

It is independent of the user interface: a screen shows its views and returns the keys pressed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from ..capture.readout.recording import Recorder, read_recording
from ..capture.readout.source import Event, Source, StampedSample
from ..core.arrays import Float
from ..core.errors import CaptureError
from ..sensing.response import relative_change
from ..sensing.voltage_divider import Dividers
from .protocol import JigStep, SettlingState, check_settling
from .readings import Notice
from .session import CHANNELS, CalibrationSession, find_holds

#: Places a simulated specimen on a jig: radius (mm, None for the flat jig) and face.
PlaceSpecimen = Callable[[float | None, str], None]
Phase = Literal["place", "settling", "unplugged", "done"]

_BOARD_TIMEOUT_S = 60.0  # that an unattended session waits for a disconnected read-out board
_POLL_INTERVAL_S = 0.1  # between polls of keys and samples
#: A neutral cord that changes by more than this share of the others' largest change is reported.
_NEUTRAL_CHANGE_SHARE = 0.05
_MIN_POINTS_FOR_NEUTRAL = 7
_FRAMES_PER_CHECK = 25  # between two checks whether the reading has settled


@dataclass(frozen=True)
class MeasuredPoint:
    """A finished reading of one cord.

    Attributes:
        strain: Strain.
        change: (R - R0)/R0.
        place: Position of the cord.
    """

    strain: float
    change: float
    place: str


@dataclass(frozen=True)
class MeasurementView:
    """State of the measurement to show.

    Attributes:
        phase: Phase of the step.
        step: The step; None at the end.
        number: Number of the step, from 1.
        total: Number of steps.
        done: Number of finished steps.
        elapsed: Time since the specimen was placed, s.
        settling: How far the reading has settled; None before it can be known.
        ohm: Last resistances (c,), ohm.
        points: Finished readings.
        notes: What the user should attend to.
        frames: Number of frames received.
    """

    phase: Phase
    step: JigStep | None
    number: int
    total: int
    done: int
    elapsed: float
    settling: SettlingState | None
    ohm: Float
    points: tuple[MeasuredPoint, ...]
    notes: tuple[Notice, ...]
    frames: int


class MeasurementScreen(Protocol):
    """User interface of a measurement."""

    def show(self, view: MeasurementView) -> None:
        """Show the state of the measurement."""

    def key(self, timeout: float) -> str | None:
        """Return the key that is pressed within a time in s, or None.

        Keys are enter, b(ack), s(kip), t(ake now), r(epeat) and q(uit).
        """


@dataclass
class _CurrentHold:
    """Frames of the current hold."""

    time: list[float] = field(default_factory=list)
    ohm: list[Float] = field(default_factory=list)
    checked: int = 0
    state: SettlingState | None = None

    def clear(self) -> None:
        self.time.clear()
        self.ohm.clear()
        self.checked, self.state = 0, None


class GuidedMeasurement:
    """One run of the protocol; steps that were finished in earlier runs are not repeated.

    Args:
        session: The session.
        source: Source of samples.
        screen: User interface.
        place_specimen: Places a simulated specimen.
        auto: Whether each step is taken as soon as it has settled, without keys.
    """

    def __init__(
        self,
        session: CalibrationSession,
        source: Source,
        screen: MeasurementScreen,
        place_specimen: PlaceSpecimen | None = None,
        *,
        auto: bool = False,
    ) -> None:
        self._session, self._source, self._screen = session, source, screen
        self._place_specimen, self._auto = place_specimen, auto
        self._hold, self._is_holding = _CurrentHold(), False
        self._is_plugged, self._frames, self._is_late = True, 0, False
        self._last_ohm = np.full(len(CHANNELS), np.nan)
        self._points: dict[int, Float] = {}  # settled resistances by step
        self._done: set[int] = set()
        self._skipped: set[int] = set()
        self._unplugged_at: float | None = None
        self._is_interrupted = False
        if session.frames.exists():
            before = read_recording(session.frames)
            for n, hold in find_holds(session, before).items():
                self._done.add(n)
                state = check_settling(hold.time, hold.ohm, session.criterion)
                if state is not None:
                    self._points[n] = state.ohm

    def run(self) -> bool:
        """Measure until all steps are done or the user quits.

        Returns:
            Whether all steps are done; False if it was stopped, or steps were skipped.

        Raises:
            CaptureError: The source cannot be read.
            StorageError: Frames cannot be written.
        """
        with Recorder(self._session.frames, len(CHANNELS)) as self._recorder:
            self._source.sink = self._recorder.add
            info = self._source.start()
            try:
                self._dividers = Dividers(np.array(self._session.reference), info.full_scale)
                return self._run_steps()
            finally:
                self._source.close()

    def _run_steps(self) -> bool:
        steps = self._session.steps
        n = self._next_step(0)
        while n is not None:
            key = self._wait_for_placement(n)
            if key == "q":
                return False
            if key == "s":
                self._skip(n)
            elif key == "b":
                n = self._reopen_last_step(n)
                continue
            else:
                key = self._measure_step(n)
                if key == "q":
                    return False
                if key == "s":
                    self._skip(n)
            n = self._next_step(0 if n + 1 >= len(steps) else n)
        self._show("done", None)
        return not self._skipped

    def _skip(self, n: int) -> None:
        """Skip a step in this run; the next run asks for it again."""
        self._record_event("skip", n)
        self._skipped.add(n)

    def _next_step(self, start: int) -> int | None:
        """Return the first open step, searching from `start` and then from the beginning."""
        order = [*range(start, len(self._session.steps)), *range(start)]
        return next((n for n in order if n not in self._done | self._skipped), None)

    def _reopen_last_step(self, n: int) -> int:
        """Return the step before `n` that was done last, to be measured again."""
        before = [k for k in range(n) if k in self._done]
        if not before:
            return n
        self._record_event("redo", before[-1])
        self._done.discard(before[-1])
        self._points.pop(before[-1], None)
        return before[-1]

    def _wait_for_placement(self, n: int) -> str:
        """Wait until the specimen is on the step's jig; return the key."""
        while True:
            self._receive()
            self._show("place" if self._is_plugged else "unplugged", n)
            key = self._screen.key(_POLL_INTERVAL_S)
            if self._is_plugged and (key == "enter" or (self._auto and key is None)):
                return "enter"
            if key in ("q", "s", "b"):
                return key

    def _measure_step(self, n: int) -> str:
        """Wait until the reading has settled, and take it; return the key that ended the step."""
        self._start_hold(n)
        while True:
            self._receive()
            if not self._is_plugged:
                self._show("unplugged", n)
                if self._screen.key(_POLL_INTERVAL_S) == "q":
                    return "q"
                continue
            if self._is_interrupted:  # frames before a gap say nothing about those after it
                self._start_hold(n)
            state = self._check_hold()
            self._show("settling", n)
            key = self._screen.key(_POLL_INTERVAL_S)
            is_complete = state is not None and _is_complete(state)
            if state is not None and is_complete and _can_take(state, key):
                self._is_holding = False
                self._record_event("point", n, settled=state.is_settled)
                self._points[n] = state.ohm
                self._done.add(n)
                return "enter"
            if self._auto and state is not None and state.is_timed_out and not is_complete:
                raise self._unreadable_cord(n)
            if key == "r":
                self._start_hold(n)
            elif key in ("q", "b", "s"):
                self._is_holding = False
                return key

    def _unreadable_cord(self, n: int) -> CaptureError:
        step = self._session.steps[n]
        reason = "; ".join(map(str, self._notes(()))) or "a cord cannot be read"
        return CaptureError(
            reason,
            code="cord-unreadable",
            where=f"{step.jig}, face {step.face}",
            action="Repair it, and run the same command to resume from here",
            step=n,
        )

    def _start_hold(self, n: int) -> None:
        step = self._session.steps[n]
        if self._place_specimen is not None:
            self._place_specimen(step.radius, step.face)
        self._receive()  # earlier samples belong to the last step
        self._hold.clear()
        self._is_holding, self._is_interrupted = True, False
        self._record_event("hold", n)

    def _receive(self) -> None:
        """Process the items that arrived; the recorder has already written them."""
        items = self._source.drain()
        unplugged_at = self._unplugged_at
        if self._auto and unplugged_at and time.monotonic() - unplugged_at > _BOARD_TIMEOUT_S:
            raise CaptureError(
                f"the read-out board has been disconnected for {_BOARD_TIMEOUT_S:g} s",
                code="board-gone",
                where=self._source.name,
                action="Connect it, and run the same command to resume from here",
            )
        for item in items:
            if isinstance(item, Event):
                self._process_event(item)
            else:
                self._process_sample(item)

    def _process_event(self, event: Event) -> None:
        if event.kind == "gap":
            self._is_plugged, self._unplugged_at = False, time.monotonic()
            self._is_interrupted = True
        elif event.kind in ("resumed", "start"):
            self._is_plugged, self._unplugged_at = True, None
        elif event.kind == "dropped":
            self._is_interrupted = True

    def _process_sample(self, item: StampedSample) -> None:
        self._frames += 1
        self._is_late = item.sample.late
        self._last_ohm = self._dividers.resistance(item.sample.counts)
        if self._is_holding:
            self._hold.time.append(item.device_us / 1e6)
            self._hold.ohm.append(self._last_ohm)

    def _check_hold(self) -> SettlingState | None:
        hold = self._hold
        if len(hold.time) - hold.checked >= min(_FRAMES_PER_CHECK, self._session.rate):
            hold.checked = len(hold.time)
            times = np.array(hold.time)
            hold.state = check_settling(
                times - times[0], np.array(hold.ohm), self._session.criterion
            )
        return hold.state

    def _record_event(self, kind: str, n: int, **data: object) -> None:
        data = {"step": n, "at": round(time.time(), 3), **data}
        self._recorder.add(Event(time.monotonic_ns(), kind, data))

    def _show(self, phase: Phase, n: int | None) -> None:
        steps, hold = self._session.steps, self._hold
        points = self.points()
        view = MeasurementView(
            phase=phase,
            step=None if n is None else steps[n],
            number=len(steps) if n is None else n + 1,
            total=len(steps),
            done=len(self._done),
            elapsed=hold.time[-1] - hold.time[0] if self._is_holding and hold.time else 0.0,
            settling=hold.state if self._is_holding else None,
            ohm=self._last_ohm,
            points=points,
            notes=tuple(self._notes(points)),
            frames=self._frames,
        )
        self._screen.show(view)

    def points(self) -> tuple[MeasuredPoint, ...]:
        """Return the finished readings, once there is one on the flat jig."""
        steps, geometry = self._session.steps, self._session.geometry
        flat = [ohm for n, ohm in self._points.items() if steps[n].radius is None]
        if not flat:
            return ()
        rest = np.mean(flat, axis=0)
        out = []
        for n, ohm in self._points.items():
            radius = steps[n].radius
            face_sign = 1 if steps[n].face == "a" else -1
            for (place, side), r, r0 in zip(CHANNELS.items(), ohm, rest, strict=True):
                strain = 0.0 if radius is None else geometry.strain(radius, side * face_sign)
                out.append(MeasuredPoint(strain, float(relative_change(r, r0)), place))
        return tuple(out)

    def _notes(self, points: tuple[MeasuredPoint, ...]) -> list[Notice]:
        """Return notes on open or shorted cords, a neutral cord that changes, and lost samples."""
        out = []
        for place, ohm in zip(CHANNELS, self._last_ohm, strict=True):
            if self._frames and not (np.isfinite(ohm) and ohm > 0):
                state = "shorted" if ohm == 0 else "open" if np.isinf(ohm) else "not read"
                text = f"the {place} cord is {state}: check its joints and its reference resistor"
                out.append(Notice(f"cord-{state.replace(' ', '-')}", text))
        neutral = [abs(p.change) for p in points if p.place == "neutral"]
        others = [abs(p.change) for p in points if p.place != "neutral"]
        if (
            neutral
            and max(neutral) > _NEUTRAL_CHANGE_SHARE * max(others)
            and len(points) >= _MIN_POINTS_FOR_NEUTRAL
        ):
            text = (
                f"the neutral cord changes by {max(neutral):.2%}, the others by up to"
                f" {max(others):.1%}: check the temperature, its joints and its position"
            )
            out.append(Notice("neutral-cord-changes", text))
        if self._is_late:
            text = "the read-out board is too slow: choose a lower rate or fewer averages"
            out.append(Notice("board-late", text))
        s = self._source.statistics
        if s.lost + s.gaps:
            text = f"{s.lost} samples lost, {s.gaps} gaps; both are marked in the recording"
            out.append(Notice("samples-lost", text))
        return out


def _is_complete(state: SettlingState) -> bool:
    """Return whether every cord has a valid resistance."""
    return bool(np.isfinite(state.ohm).all() and (state.ohm > 0).all())


def _can_take(state: SettlingState, key: str | None) -> bool:
    return state.is_settled or state.is_timed_out or key == "t"


def run_guided_measurement(
    session: CalibrationSession,
    source: Source,
    screen: MeasurementScreen,
    place_specimen: PlaceSpecimen | None = None,
    *,
    auto: bool = False,
) -> bool:
    """Run a `GuidedMeasurement`, and close the source after an error.

    Args:
        session: The session.
        source: Source of samples.
        screen: User interface.
        place_specimen: Places a simulated specimen.
        auto: Whether each step is taken as soon as it has settled, without keys.

    Returns:
        Whether the session is finished.

    Raises:
        CaptureError: The source cannot be read.
        StorageError: Frames cannot be written.
    """
    try:
        return GuidedMeasurement(session, source, screen, place_specimen, auto=auto).run()
    except CaptureError:
        source.close()
        raise
