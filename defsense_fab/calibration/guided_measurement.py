"""The guided measurement: which jig next, whether the reading has settled, what came out so far.

It knows nothing of terminals: a screen shows its views and hands it keys.
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
from .protocol import JigStep, Settled, settled
from .session import CHANNELS, CalibrationSession, holds

#: Lays the specimen on a jig: a twin's hands.
Hands = Callable[[float | None, str], None]
Phase = Literal["place", "settling", "unplugged", "done"]

_PATIENCE = 60.0  # s that an unattended session waits for a read-out board that is gone
_LOOK = 0.1  # s between looks at keys and samples
#: A neutral cord that changes by more than this part of the largest change of the others is told
#: of.
_MOVES = 0.05
_TICK = 25  # frames between two tests for settling


@dataclass(frozen=True)
class MeasuredPoint:
    """A finished reading: strain, (R - R0)/R0, and the cord's place."""

    strain: float
    change: float
    place: str


@dataclass(frozen=True)
class MeasurementView:
    """What there is to show: the `step` (None at the end), its `number` of `total`, how many are
    done, the `phase`, s since the specimen was laid down, how far it has `settled`, the last
    resistances `ohm` (c,), finished `points`, and what to look after."""

    phase: Phase
    step: JigStep | None
    number: int
    total: int
    done: int
    elapsed: float
    settled: Settled | None
    ohm: Float
    points: tuple[MeasuredPoint, ...]
    notes: tuple[str, ...]
    frames: int


class MeasurementScreen(Protocol):
    """Shows views, and hands over keys: enter, b(ack), s(kip), t(ake now), r(epeat), q(uit)."""

    def show(self, view: MeasurementView) -> None: ...

    def key(self, timeout: float) -> str | None: ...


@dataclass
class _Live:
    """Frames of the hold that is going on."""

    time: list[float] = field(default_factory=list)
    ohm: list[Float] = field(default_factory=list)
    tested: int = 0
    at: Settled | None = None

    def clear(self) -> None:
        self.time.clear()
        self.ohm.clear()
        self.tested, self.at = 0, None


class GuidedMeasurement:
    """One run of the protocol; what was finished in earlier runs is not asked for again."""

    def __init__(
        self,
        session: CalibrationSession,
        source: Source,
        screen: MeasurementScreen,
        hands: Hands | None = None,
        *,
        auto: bool = False,
    ) -> None:
        """`auto` needs no keys: it takes each step as soon as the last has settled."""
        self._session, self._source, self._screen = session, source, screen
        self._hands, self._auto = hands, auto
        self._live, self._holding = _Live(), False
        self._plugged, self._frames, self._late = True, 0, False
        self._last = np.full(len(CHANNELS), np.nan)
        self._points: dict[int, Float] = {}  # settled resistances by step
        self._done: set[int] = set()
        self._skipped: set[int] = set()
        self._gone: float | None = None  # since when the read-out board is
        self._interrupted = False
        if session.frames.exists():
            before = read_recording(session.frames)
            for n, hold in holds(session, before).items():
                self._done.add(n)
                at = settled(hold.time, hold.ohm, session.criterion)
                if at is not None:
                    self._points[n] = at.ohm

    def run(self) -> bool:
        """Whether all steps are done (otherwise it was stopped, or steps were skipped). Raises
        CaptureError where the source cannot be read, StorageError where frames cannot be
        written."""
        with Recorder(self._session.frames, len(CHANNELS)) as self._recorder:
            self._source.sink = self._recorder.add
            info = self._source.start()
            try:
                self._dividers = Dividers(np.array(self._session.reference), info.full_scale)
                return self._steps()
            finally:
                self._source.close()

    def _steps(self) -> bool:
        steps = self._session.steps
        n = self._next(0)
        while n is not None:
            key = self._place(n)
            if key == "q":
                return False
            if key == "s":
                self._skip(n)
            elif key == "b":
                n = self._back(n)
                continue
            else:
                key = self._hold(n)
                if key == "q":
                    return False
                if key == "s":
                    self._skip(n)
            n = self._next(0 if n + 1 >= len(steps) else n)
        self._show("done", None)
        return not self._skipped

    def _skip(self, n: int) -> None:
        """Not in this run: the next one asks for it again."""
        self._note("skip", n)
        self._skipped.add(n)

    def _next(self, start: int) -> int | None:
        """The first step that is not done, from `start` on and then from the beginning."""
        order = [*range(start, len(self._session.steps)), *range(start)]
        return next((n for n in order if n not in self._done | self._skipped), None)

    def _back(self, n: int) -> int:
        """The step that was done last, to be done again."""
        before = [k for k in range(n) if k in self._done]
        if not before:
            return n
        self._note("redo", before[-1])
        self._done.discard(before[-1])
        self._points.pop(before[-1], None)
        return before[-1]

    def _place(self, n: int) -> str:
        """Wait until the specimen lies on the step's jig."""
        while True:
            self._pump()
            self._show("place" if self._plugged else "unplugged", n)
            key = self._screen.key(_LOOK)
            if self._plugged and (key == "enter" or (self._auto and key is None)):
                return "enter"
            if key in ("q", "s", "b"):
                return key

    def _hold(self, n: int) -> str:
        """Wait until the reading has settled, and take it."""
        self._begin(n)
        while True:
            self._pump()
            if not self._plugged:
                self._show("unplugged", n)
                if self._screen.key(_LOOK) == "q":
                    return "q"
                continue
            if self._interrupted:  # what came before the gap tells nothing of what comes now
                self._begin(n)
            at = self._test()
            self._show("settling", n)
            key = self._screen.key(_LOOK)
            whole = at is not None and bool(np.isfinite(at.ohm).all() and (at.ohm > 0).all())
            if at is not None and whole and (at.still or at.over or key == "t"):
                self._holding = False
                self._note("point", n, settled=at.still)
                self._points[n] = at.ohm
                self._done.add(n)
                return "enter"
            if self._auto and at is not None and at.over and not whole:
                step = self._session.steps[n]
                why = "; ".join(self._notes(())) or "a cord cannot be read"
                raise CaptureError(
                    f"{step.jig}, face {step.face}: {why}; the same command goes on from here"
                )
            if key == "r":
                self._begin(n)
            elif key in ("q", "b", "s"):
                self._holding = False
                return key

    def _begin(self, n: int) -> None:
        step = self._session.steps[n]
        if self._hands is not None:
            self._hands(step.radius, step.face)
        self._pump()  # what came before belongs to the last step
        self._live.clear()
        self._holding, self._interrupted = True, False
        self._note("hold", n)

    def _pump(self) -> None:
        """Look at what came; it is written down already."""
        items = self._source.drain()
        if self._auto and self._gone and time.monotonic() - self._gone > _PATIENCE:
            raise CaptureError(
                f"{self._source.name}: the read-out board has been gone for {_PATIENCE:g} s; the"
                " same command goes on from here when it is back"
            )
        for item in items:
            if isinstance(item, Event):
                if item.kind == "gap":
                    self._plugged, self._gone = False, time.monotonic()
                    self._interrupted = True
                elif item.kind in ("resumed", "start"):
                    self._plugged, self._gone = True, None
                elif item.kind == "dropped":
                    self._interrupted = True
                continue
            self._look(item)

    def _look(self, item: StampedSample) -> None:
        self._frames += 1
        self._late = item.sample.late
        self._last = self._dividers.resistance(item.sample.counts)
        if self._holding:
            self._live.time.append(item.device_us / 1e6)
            self._live.ohm.append(self._last)

    def _test(self) -> Settled | None:
        live = self._live
        if len(live.time) - live.tested >= min(_TICK, self._session.rate):
            live.tested = len(live.time)
            time = np.array(live.time)
            live.at = settled(time - time[0], np.array(live.ohm), self._session.criterion)
        return live.at

    def _note(self, kind: str, n: int, **data: object) -> None:
        data = {"step": n, "at": round(time.time(), 3), **data}
        self._recorder.add(Event(time.monotonic_ns(), kind, data))

    def _show(self, phase: Phase, n: int | None) -> None:
        steps, live = self._session.steps, self._live
        elapsed = live.time[-1] - live.time[0] if self._holding and live.time else 0.0
        points = self.points()
        self._screen.show(
            MeasurementView(
                phase, None if n is None else steps[n], len(steps) if n is None else n + 1,
                len(steps), len(self._done), elapsed, live.at if self._holding else None,
                self._last, points, tuple(self._notes(points)), self._frames,
            )
        )  # fmt: skip

    def points(self) -> tuple[MeasuredPoint, ...]:
        """The finished readings, once there is one on the flat jig."""
        steps, geometry = self._session.steps, self._session.geometry
        flat = [ohm for n, ohm in self._points.items() if steps[n].radius is None]
        if not flat:
            return ()
        rest = np.mean(flat, axis=0)
        out = []
        for n, ohm in self._points.items():
            radius = steps[n].radius
            turned = 1 if steps[n].face == "a" else -1
            for (place, side), r, r0 in zip(CHANNELS.items(), ohm, rest, strict=True):
                strain = 0.0 if radius is None else geometry.strain(radius, side * turned)
                out.append(MeasuredPoint(strain, float(relative_change(r, r0)), place))
        return tuple(out)

    def _notes(self, points: tuple[MeasuredPoint, ...]) -> list[str]:
        """What to look after: open or shorted cords, a neutral cord that moves, losses."""
        out = []
        for place, ohm in zip(CHANNELS, self._last, strict=True):
            if self._frames and not (np.isfinite(ohm) and ohm > 0):
                state = "shorted" if ohm == 0 else "open" if np.isinf(ohm) else "not read"
                out.append(f"the {place} cord is {state}: look at its joints and its resistor")
        neutral = [abs(p.change) for p in points if p.place == "neutral"]
        others = [abs(p.change) for p in points if p.place != "neutral"]
        if neutral and max(neutral) > _MOVES * max(others) and len(points) > 6:
            out.append(
                f"the neutral cord moves: by {max(neutral):.2%}, the others by up to"
                f" {max(others):.1%}; temperature, a loose joint, or a cord off its place"
            )
        if self._late:
            out.append("the read-out board cannot keep up: give a lower --rate or --average")
        s = self._source.statistics
        if s.lost + s.gaps:
            out.append(f"{s.lost} samples lost, {s.gaps} gaps: they are marked in the recording")
        return out


def run_guided_measurement(
    session: CalibrationSession,
    source: Source,
    screen: MeasurementScreen,
    hands: Hands | None = None,
    *,
    auto: bool = False,
) -> bool:
    """Whether the session is finished now; see `GuidedMeasurement`."""
    try:
        return GuidedMeasurement(session, source, screen, hands, auto=auto).run()
    except CaptureError:
        source.close()
        raise
