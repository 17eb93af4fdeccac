"""Sessions: of twins, guided, stopped and resumed, and what they are fitted to."""

import json
import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.readings import joined
from defsense_fab.calibration.settling import Criterion, creep, settled
from defsense_fab.capture.recording import read_recording
from defsense_fab.capture.source import Event, Stamped, Statistics
from defsense_fab.cli import main
from defsense_fab.core.errors import CalibrationError, CaptureError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.pipeline import session as sessions
from defsense_fab.pipeline.record import run_wizard
from defsense_fab.pipeline.session import measure
from defsense_fab.pipeline.synthetic import record_twin
from defsense_fab.sensing.frames import Info, Sample
from defsense_fab.sensing.readout import Dividers
from defsense_fab.sensing.response import Response, response_of
from defsense_fab.twin.cord import Cords, Traits
from defsense_fab.twin.specimen import SpecimenTwin

#: Sessions of the coverage test.
SESSIONS = int(os.environ.get("DEFSENSE_SESSIONS", "2"))


def test_settling_follows_its_criterion():
    time = np.arange(0.05, 30, 0.05)
    ohm = 2000 * (1 + 0.02 * np.exp(-time / 3))[:, None]
    c = Criterion(window=6, tolerance=0.0005, least=8, most=90)
    assert settled(time[:50], ohm[:50], c) is None
    still = [settled(time[:n], ohm[:n], c).still for n in range(130, len(time))]
    first = time[130 + still.index(True)]
    # The halves' means differ by 0.02 exp(-t/3) (e - 1)^2: less than 0.0005 from 14.3 s on.
    assert first == pytest.approx(3 * np.log(40 * (np.e - 1) ** 2), abs=0.2)
    assert all(still[still.index(True) :])
    at = settled(time, ohm, c)
    assert at.ohm == pytest.approx([2000], rel=2e-5)
    assert not at.over
    open_cord = np.full((600, 1), np.inf)
    assert not settled(time, open_cord[: len(time)], c).still


def test_creep_is_found_again():
    time = np.arange(0.1, 40, 0.1)
    rng = np.random.default_rng(0)
    found = creep(time, 2000 + 30 * np.exp(-time / 7) + rng.normal(0, 1, len(time)))
    assert (found.end, found.start) == pytest.approx((2000, 30), rel=0.05)
    assert found.time == pytest.approx(7, rel=0.15)
    assert np.isnan(creep(time, 2000 + rng.normal(0, 1, len(time))).time)


def test_a_twin_cord_is_late_and_heals():
    """It reads too high after a change, either way, and lags behind by its play."""
    traits = Traits(Response.line(2.0), noise=0, play=0.003, healing=0.1, time=8.0, spread=0)
    cords = Cords(traits, np.array([100.0]), np.random.default_rng(0))
    rest = cords.rest[0]
    cords.bend(np.array([0.05]))
    _, ohm = cords.hold(600, 1)
    change = ohm[:, 0] / rest - 1
    assert change[0] > 0.1
    assert change[-1] == pytest.approx(0.1 - 0.003, abs=2e-4)
    cords.bend(np.array([0.0]))
    _, ohm = cords.hold(600, 1)
    assert ohm[0, 0] / rest - 1 > 0.008
    assert ohm[-1, 0] / rest - 1 == pytest.approx(0.003, abs=2e-4)


def recover(tmp_path, seed, k=2.0, q=0.0, **traits):
    spec = ResponseSpec("quadratic", {"k": k, "q": q}, (-0.1, 0.1))
    parts = []
    for n, length in enumerate((150.0, 200.0)):
        folder = tmp_path / f"{seed}-{length:g}"
        record_twin(folder, Traits(response_of(spec), **traits), seed=10 * seed + n, length=length)
        parts.append(measure(folder).readings)
    return calibrate(joined(parts), draws=60)


@pytest.mark.slow
def test_twins_give_their_response_back(tmp_path):
    """Both lengths, nine radii, both faces, as in Fig. 3; noise, hysteresis, relaxation, pieces
    that differ."""
    found = [recover(tmp_path, s, spread=0.03) for s in range(SESSIONS)]
    held = sum(f.doubt.interval[0] <= 2 <= f.doubt.interval[1] for f in found)
    assert held >= 0.93 * SESSIONS - 1
    assert np.median([abs(f.k_res / 2 - 1) for f in found]) < 0.02
    assert [f.response.model for f in found].count("line") >= 0.9 * SESSIONS
    low, high = found[0].response.strain_range
    assert (low, high) == pytest.approx((-5.5 / 82.5, 5.5 / 82.5))


@pytest.mark.slow
def test_a_curved_twin_is_found_curved(tmp_path):
    found = recover(tmp_path, 1, q=6.0)
    assert found.response.model == "quadratic"
    assert found.response.coefficients["q"] == pytest.approx(6, abs=1)


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
        self.twin = SpecimenTwin(Traits(Response.line(2.0)), rng)
        self._dividers = Dividers(np.full(3, 2200.0), 1024)
        self._count, self._breaks, self.gaps, self.open = 0, list(breaks), 0, False
        self._away = False

    def start(self):
        self._first = True
        return Info(1, (1, 0), 0, 3, 16, 20, 0, 8, 1024)

    def lay(self, radius, face):
        self.twin.lay(radius, face)

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
        begun = self.twin.cords.now
        time, ohm = self.twin.cords.hold(0.5, 20)
        for t, row in zip(begun + time, ohm, strict=True):
            sums = np.round(16 * self._dividers.counts(row)).astype(int)
            if self.open:
                sums[2] = 16 * 1023
            sums = tuple(int(n) for n in sums)
            micros = int(1e6 * t)
            out.append(
                Stamped(1000 * micros, micros, Sample(self._count, micros, False, False, 16, sums))
            )
            self._count += 1
        for item in out:
            self.sink(item)
        return out

    def read_latest(self, max_age):
        raise NotImplementedError

    @property
    def statistics(self):
        return Statistics(self._count, gaps=self.gaps)

    def close(self):
        pass


def begin(folder, rounds=1, radii=(75.0, 112.0, 200.0)):
    return sessions.create(
        folder, name="s", geometry=sessions.Geometry(), length=150, radii=radii, rounds=rounds,
        faces=["a", "b"], seed=1, reference=[2200.0] * 3, criterion=Criterion(), rate=20,
        average=None,
    )  # fmt: skip


def test_a_guided_session(tmp_path):
    session, source, screen = begin(tmp_path / "s", rounds=2), Fast(), Keys()
    assert run_wizard(session, source, screen, source.lay, auto=True)
    assert sessions.unfinished(session) == []
    found = measure(session.folder)
    assert len(found.readings.where) == 3 * len(session.steps)
    assert found.unsettled == 0
    assert calibrate(found.readings, draws=5).k_res == pytest.approx(2.0, rel=0.05)
    last = screen.views[-1]
    assert (last.phase, last.done) == ("done", len(session.steps))
    assert len(last.points) == 3 * len(session.steps)
    # Each step waits until it has settled, and not before its least time.
    elapsed = [
        v.elapsed for v in screen.views if v.phase == "settling" and v.settled and v.settled.still
    ]
    assert min(elapsed) >= Criterion().least - 0.6


def test_stopped_and_resumed_without_losing_a_frame(tmp_path):
    session = begin(tmp_path / "s")
    counts = []
    source = Fast()
    stop = Keys(place=["enter", "enter", "enter", "q"])
    assert not run_wizard(session, source, stop, source.lay)
    counts.append(source._count)
    assert len(sessions.unfinished(session)) == len(session.steps) - 3
    source = Fast(seed=1)
    assert not run_wizard(
        session, source, Keys(place=["enter"], settling=[None] * 5 + ["q"]), source.lay
    )
    counts.append(source._count)
    assert len(sessions.unfinished(session)) == len(session.steps) - 3
    source = Fast(seed=2)
    assert run_wizard(sessions.load(session.folder), source, Keys(), source.lay, auto=True)
    counts.append(source._count)
    frames = read_recording(session.frames)
    assert len(frames.counter) == sum(counts)
    assert len(sessions.holds(session, frames)) == len(session.steps)


def test_back_skip_repeat_and_take(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    keys = Keys(place=["enter", "enter", "b", "enter", "s", "enter", "q"],
                settling=[None] * 40 + ["r"] + [None] * 13 + ["t"])  # fmt: skip
    assert not run_wizard(session, source, keys, source.lay)
    events = [e for _, e in read_recording(session.frames).events]
    told = [(e["event"], e["step"]) for e in events if "step" in e]
    assert told.count(("skip", 2)) == 1
    assert ("redo", 1) in told
    assert told.count(("point", 1)) == 2
    assert set(sessions.unfinished(session)) == set(range(len(session.steps))) - {0, 1, 3}
    assert len(measure(session.folder).readings.where) == 3 * 3


def test_unplugged_in_a_hold(tmp_path):
    """The hold begins anew; the gap stands in the file."""
    session, source = begin(tmp_path / "s"), Fast(breaks=[100])
    screen = Keys()
    assert run_wizard(session, source, screen, source.lay, auto=True)
    recording = read_recording(session.frames)
    kinds = [e["event"] for _, e in recording.events]
    at = kinds.index("gap")
    assert kinds[at - 1 : at + 4] == ["hold", "gap", "resumed", "hold", "point"]
    assert len(sessions.holds(session, recording)) == len(session.steps)
    assert any("gaps" in n for v in screen.views for n in v.notes)


def test_an_open_cord_is_told_and_never_taken(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    source.open = True
    screen = Keys(place=["enter", "q"], settling=[None] * 300 + ["t", "q"])
    assert not run_wizard(session, source, screen, source.lay)
    assert any("top cord is open" in n for n in screen.views[-1].notes)
    assert len(sessions.unfinished(session)) == len(session.steps)
    with pytest.raises(CaptureError, match="top cord is open"):
        run_wizard(session, source, Keys(), source.lay, auto=True)


def test_a_session_in_two_runs_fits_like_one(tmp_path):
    """The second run's clock begins anew: what pieces remember must not be thrown."""
    folder = tmp_path / "whole"
    record_twin(folder, Traits(Response.line(2.0)), seed=1, rounds=2)
    shutil.copytree(folder, tmp_path / "split")
    lines = (folder / "frames.csv").read_text().splitlines()
    points = [n for n, line in enumerate(lines) if '"point"' in line]
    cut = points[len(points) // 2] + 1
    start = next(line for line in lines if '"start"' in line)
    first = int(lines[cut + 1].split(",")[1])

    def again(line):
        cells = line.split(",")
        return (
            line if line[0] == "#" else ",".join([cells[0], str(int(cells[1]) - first), *cells[2:]])
        )

    both = [*lines[:cut], start, *map(again, lines[cut:])]
    (tmp_path / "split" / "frames.csv").write_text("\n".join(both) + "\n")
    whole, split = (measure(tmp_path / name).readings for name in ("whole", "split"))
    assert split.memory == pytest.approx(whole.memory, abs=2e-3)
    one, two = (calibrate(r, draws=5).k_res for r in (whole, split))
    assert two == pytest.approx(one, rel=1e-3)


def test_skipped_steps_are_asked_for_again(tmp_path):
    session, source = begin(tmp_path / "s"), Fast()
    assert not run_wizard(session, source, Keys(place=["s"] * len(session.steps)), source.lay)
    assert len(sessions.unfinished(session)) == len(session.steps)
    with pytest.raises(CalibrationError, match="no step was finished"):
        measure(session.folder)
    source = Fast(seed=1)
    assert run_wizard(session, source, Keys(), source.lay, auto=True)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("reference", [2200]), ("reference", ["a", 1, 1]), ("reference", [0, 1, 1]),
        ("criterion", "6"), ("steps", [[0, 75, "z"]]), ("steps", [[0, 0, "a"]]), ("steps", 3),
        ("specimen", None), ("rate", "x"), ("schema", 2), ("channels", ["a"]),
    ],
)  # fmt: skip
def test_edited_sessions(tmp_path, key, value):
    session = begin(tmp_path / "s")
    path = session.folder / "session.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(CalibrationError, match=r"session.json"):
        sessions.load(session.folder)


@pytest.mark.parametrize(
    "event",
    [
        '{"event": "hold", "step": 99}',
        '{"event": "hold", "step": "x"}',
        '{"event": "start", "full_scale": "a"}',
    ],
)
def test_edited_frames(tmp_path, event):
    session = begin(tmp_path / "s")
    head = "# defsense recording 1\nhost_ns,device_us,counter,led,late,averages,s1,s2,s3\n"
    session.frames.write_text(f"{head}# {event}\n")
    with pytest.raises(CalibrationError, match="does not belong"):
        measure(session.folder)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("session.json", "{", "not valid JSON"),
        ("session.json", "{}", "not a session"),
        ("session.json", None, "cannot be read"),
        ("frames.csv", None, "nothing was recorded"),
        ("frames.csv", "# defsense recording 1\nhost_ns,device_us,counter,led,late,averages,s1\n",
         "no step was finished"),
    ],
)  # fmt: skip
def test_broken_sessions(tmp_path, name, text, says):
    begin(tmp_path / "s")
    path = tmp_path / "s" / name
    path.unlink(missing_ok=True)
    if text is not None:
        path.write_text(text)
    with pytest.raises(CalibrationError, match=says):
        measure(tmp_path / "s")


SPECIMEN = {
    "length": 150, "thickness": 15, "channels": {"inner": 2},
    "jigs": [{"radius": r} for r in (None, 75, 112, 200)],
}  # fmt: skip


def test_the_commands(tmp_path, capsys):
    """Sessions of twins, their fit, and a session that is finished already."""
    assert main(["calibrate", "twin", str(tmp_path), "--rounds", "1", "--seed", "3"]) == 0
    folders = [str(tmp_path / f"session-{n}") for n in (150, 200)]
    assert " ".join(folders) in capsys.readouterr().out
    out = tmp_path / "response.json"
    assert main(["calibrate", "fit", *folders, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["k_res"] == pytest.approx(2, rel=0.06)
    assert told["hysteresis"] == pytest.approx(0.003, abs=0.002)
    assert 4 < told["creep"]["time"] < 16
    assert told["raw_hash"]
    (tmp_path / "specimen.json").write_text(json.dumps(SPECIMEN))
    record = ["calibrate", "record", "--port", "twin", "--specimen", str(tmp_path)]
    assert main([*record, "--out", folders[0], "--auto"]) == 2
    assert "is finished; fit it" in capsys.readouterr().err
    again = [*record, "--out", str(tmp_path / "new")]
    assert main([*again, "--auto", "--average", "1000"]) == 2
    assert "does not take 'average 1000'" in capsys.readouterr().err
    assert not (tmp_path / "new" / "session.json").exists()
    assert main([*record, "--radii", "75,112", "--auto"]) == 2
    assert "give 3 different ones" in capsys.readouterr().err
    begin(tmp_path / "begun", rounds=1)
    assert main([*record, "--out", str(tmp_path / "begun"), "--auto", "--rounds", "2"]) == 2
    assert "was begun with rounds 1" in capsys.readouterr().err
    for bad in (["--seed", "-1"], ["--reference", "nan"], ["--longest", "inf"]):
        assert main([*again, "--auto", *bad]) == 2
        assert "give a number from" in capsys.readouterr().err
    assert main(["calibrate", "twin", str(tmp_path / "t"), "--lengths", "150,-20"]) == 2
    assert main(["calibrate", "twin", str(tmp_path), "--rounds", "1"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main([*record, "--radii", "80", "--auto"]) == 2
    assert "80 is none of the specimen's jigs" in capsys.readouterr().err
    assert main(record) == 2
    assert "standard input is no terminal" in capsys.readouterr().err
    assert main(["calibrate", "ports", "--port", "twin", "--seconds", "0.5", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["ohm"]) == 3
    assert main(["calibrate", "reference", "--port", "twin", "--known", "2500", "--json"]) == 0
    assert 1500 < min(json.loads(capsys.readouterr().out)["reference"]) < 3500
    assert main(["calibrate", "ports", "--port", "twin:pace=3"]) == 2
    assert "write twin:speed=20" in capsys.readouterr().err


class Terminal:
    """The command in a pseudo-terminal: keys go in, the screen's text comes out."""

    def __init__(self, *arguments):
        master, slave = pty.openpty()
        command = [
            sys.executable,
            "-c",
            "import sys; from defsense_fab.cli import main; sys.exit(main())",
        ]
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "110", "LINES": "45"}
        self.process = subprocess.Popen(
            [*command, *arguments], stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        os.close(slave)
        self._master, self.text = master, ""

    def until(self, pattern, seconds=20):
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
        code = self.process.wait(20)
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
    assert screen.end() == 0
    screen = Terminal(*command)
    for done in (2, 3, 4):
        screen.until(f"(?s){done} of 5 readings.*Enter measure")
        screen.key("\n")
    screen.until("all 5 readings are done")
    assert screen.end() == 0
    assert sessions.unfinished(sessions.load(tmp_path / "session")) == []
