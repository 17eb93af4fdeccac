"""Lines on live runs without a terminal, and as JSON."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.capture.readout.source import NetworkStatistics, RecordingEnd
from defsense_fab.cli.terminal import live_lines
from defsense_fab.cli.terminal.live_lines import LiveLines, as_mapping, labels, page
from defsense_fab.core.errors import CaptureError, LiveError
from defsense_fab.workflow.run.run import LiveStatus
from tests.runtime.live_frames import frame
from tests.support.errors import raises

NONE = (np.nan, np.nan)
VALUES = "bend 0.25; twist -0.50"  # controls of the frames


class Loop:
    """Live loop that fails at the check number `ends`, without samples from `silent` on."""

    def __init__(self, ends, error, silent=None):
        self.checks, self.ends, self.error, self.closed = 0, ends, error, False
        self.silent = silent or ends + 1

    def wait(self, seconds):
        self.checks += 1
        if self.checks >= self.ends:
            raise self.error
        return True

    @property
    def status(self):
        notes = (f"no sample for {self.checks} s",) if self.checks >= self.silent else ()
        return LiveStatus(frame(), 100.0, 0.0, NONE, NONE, self.checks, 0, 0, notes)


def run(port="twin", device="bar", ends=1, error=None, silent=None):
    live_run = SimpleNamespace(device=device, port=port, loop=Loop(ends, error, silent))
    live_run.end = lambda: setattr(live_run.loop, "closed", True)
    return live_run


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(live_lines, "_POLL_INTERVAL_S", 0.0)


def test_ended_run_is_reported_once_while_others_continue(capsys):
    first = run(
        "COM3", ends=3, error=CaptureError("is gone", code="port-disconnected", where="COM3")
    )
    second = run(
        "COM4",
        ends=30,
        error=RecordingEnd("COM4: the recording is at its end", code="recording-ended"),
    )
    with LiveLines([first, second]) as lines, pytest.raises(CaptureError, match="COM3: is gone"):
        lines.follow(None)
    assert first.loop.checks == 3
    assert first.loop.closed
    assert capsys.readouterr().out.splitlines() == [
        f"bar (COM3): trusted; {VALUES}",
        f"bar (COM4): trusted; {VALUES}",
        "bar (COM3): ended: COM3: is gone",
        "bar (COM4): ended: COM4: the recording is at its end",
    ]


def test_missing_samples_are_reported_once(capsys):
    one = run("COM3", ends=9, error=RecordingEnd("at its end", code="recording-ended"), silent=4)
    with LiveLines([one]) as lines:
        lines.follow(None)
    assert capsys.readouterr().out.splitlines() == [
        f"bar: trusted; {VALUES}",
        f"bar: trusted; {VALUES}; no sample for 4 s",
        "bar: ended: at its end",
    ]


def test_values_are_printed_at_intervals(capsys, monkeypatch):
    monkeypatch.setattr(live_lines, "_VALUES_INTERVAL_S", 0.0)
    with LiveLines([run(ends=4, error=RecordingEnd("at its end", code="recording-ended"))]) as one:
        one.follow(None)
    assert capsys.readouterr().out.splitlines() == [
        *[f"bar: trusted; {VALUES}"] * 3,
        "bar: ended: at its end",
    ]


def test_each_pose_has_a_bar_around_zero():
    bend, twist = [row.plain for row in page(run().loop.status, "bar") if "│" in row.plain]
    assert bend.index("│") == twist.index("│")
    assert "━" in bend.partition("│")[2]
    assert "━" not in bend.partition("│")[0]
    assert "━" in twist.partition("│")[0]
    assert "━" not in twist.partition("│")[2]


def test_json_reports_an_end_once(capsys, monkeypatch):
    monkeypatch.setattr(live_lines, "_JSON_INTERVAL_S", 0.0)
    first = run(
        "COM3",
        ends=2,
        error=RecordingEnd("COM3: the recording is at its end", code="recording-ended"),
    )
    second = run(
        "COM4",
        "cube",
        ends=4,
        error=RecordingEnd("COM4: the recording is at its end", code="recording-ended"),
    )
    with LiveLines([first, second], as_json=True) as lines:
        lines.follow(None)
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    by = [[r["ended"] for r in rows if r["port"] == port] for port in ("COM3", "COM4")]
    assert by[0] == [None, "COM3: the recording is at its end"]
    assert by[1] == [None, None, None, "COM4: the recording is at its end"]
    assert {r["device"] for r in rows if r["port"] == "COM4"} == {"cube"}


def test_last_error_is_raised_but_not_the_end_of_a_recording():
    end = RecordingEnd("at its end", code="recording-ended")
    with LiveLines([run(ends=1, error=end)]) as lines:
        lines.follow(None)
    several = [
        run("a", ends=1, error=CaptureError("first", code="port-disconnected")),
        run("b", ends=3, error=CaptureError("last", code="port-disconnected")),
        run("c", ends=5, error=end),
    ]
    with LiveLines(several) as lines, pytest.raises(CaptureError, match="last"):
        lines.follow(None)


def test_unexpected_error_ends_only_its_device(capsys):
    first = run("COM3", ends=2, error=np.linalg.LinAlgError("Singular matrix"))
    second = run("COM4", ends=9, error=RecordingEnd("at its end", code="recording-ended"))
    with LiveLines([first, second]) as lines, raises(LiveError, "live-loop-failed") as caught:
        lines.follow(None)
    assert caught.value.where == "bar (COM3)"
    assert second.loop.checks == 9
    assert capsys.readouterr().out.count("LinAlgError") == 1


def test_ctrl_c_prints_nothing_as_json(capsys):
    for as_json, out in ((True, ""), (False, "ended\n")):
        one = run(ends=1, error=KeyboardInterrupt())
        with LiveLines([one], as_json=as_json) as lines:
            lines.follow(None)
        assert capsys.readouterr().out == out


def test_labels_of_several_devices_contain_their_ports():
    assert labels([run("a")]) == ["bar"]
    assert labels([run("a"), run("b", "bar-2")]) == ["bar (a)", "bar-2 (b)"]


def test_page_names_the_device():
    status = LiveStatus(None, 0.0, 0.0, NONE, NONE, 0, 0, 0, ())
    assert page(status, "bar (a)")[0].plain == "bar (a): waiting for samples"
    assert page(status, "bar (a)", "COM3: is gone")[0].plain == "bar (a) ended: COM3: is gone"


def test_json_has_numbers_of_samples_and_the_lost_channel():
    lost = replace(frame(), lost_channel="cord_1")
    data = as_mapping(LiveStatus(lost, 0.0, 0.0, NONE, NONE, 100, 3, 7, ()))
    assert (data["samples"], data["skipped"], data["lost_samples"]) == (100, 3, 7)
    assert data["lost"] == "cord_1"
    assert "network" not in data


def test_network_of_a_board_is_shown():
    network = NetworkStatistics(1, 2, 3, 4, (0.01, 0.02, 0.03))
    status = LiveStatus(frame(), 100.0, 0.0, NONE, NONE, 100, 3, 7, (), network)
    assert as_mapping(status)["network"]["rejected"] == 4
    assert as_mapping(status)["network"]["network_latency_ms"] == pytest.approx(10)
    assert any("10.0 ms" in row.plain for row in page(status, "bar"))
