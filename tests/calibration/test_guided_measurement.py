"""The guided session: keys, gaps and open cords, in simulated time and in a terminal."""

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
from defsense_fab.calibration.guided_measurement import run_guided_measurement
from defsense_fab.calibration.session import read_session

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.core.storage.session_manifest import Criterion
from defsense_fab.capture.readout.recording import read_recording
from defsense_fab.capture.readout.source import Event, ReadoutStatistics, StampedSample
from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.core.errors import CalibrationError, CaptureError
from defsense_fab.sensing.response import Response
from defsense_fab.sensing.serial_frames import Info, Sample
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.cords import CordTraits, SpecimenTwin
from tests.calibration.empty_session import begin, SPECIMEN


class Keys:
    """A screen of a script: keys by phase, in turn; then none."""

    def __init__(self, **keys):
        self._keys, self.views = keys, []

    def show(self, view):
        self.views.append(view)

    def key(self, timeout):
        left = self._keys.get(self.views[-1].phase, [])
        return left.pop(0) if left else None


class Fast:
    """A source in simulated time: each look brings a tenth of a second of a specimen's cords."""

    name, sink = "fast", None

    def __init__(self, seed=0, breaks=()):
        rng = np.random.default_rng(seed)
        self.twin = SpecimenTwin(CordTraits(Response.line(2.0)), rng)
        self._dividers = Dividers(np.full(3, 2200.0), 1024)
        self._count, self._breaks, self.gaps, self.open = 0, list(breaks), 0, False
        self._away = False

    def start(self):
        self._first = True
        return Info(1, (1, 0), 0, 3, 16, 20, 0, 8, 1024)

    def lay(self, radius, face):
        self.twin.place(radius, face)

    def drain(self):
        out = []
        if self._first:
            self._first = False
            out.append(Event(0, "start", {"full_scale": 1024}))
        if self._breaks and self._count >= self._breaks[0]:
            self._breaks.pop(0)
            self.gaps += 1
            self._away = True
            gap = Event(self._count, "gap", {"why": "unplugged"})
            self.sink(gap)
            return [*out, gap]
        if self._away:
            self._away = False
            out.append(Event(self._count, "resumed", {"full_scale": 1024}))
        begun = self.twin.cords.time
        time, ohm = self.twin.cords.measure(0.5, 20)
        for t, row in zip(begun + time, ohm, strict=True):
            sums = np.round(16 * self._dividers.counts(row)).astype(int)
            if self.open:
                sums[2] = 16 * 1023
            sums = tuple(int(n) for n in sums)
            micros = int(1e6 * t)
            out.append(
                StampedSample(
                    1000 * micros, micros, Sample(self._count, micros, False, False, 16, sums)
                )
            )
            self._count += 1
        for item in out:
            self.sink(item)
        return out

    def read_latest(self, max_age):
        raise NotImplementedError

    @property
    def statistics(self):
        return ReadoutStatistics(self._count, gaps=self.gaps)

    def close(self):
        pass


def test_a_guided_session(tmp_path):
    session, source, screen = begin(tmp_path / "s", rounds=2), Fast(), Keys()
    assert run_guided_measurement(session, source, screen, source.lay, auto=True)
    assert sessions.unfinished_steps(session) == []
    found = read_session(session.folder)
    assert len(found.readings.where) == 3 * len(session.steps)
    assert found.unsettled == 0
    assert calibrate(found.readings, draws=5).k_res == pytest.approx(2.0, rel=0.05)
    last = screen.views[-1]
    assert (last.phase, last.done) == ("done", len(session.steps))
    assert len(last.points) == 3 * len(session.steps)
    # Each step waits until it has settled, and not before its least time.
    elapsed = [
        v.elapsed for v in screen.views if v.phase == "settling" and v.settling and v.settling.is_settled
    ]
    assert min(elapsed) >= Criterion().least - 0.6


def test_stopped_and_resumed_without_losing_a_frame(tmp_path):
    session = begin(tmp_path / "s")
    counts = []
    source = Fast()
    stop = Keys(place=["enter", "enter", "enter", "q"])
    assert not run_guided_measurement(session, source, stop, source.lay)
    counts.append(source._count)
    assert len(sessions.unfinished_steps(session)) == len(session.steps) - 3
    source = Fast(seed=1)
    assert not run_guided_measurement(
        session, source, Keys(place=["enter"], settling=[None] * 5 + ["q"]), source.lay
    )
    counts.append(source._count)
    assert len(sessions.unfinished_steps(session)) == len(session.steps) - 3
    source = Fast(seed=2)
    assert run_guided_measurement(
        sessions.load_session(session.folder), source, Keys(), source.lay, auto=True
    )
    counts.append(source._count)
    frames = read_recording(session.frames)
    assert len(frames.counter) == sum(counts)
    assert len(sessions.find_holds(session, frames)) == len(session.steps)


def test_back_skip_repeat_and_take(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    keys = Keys(place=["enter", "enter", "b", "enter", "s", "enter", "q"],
                settling=[None] * 40 + ["r"] + [None] * 13 + ["t"])  # fmt: skip
    assert not run_guided_measurement(session, source, keys, source.lay)
    events = [e for _, e in read_recording(session.frames).events]
    told = [(e["event"], e["step"]) for e in events if "step" in e]
    assert told.count(("skip", 2)) == 1
    assert ("redo", 1) in told
    assert told.count(("point", 1)) == 2
    assert set(sessions.unfinished_steps(session)) == set(range(len(session.steps))) - {0, 1, 3}
    assert len(read_session(session.folder).readings.where) == 3 * 3


def test_unplugged_in_a_hold(tmp_path):
    """The hold begins anew; the gap stands in the file."""
    session, source = begin(tmp_path / "s"), Fast(breaks=[100])
    screen = Keys()
    assert run_guided_measurement(session, source, screen, source.lay, auto=True)
    recording = read_recording(session.frames)
    kinds = [e["event"] for _, e in recording.events]
    at = kinds.index("gap")
    assert kinds[at - 1 : at + 4] == ["hold", "gap", "resumed", "hold", "point"]
    assert len(sessions.find_holds(session, recording)) == len(session.steps)
    assert any("gaps" in n for v in screen.views for n in v.notes)


def test_an_open_cord_is_told_and_never_taken(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    source.open = True
    screen = Keys(place=["enter", "q"], settling=[None] * 300 + ["t", "q"])
    assert not run_guided_measurement(session, source, screen, source.lay)
    assert any("top cord is open" in n for n in screen.views[-1].notes)
    assert len(sessions.unfinished_steps(session)) == len(session.steps)
    with pytest.raises(CaptureError, match="top cord is open"):
        run_guided_measurement(session, source, Keys(), source.lay, auto=True)


def test_skipped_steps_are_asked_for_again(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    assert not run_guided_measurement(
        session, source, Keys(place=["s"] * len(session.steps)), source.lay
    )
    assert len(sessions.unfinished_steps(session)) == len(session.steps)
    with pytest.raises(CalibrationError, match="no step was finished"):
        read_session(session.folder)
    source = Fast(seed=1)
    assert run_guided_measurement(session, source, Keys(), source.lay, auto=True)


class Terminal:
    """The command in a pseudo-terminal: keys go in, the screen's text comes out."""

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

    def until(self, pattern, seconds=60):
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

    def key(self, key):
        self.text = ""
        os.write(self._master, key.encode())

    def end(self):
        code = self.process.wait(60)
        os.close(self._master)
        return code


@pytest.mark.slow
def test_the_wizard_in_a_terminal(tmp_path):
    """Driven by keys, stopped half-way, resumed, finished."""
    (tmp_path / "specimen.json").write_text(json.dumps(SPECIMEN))
    command = ("calibrate", "record", "--port", "twin:speed=40", "--specimen", str(tmp_path),
               "--rounds", "1", "--faces", "a")  # fmt: skip
    screen = Terminal(*command)
    screen.until("(?s)0 of 5 readings.*Lay the specimen on the flat jig")
    screen.key("\n")
    screen.until("(?s)1 of 5 readings.*its BOTTOM side on the jig.*Enter measure")
    screen.key("\n")
    screen.until("2 of 5 readings")
    screen.key("q")
    screen.until("stopped with 2 of 5 readings")
    assert screen.end() == STOPPED
    screen = Terminal(*command)
    for done in (2, 3, 4):
        screen.until(f"(?s){done} of 5 readings.*Enter measure")
        screen.key("\n")
    screen.until("all 5 readings are done")
    assert screen.end() == 0
    assert sessions.unfinished_steps(sessions.load_session(tmp_path / "session")) == []
