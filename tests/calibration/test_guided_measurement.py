"""Test the guided measurement: keys, gaps and open cords, in simulated time and a terminal."""

import json
import os
import pty
import re
import select
import subprocess
import sys
import time

import numpy as np
import pytest

from defsense_fab.calibration import session as sessions
from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.guided_measurement import run_guided_measurement
from defsense_fab.calibration.session_readings import read_session
from defsense_fab.capture.readout.recording import read_recording
from defsense_fab.capture.readout.source import Event, ReadoutStatistics, StampedSample
from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.core.errors import CalibrationError, CaptureError
from defsense_fab.core.guided_parts import Plot
from defsense_fab.core.storage.session_manifest import Criterion
from defsense_fab.sensing.response import Response
from defsense_fab.sensing.serial_frames import Info, Sample
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.cords import CordTraits, SpecimenTwin
from tests.calibration.new_session import SPECIMEN, create_session
from tests.support.errors import raises


class ScriptedScreen:
    """A screen that presses given keys in each phase, one after the other."""

    def __init__(self, **keys):
        self._keys, self.views = keys, []

    def show(self, view):
        self.views.append(view)

    def key(self, timeout):
        keys = self._keys.get(self.views[-1].state.phase, [])
        return keys.pop(0) if keys else None


class SimulatedSource:
    """A source in simulated time: each poll returns half a second of a specimen's samples."""

    name, sink = "simulated", None

    def __init__(self, seed=0, breaks=()):
        rng = np.random.default_rng(seed)
        self.twin = SpecimenTwin(CordTraits(Response.line(2.0)), rng)
        self._dividers = Dividers(np.full(3, 2200.0), 1024)
        self.count, self._breaks, self.gaps, self.open = 0, list(breaks), 0, False
        self._is_unplugged = False

    def start(self):
        self._first = True
        return Info(1, (1, 0), 0, 3, 16, 20, 0, 8, 1024)

    def place(self, radius, face):
        self.twin.place(radius, face)

    def drain(self):
        out = []
        if self._first:
            self._first = False
            out.append(Event(0, "start", {"full_scale": 1024}))
        if self._breaks and self.count >= self._breaks[0]:
            self._breaks.pop(0)
            self.gaps += 1
            self._is_unplugged = True
            gap = Event(self.count, "gap", {"why": "unplugged"})
            self.sink(gap)
            return [*out, gap]
        if self._is_unplugged:
            self._is_unplugged = False
            out.append(Event(self.count, "resumed", {"full_scale": 1024}))
        start = self.twin.cords.time
        time, ohm = self.twin.cords.measure(0.5, 20)
        for t, row in zip(start + time, ohm, strict=True):
            sums = np.round(16 * self._dividers.counts(row)).astype(int)
            if self.open:
                sums[2] = 16 * 1023
            sums = tuple(int(n) for n in sums)
            micros = int(1e6 * t)
            out.append(
                StampedSample(
                    1000 * micros, micros, Sample(self.count, micros, False, False, 16, sums)
                )
            )
            self.count += 1
        for item in out:
            self.sink(item)
        return out

    def read_latest(self, max_age):
        raise NotImplementedError

    @property
    def statistics(self):
        return ReadoutStatistics(self.count, gaps=self.gaps)

    def close(self):
        pass


def test_guided_session(tmp_path):
    session, source, screen = (
        create_session(tmp_path / "s", rounds=2),
        SimulatedSource(),
        ScriptedScreen(),
    )
    assert run_guided_measurement(session, source, screen, source.place, auto=True)
    assert sessions.unfinished_steps(session) == []
    result = read_session(session.folder)
    assert len(result.readings.where) == 3 * len(session.steps)
    assert result.unsettled == 0
    assert calibrate(result.readings, draws=5).k_res == pytest.approx(2.0, rel=0.05)
    last = screen.views[-1]
    assert (last.state.phase, len(last.state.done)) == ("done", len(session.steps))
    (plot,) = [part for part in last.parts if isinstance(part, Plot)]
    assert sum(len(curve.x) for curve in plot.curves) == 3 * len(session.steps)
    # Each step waits until it has settled, and at least for the shortest time.
    holds = sessions.find_holds(session, read_recording(session.frames))
    assert min(hold.time[-1] for hold in holds.values()) >= Criterion().least - 0.6


def test_session_is_resumed_without_losing_a_frame(tmp_path):
    session = create_session(tmp_path / "s")
    counts = []
    source = SimulatedSource()
    screen = ScriptedScreen(ready=["enter", "enter", "enter", "q"])
    assert not run_guided_measurement(session, source, screen, source.place)
    counts.append(source.count)
    assert len(sessions.unfinished_steps(session)) == len(session.steps) - 3
    source = SimulatedSource(seed=1)
    assert not run_guided_measurement(
        session, source, ScriptedScreen(ready=["enter"], active=[None] * 5 + ["q"]), source.place
    )
    counts.append(source.count)
    assert len(sessions.unfinished_steps(session)) == len(session.steps) - 3
    source = SimulatedSource(seed=2)
    assert run_guided_measurement(
        sessions.load_session(session.folder), source, ScriptedScreen(), source.place, auto=True
    )
    counts.append(source.count)
    frames = read_recording(session.frames)
    assert len(frames.counter) == sum(counts)
    assert len(sessions.find_holds(session, frames)) == len(session.steps)


def test_keys_back_skip_repeat_and_take(tmp_path):
    session, source = create_session(tmp_path / "s"), SimulatedSource()
    keys = ScriptedScreen(
        ready=["enter", "enter", "b", "enter", "s", "enter", "q"],
        active=[None] * 40 + ["r"] + [None] * 13 + ["t"],
    )
    assert not run_guided_measurement(session, source, keys, source.place)
    events = [e for _, e in read_recording(session.frames).events]
    events_by_step = [(e["event"], e["step"]) for e in events if "step" in e]
    assert events_by_step.count(("skip", 2)) == 1
    assert ("redo", 1) in events_by_step
    assert events_by_step.count(("point", 1)) == 2
    assert set(sessions.unfinished_steps(session)) == set(range(len(session.steps))) - {0, 1, 3}
    assert len(read_session(session.folder).readings.where) == 3 * 3


def test_board_is_unplugged_during_a_hold(tmp_path):
    """The hold starts again, and the gap is in the file."""
    session, source = create_session(tmp_path / "s"), SimulatedSource(breaks=[100])
    screen = ScriptedScreen()
    assert run_guided_measurement(session, source, screen, source.place, auto=True)
    recording = read_recording(session.frames)
    kinds = [e["event"] for _, e in recording.events]
    at = kinds.index("gap")
    assert kinds[at - 1 : at + 4] == ["hold", "gap", "resumed", "hold", "point"]
    assert len(sessions.find_holds(session, recording)) == len(session.steps)
    assert "samples-lost" in {n.code for v in screen.views for n in v.notes}


def test_open_cord_is_reported_and_never_taken(tmp_path):
    session, source = create_session(tmp_path / "s"), SimulatedSource()
    source.open = True
    screen = ScriptedScreen(ready=["enter", "q"], active=[None] * 300 + ["t", "q"])
    assert not run_guided_measurement(session, source, screen, source.place)
    assert "cord-open" in [n.code for n in screen.views[-1].notes]
    assert len(sessions.unfinished_steps(session)) == len(session.steps)
    with raises(CaptureError, "cord-unreadable"):
        run_guided_measurement(session, source, ScriptedScreen(), source.place, auto=True)


def test_skipped_steps_are_measured_in_the_next_run(tmp_path):
    session, source = create_session(tmp_path / "s"), SimulatedSource()
    assert not run_guided_measurement(
        session, source, ScriptedScreen(ready=["s"] * len(session.steps)), source.place
    )
    assert len(sessions.unfinished_steps(session)) == len(session.steps)
    with raises(CalibrationError, "no-step-finished"):
        read_session(session.folder)
    source = SimulatedSource(seed=1)
    assert run_guided_measurement(session, source, ScriptedScreen(), source.place, auto=True)


class Terminal:
    """The command in a pseudo-terminal, which takes keys and collects the text on the screen."""

    def __init__(self, *arguments):
        master, slave = pty.openpty()
        command = [
            sys.executable,
            "-c",
            "import sys; from defsense_fab.cli.main import main; sys.exit(main())",
        ]
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "110", "LINES": "45"}
        self.process = subprocess.Popen(
            [*command, *arguments], stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        os.close(slave)
        self._master, self.text = master, ""

    def wait_for(self, pattern, seconds=240):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if re.search(pattern, self.text):
                return
            if select.select([self._master], [], [], 0.1)[0]:
                try:
                    data = os.read(self._master, 65536).decode("utf-8", "replace")
                except OSError:
                    data = ""
                self.text += re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", data)
        raise AssertionError(f"no {pattern!r} on the screen: {self.text[-2000:]}")

    def press(self, key):
        self.text = ""
        os.write(self._master, key.encode())

    def wait(self):
        code = self.process.wait(240)
        os.close(self._master)
        return code


@pytest.mark.slow
def test_guided_measurement_in_a_terminal(tmp_path):
    """It is controlled by keys, stopped halfway, resumed and finished."""
    (tmp_path / "specimen.json").write_text(json.dumps(SPECIMEN))
    options = ("--specimen", str(tmp_path), "--rounds", "1", "--faces", "a")
    command = ("calibrate", "record", "--port", "twin:speed=40", *options)
    screen = Terminal(*command)
    screen.wait_for("(?s)0 of 5 readings.*the flat jig")
    screen.press("\n")
    screen.wait_for("(?s)1 of 5 readings.*its bottom side on the jig.*Enter measure")
    screen.press("\n")
    screen.wait_for("2 of 5 readings")
    screen.press("q")
    screen.wait_for("(?i)stopped.* 2 of 5 readings")
    assert screen.wait() == STOPPED
    screen = Terminal(*command)
    for done in (2, 3, 4):
        screen.wait_for(f"(?s){done} of 5 readings.*Enter measure")
        screen.press("\n")
    screen.wait_for("(?i)all 5 readings")
    assert screen.wait() == 0
    assert sessions.unfinished_steps(sessions.load_session(tmp_path / "session")) == []
