"""Lines on runs that go on and end, where there is no terminal and for scripts."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.capture.readout.source import RecordingEnd
from defsense_fab.cli.terminal import live_lines
from defsense_fab.cli.terminal.live_lines import LiveLines, labels, page
from defsense_fab.core.errors import CaptureError, LiveError
from defsense_fab.runtime.live.live_loop import LiveStatus
from tests.runtime.live_frames import frame

NONE = (np.nan, np.nan)


class Loop:
    """Ends with the look of this number, by an error; says nothing from that of another on."""

    def __init__(self, ends, error, silent=None):
        self.looks, self.ends, self.error, self.closed = 0, ends, error, False
        self.silent = silent or ends + 1

    def wait(self, seconds):
        self.looks += 1
        if self.looks >= self.ends:
            raise self.error
        return True

    @property
    def status(self):
        notes = (f"no sample for {self.looks} s",) if self.looks >= self.silent else ()
        return LiveStatus(frame(), 100.0, 0.0, NONE, NONE, self.looks, 0, notes)


def run(port="twin", device="bar", ends=1, error=None, silent=None):
    made = SimpleNamespace(device=device, port=port, loop=Loop(ends, error, silent))
    made.end = lambda: setattr(made.loop, "closed", True)
    return made


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr(live_lines, "_POLL_INTERVAL_S", 0.0)


def test_a_run_that_ended_is_told_once_while_others_go_on(capsys):
    first = run("COM3", ends=3, error=CaptureError("COM3: is gone"))
    second = run("COM4", ends=30, error=RecordingEnd("COM4: the recording is at its end"))
    with LiveLines([first, second]) as lines, pytest.raises(CaptureError, match="COM3: is gone"):
        lines.follow(None)
    assert first.loop.looks == 3
    assert first.loop.closed
    assert capsys.readouterr().out.splitlines() == [
        "bar (COM3): trusted",
        "bar (COM4): trusted",
        "bar (COM3): ended: COM3: is gone",
        "bar (COM4): ended: COM4: the recording is at its end",
    ]


def test_silence_is_told_once_and_not_by_the_second(capsys):
    one = run("COM3", ends=9, error=RecordingEnd("at its end"), silent=4)
    with LiveLines([one]) as lines:
        lines.follow(None)
    assert capsys.readouterr().out.splitlines() == [
        "bar: trusted", "bar: trusted; no sample for 4 s", "bar: ended: at its end",
    ]  # fmt: skip


def test_json_tells_an_end_once(capsys, monkeypatch):
    monkeypatch.setattr(live_lines, "_JSON_INTERVAL_S", 0.0)
    first = run("COM3", ends=2, error=RecordingEnd("COM3: the recording is at its end"))
    second = run("COM4", "cube", ends=4, error=RecordingEnd("COM4: the recording is at its end"))
    with LiveLines([first, second], as_json=True) as lines:
        lines.follow(None)
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    by = [[r["ended"] for r in rows if r["port"] == port] for port in ("COM3", "COM4")]
    assert by[0] == [None, "COM3: the recording is at its end"]
    assert by[1] == [None, None, None, "COM4: the recording is at its end"]
    assert {r["device"] for r in rows if r["port"] == "COM4"} == {"cube"}


def test_the_end_of_recordings_is_no_error_and_the_last_error_is_raised():
    end = RecordingEnd("at its end")
    with LiveLines([run(ends=1, error=end)]) as lines:
        lines.follow(None)
    several = [
        run("a", ends=1, error=CaptureError("first")), run("b", ends=3, error=CaptureError("last")),
        run("c", ends=5, error=end),
    ]  # fmt: skip
    with LiveLines(several) as lines, pytest.raises(CaptureError, match="last"):
        lines.follow(None)


def test_an_error_of_whatever_kind_ends_its_device_alone(capsys):
    first = run("COM3", ends=2, error=np.linalg.LinAlgError("Singular matrix"))
    second = run("COM4", ends=9, error=RecordingEnd("at its end"))
    with LiveLines([first, second]) as lines, pytest.raises(LiveError) as caught:
        lines.follow(None)
    assert str(caught.value).startswith("bar (COM3): LinAlgError in the live loop: Singular matrix")
    assert second.loop.looks == 9
    assert capsys.readouterr().out.count("ended: bar (COM3): LinAlgError") == 1


def test_ctrl_c_among_lines_of_json_is_no_line(capsys):
    for as_json, out in ((True, ""), (False, "ended\n")):
        one = run(ends=1, error=KeyboardInterrupt())
        with LiveLines([one], as_json=as_json) as lines:
            lines.follow(None)
        assert capsys.readouterr().out == out


def test_several_have_their_ports_in_their_names():
    assert labels([run("a")]) == ["bar"]
    assert labels([run("a"), run("b", "bar-2")]) == ["bar (a)", "bar-2 (b)"]


def test_the_page_names_what_it_tells_of():
    status = LiveStatus(None, 0.0, 0.0, NONE, NONE, 0, 0, ())
    assert page(status, "bar (a)")[0].plain == "bar (a): waiting for samples"
    assert page(status, "bar (a)", "COM3: is gone")[0].plain == "bar (a) ended: COM3: is gone"
