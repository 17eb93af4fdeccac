"""Guided measurement of a specimen: it is placed on one jig after the other until it has settled.

The recorder writes every frame as it arrives, with an event where a hold starts and where its
reading is taken.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from ..capture.readout.recording import Recorder, read_recording
from ..capture.readout.source import Event, Source, StampedSample
from ..core.arrays import Float
from ..core.errors import CaptureError
from ..core.guided_parts import Curve, Part, Plot, resistance_bars
from ..core.guided_run import (
    STOP,
    Action,
    Ending,
    GuidedRun,
    GuidedView,
    GuidedWork,
    Key,
    Phase,
    RunState,
    Screen,
)
from ..core.progress import Notice
from ..sensing.response import relative_change
from ..sensing.voltage_divider import Dividers
from .protocol import JigStep, SettlingState, check_settling
from .readings import Geometry
from .session import CHANNELS, CalibrationSession, Hold, find_holds

#: Places a simulated specimen on a jig: radius (mm, None for the flat jig) and face.
PlaceSpecimen = Callable[[float | None, str], None]

BOARD_TIMEOUT_S = 60.0  # that an unattended session waits for a disconnected read-out board
#: A neutral cord that changes by more than this share of the others' largest change is reported.
_NEUTRAL_CHANGE_SHARE = 0.05
_MIN_POINTS_FOR_NEUTRAL = 7
_FRAMES_PER_CHECK = 25  # between two checks whether the reading has settled
MEASUREMENT_KEYS: Mapping[Phase, tuple[Key, ...]] = {
    "ready": (
        Key("enter", "measure", "start"),
        Key("b", "back", "back", "repeat the last"),
        Key("s", "skip", "skip"),
        STOP,
    ),
    "active": (
        Key("r", "repeat", "repeat", "slipped"),
        Key("t", "take now", "complete"),
        Key("b", "place again", "back"),
        Key("s", "skip", "skip"),
        STOP,
    ),
    "waiting": (Key("b", "place again", "back"), Key("s", "skip", "skip"), STOP),
}
#: Which side of the specimen is on the jig, and which cord is then on top, by face.
_SIDES = {"a": ("bottom", "top"), "b": ("top", "bottom")}
_CORD_COLORS = {place: n for n, place in enumerate(CHANNELS)}
_CORD_DEPTH = 0.14  # of a cord in the drawing, relative to the thickness
_JIG_DEPTHS = (0.25, 0.5)  # of the jig's lines below its surface, relative to the thickness
_MIN_STRAIN_RANGE, _MIN_CHANGE_RANGE = 0.01, 0.005  # of the plot of the readings


def run_guided_measurement(
    session: CalibrationSession,
    source: Source,
    screen: Screen,
    place_specimen: PlaceSpecimen | None = None,
    *,
    auto: bool = False,
) -> bool:
    """Measure the steps of a session that are not finished yet.

    Args:
        session: The session.
        source: Source of samples, which is closed at the end.
        screen: User interface.
        place_specimen: Places a simulated specimen.
        auto: Whether each step is taken as soon as it has settled, without keys.

    Returns:
        Whether all steps are done; False if the user stopped or skipped steps.

    Raises:
        CaptureError: The source cannot be read.
        StorageError: Frames cannot be written.
    """
    holds: dict[int, Hold] = {}
    if session.frames.exists():
        holds = find_holds(session, read_recording(session.frames))
    with Recorder(session.frames, len(CHANNELS)) as recorder, closing(source):
        source.sink = recorder.add
        dividers = Dividers(np.array(session.reference), source.start().full_scale)
        work = MeasurementWork(session, source, recorder, dividers, place_specimen, auto=auto)
        for n, hold in holds.items():
            state = check_settling(hold.time, hold.ohm, session.criterion)
            if state is not None:
                work.settled_ohm[n] = state.ohm
        return GuidedRun(work, screen, holds, auto=auto).run()


@dataclass
class _CurrentHold:
    """Frames of the current hold; times in s, resistances (c,) in ohm."""

    time: list[float] = field(default_factory=list)
    ohm: list[Float] = field(default_factory=list)
    checked_count: int = 0
    state: SettlingState | None = None


class MeasurementWork(GuidedWork):
    """Work of one step: to wait until the reading has settled, and to take it.

    Args:
        session: The session.
        source: Source of samples, which is open.
        recorder: Receives the events of the steps.
        dividers: Dividers of the read-out board.
        place_specimen: Places a simulated specimen.
        auto: Whether nobody is there: errors that a user could repair end the run.

    Attributes:
        settled_ohm: Resistances (c,) by finished step, ohm.
    """

    def __init__(
        self,
        session: CalibrationSession,
        source: Source,
        recorder: Recorder,
        dividers: Dividers,
        place_specimen: PlaceSpecimen | None = None,
        *,
        auto: bool = False,
    ) -> None:
        self._session, self._source, self._recorder = session, source, recorder
        self._place_specimen, self._auto = place_specimen, auto
        self._dividers = dividers
        self.keys, self.step_count = MEASUREMENT_KEYS, len(session.steps)
        self._step: int | None = None  # of the current hold
        self._hold = _CurrentHold()
        self._has_gap = False  # in the frames of the hold
        self._unplugged_at = 0.0
        self._frames, self._is_late = 0, False
        self._last_ohm = np.full(len(CHANNELS), np.nan)
        self.settled_ohm: dict[int, Float] = {}

    def start(self, step: int) -> None:
        plan = self._session.steps[step]
        if self._place_specimen is not None:
            self._place_specimen(plan.radius, plan.face)
        self._read_source()  # earlier samples belong to the last step
        self._step, self._hold, self._has_gap = step, _CurrentHold(), False
        self._record_event("hold", step)

    def receive(self) -> None:
        self._read_source()
        if self._step is None or self.is_interrupted:
            return
        if self._has_gap:  # frames before a gap say nothing about those after it
            self.start(self._step)
        hold = self._hold
        if len(hold.time) - hold.checked_count >= min(_FRAMES_PER_CHECK, self._session.rate):
            hold.checked_count = len(hold.time)
            times = np.array(hold.time)
            hold.state = check_settling(
                times - times[0], np.array(hold.ohm), self._session.criterion
            )

    def check(self, *, is_requested: bool) -> Ending | None:
        state = self._hold.state
        if state is None or self._step is None:
            return None
        is_readable = bool(np.isfinite(state.ohm).all() and (state.ohm > 0).all())
        if is_readable and (state.is_settled or state.is_timed_out or is_requested):
            return "done"
        if self._auto and state.is_timed_out:
            plan = self._session.steps[self._step]
            reason = "; ".join(map(str, self._notes())) or "a cord cannot be read"
            raise CaptureError(
                reason,
                code="cord-unreadable",
                where=f"{plan.jig}, face {plan.face}",
                action="Repair it, and run the same command to resume from here",
                step=self._step,
            )
        return None

    def leave(self, step: int, ending: Ending | Action) -> None:
        state, self._step = self._hold.state, None
        if ending == "done" and state is not None:
            self._record_event("point", step, settled=state.is_settled)
            self.settled_ohm[step] = state.ohm

    def skip(self, step: int) -> None:
        self._record_event("skip", step)

    def reopen(self, step: int) -> None:
        self._record_event("redo", step)
        self.settled_ohm.pop(step, None)

    def view(self, state: RunState) -> GuidedView:
        session, total = self._session, self.step_count
        plan = session.steps[state.step]
        parts: list[Part] = []
        if state.phase != "done":
            parts.append(draw_specimen(plan, session.geometry, session.length))
        readings = self.readings_plot()
        parts.append(resistance_bars(dict(zip(CHANNELS, map(float, self._last_ohm), strict=True))))
        if readings is not None:
            parts.append(readings)
        return GuidedView(
            state,
            title=f"{len(state.done)} of {total} readings, round {plan.turn + 1}",
            instruction=_instruction(state.phase, plan),
            status=(self._describe_settling(state.phase), f"{self._frames} frames recorded"),
            progress=len(state.done) / total,
            parts=tuple(parts),
            notes=tuple(self._notes()),
        )

    def _describe_settling(self, phase: Phase) -> str:
        criterion, hold = self._session.criterion, self._hold
        if phase != "active":
            return str(criterion)
        elapsed = hold.time[-1] - hold.time[0] if hold.time else 0.0
        if hold.state is None:
            return f"Settling: {elapsed:.0f} s; waiting for the first {criterion.window:g} s"
        return (
            f"Settling: {elapsed:.0f} s; change {hold.state.change:.3%}, limit"
            f" {criterion.tolerance:.2%}"
        )

    def _read_source(self) -> None:
        """Process the items that arrived; the recorder has already written them."""
        items = self._source.drain()
        disconnected_s = time.monotonic() - self._unplugged_at if self.is_interrupted else 0.0
        if self._auto and disconnected_s > BOARD_TIMEOUT_S:
            raise CaptureError(
                f"the read-out board has been disconnected for {BOARD_TIMEOUT_S:g} s",
                code="board-gone",
                where=self._source.name,
                action="Connect it, and run the same command to resume from here",
            )
        for item in items:
            if isinstance(item, StampedSample):
                self._frames += 1
                self._is_late = item.sample.late
                self._last_ohm = self._dividers.resistance(item.sample.counts)
                if self._step is not None:
                    self._hold.time.append(item.device_us / 1e6)
                    self._hold.ohm.append(self._last_ohm)
            elif item.kind == "gap":
                self.is_interrupted, self._unplugged_at = True, time.monotonic()
                self._has_gap = True
            elif item.kind in ("resumed", "start"):
                self.is_interrupted = False
            elif item.kind == "dropped":
                self._has_gap = True

    def _record_event(self, kind: str, step: int, **data: object) -> None:
        data = {"step": step, "at": round(time.time(), 3), **data}
        self._recorder.add(Event(time.monotonic_ns(), kind, data))

    def _readings(self) -> dict[str, tuple[Float, Float]]:
        """Return the strains (n,) and the changes (R - R0)/R0 (n,) by cord.

        There are none before the first reading on the flat jig, which gives R0.
        """
        steps, geometry = self._session.steps, self._session.geometry
        flat = [ohm for n, ohm in self.settled_ohm.items() if steps[n].radius is None]
        if not flat:
            return {}
        changes = relative_change(np.array(list(self.settled_ohm.values())), np.mean(flat, axis=0))
        out = {}
        for k, (place, side) in enumerate(CHANNELS.items()):
            strains = []
            for n in self.settled_ohm:
                radius, sign = steps[n].radius, 1 if steps[n].face == "a" else -1
                strains.append(0.0 if radius is None else geometry.strain(radius, side * sign))
            out[place] = (np.array(strains), changes[:, k])
        return out

    def readings_plot(self) -> Plot | None:
        """Return the finished readings, (R - R0)/R0 over strain; None before the first."""
        readings = self._readings()
        if not readings:
            return None
        x = max(1.1 * _largest(*(s for s, _ in readings.values())), _MIN_STRAIN_RANGE)
        y = max(1.1 * _largest(*(c for _, c in readings.values())), _MIN_CHANGE_RANGE)
        order = ("neutral", "bottom", "top")  # the outer cords are drawn over the neutral one
        curves = tuple(Curve(p, *readings[p], _CORD_COLORS[p]) for p in order)
        title = f"(R - R0)/R0 (+-{y:.1%}) over strain (+-{x:.1%})"
        return Plot(title, curves, (-x, x), (-y, y), aspect=0.5)

    def _notes(self) -> list[Notice]:
        """Return notes on open or shorted cords, a neutral cord that changes, and lost samples."""
        out = []
        for place, ohm in zip(CHANNELS, self._last_ohm, strict=True):
            if self._frames and not (np.isfinite(ohm) and ohm > 0):
                state = "shorted" if ohm == 0 else "open" if np.isinf(ohm) else "not read"
                text = f"the {place} cord is {state}: check its joints and its reference resistor"
                out.append(Notice(f"cord-{state.replace(' ', '-')}", text, place))
        changes = {place: _largest(c) for place, (_, c) in self._readings().items()}
        if changes and len(CHANNELS) * len(self.settled_ohm) >= _MIN_POINTS_FOR_NEUTRAL:
            neutral = changes.pop("neutral")
            largest = max(changes.values())
            if neutral > _NEUTRAL_CHANGE_SHARE * largest:
                text = (
                    f"the neutral cord changes by {neutral:.2%}, the others by up to"
                    f" {largest:.1%}: check the temperature, its joints and its position"
                )
                out.append(Notice("neutral-cord-changes", text))
        if self._is_late:
            text = "the read-out board is too slow: choose a lower rate or fewer averages"
            out.append(Notice("board-late", text))
        statistics = self._source.statistics
        if statistics.lost + statistics.gaps:
            text = (
                f"{statistics.lost} samples lost, {statistics.gaps} gaps; both are marked in the"
                " recording"
            )
            out.append(Notice("samples-lost", text))
        return out


def _largest(*values: Float) -> float:
    """Return the largest finite magnitude; 0 without one."""
    magnitudes = np.abs(np.concatenate(values))
    return float(magnitudes[np.isfinite(magnitudes)].max(initial=0.0))


def _instruction(phase: Phase, step: JigStep) -> str:
    if phase == "done":
        return "The measurement has ended."
    if phase == "waiting":
        return (
            "**The read-out board is disconnected.** Connect it again; this step is then repeated."
        )
    down, up = _SIDES[step.face]
    jig = "the flat jig" if step.radius is None else f"jig {step.jig}"
    return (
        f"Place the specimen on **{jig}**, with its **{down}** side on the jig and the {up} cord on"
        " top. Strap it down."
    )


def draw_specimen(step: JigStep, geometry: Geometry, length: float) -> Plot:
    """Draw the specimen on its jig from the side.

    Args:
        step: The step.
        geometry: Geometry of the specimen.
        length: Length of the specimen, mm.
    """
    half, h = length / 2, geometry.thickness
    down, up = _SIDES[step.face]
    levels: list[tuple[float, int | None]] = [(-depth * h, None) for depth in _JIG_DEPTHS]
    levels += [(0.0, None), (h, None)]
    levels += [(_CORD_DEPTH * h, _CORD_COLORS[down]), ((1 - _CORD_DEPTH) * h, _CORD_COLORS[up])]
    curves = []
    for height, color in levels:
        points = [_on_jig(step.radius, s * half / 100, height, h) for s in range(-100, 101)]
        x, y = np.array(points).T
        curves.append(Curve("", x, y, color, is_line=True))
    x_limits, y_limits = (-1.05 * half, 1.05 * half), (-0.5 * half, 1.3 * h)
    return Plot("", tuple(curves), x_limits, y_limits, aspect=0.25, has_axes=False)


def _on_jig(radius: float | None, s: float, height: float, thickness: float) -> tuple[float, float]:
    """Return the position of the point `height` above the jig, `s` along the neutral plane."""
    if radius is None:
        return s, height
    angle = s / (radius + thickness / 2)
    return (radius + height) * math.sin(angle), (radius + height) * math.cos(angle) - radius
