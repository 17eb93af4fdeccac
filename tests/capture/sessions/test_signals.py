"""Signals of a session whose board restarts, pauses or is replaced."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.readout.recording import read_recording
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.signals import resistances, synchronize_signals
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Tracks
from tests.capture.sessions import capture_rig as rig
from tests.support.errors import raises

TAGS = np.arange(6)


@pytest.fixture
def restarted(tmp_path):
    """A session, its recording, the same after a restart of the board, and tracks."""
    session = rig.record_board_session(tmp_path / "s", 60)
    board = read_recording(session.folder / "run-1" / sessions.BOARD)
    half = len(board.counter) // 2
    jump_us = np.where(np.arange(len(board.counter)) < half, 0, 60_000)
    arrival_delay = np.random.default_rng(0).exponential(4e6, len(jump_us)).astype(int)
    again = replace(
        board,
        device_us=board.device_us + jump_us,
        host_ns=board.host_ns + arrival_delay,
        events=(*board.events, (half, {"event": "restart"})),
    )
    time_ = np.arange(0.5, 59.5, 0.04)
    points = np.array([rig.marker_positions(t) for t in time_])
    tracks = Tracks(time_, TAGS, points, np.full(points.shape, 0.01), np.arange(len(time_)))
    return session, board, again, tracks


def synchronize(session, recording, tracks):
    return synchronize_signals(session, recording, [], 0, [], tracks)


def test_board_that_restarts_is_synchronized_in_parts(restarted):
    session, board, again, tracks = restarted
    half = len(board.counter) // 2
    ohm, record, clocks = synchronize(session, again, tracks)
    assert [part["method"] for part in record["parts"]] == ["motion", "motion"]
    assert [c.samples for c in clocks] == [slice(0, half), slice(half, len(board.counter))]
    for part in clocks:
        time_ = part.offset + (1 + part.drift) * again.device_us[part.samples] / 1e6
        assert time_ == pytest.approx(board.device_us[part.samples] / 1e6, abs=0.04)
    assert len(record["notes"]) == 1
    assert record["error_ms"] < 40
    truth, *_ = synchronize(session, board, tracks)
    good = np.isfinite(ohm[:, 0]) & np.isfinite(truth[:, 0])
    assert good.mean() > 0.95
    max_rate = np.nanmax(np.abs(np.diff(truth[:, 0]))) / 0.04  # ohm/s
    assert np.abs(ohm[good, 0] - truth[good, 0]).max() / max_rate < 0.005  # s
    as_one, *_ = synchronize(session, replace(again, events=board.events), tracks)
    both = good & np.isfinite(as_one[:, 0])
    assert np.abs(as_one[both, 0] - truth[both, 0]).max() / max_rate > 0.02


def test_clock_that_jumps_back_without_an_event_is_detected(restarted):
    session, board, again, tracks = restarted
    ohm, *_ = synchronize(session, again, tracks)
    jump_us = again.device_us - board.device_us
    jumped = replace(again, events=board.events, device_us=board.device_us - 300 * jump_us)
    by_parts, record, _ = synchronize(session, jumped, tracks)
    assert len(record["parts"]) == 2
    good = np.isfinite(ohm[:, 0])
    np.testing.assert_allclose(by_parts[good], ohm[good], rtol=1e-3)


def test_pause_of_the_samples_is_not_a_jump_of_the_clock(restarted):
    session, board, _, tracks = restarted
    truth, *_ = synchronize(session, board, tracks)
    has_arrived = np.ones(len(board.counter), bool)
    has_arrived[len(has_arrived) // 2 :][:80] = False
    names = ("device_us", "host_ns", "counter", "sums", "led", "late", "averages", "full_scale")
    paused = replace(board, **{name: getattr(board, name)[has_arrived] for name in names})
    ohm, record, _ = synchronize(session, paused, tracks)
    assert record["method"] == "motion"
    assert "parts" not in record
    good = np.isfinite(truth[:, 0])
    both = good & np.isfinite(ohm[:, 0])
    assert 0.9 < both.sum() / good.sum() < 0.99
    np.testing.assert_allclose(ohm[both], truth[both], rtol=1e-3)


def test_each_part_of_a_run_has_the_full_scale_of_its_board(tmp_path):
    """Another board may replace the first one during a run."""
    session = rig.record_board_session(tmp_path / "s", 4)
    path = session.folder / "run-1" / sessions.BOARD
    lines = path.read_text("utf-8").splitlines()
    whole = read_recording(path)
    half = 3 + len(whole.counter) // 2
    later = [line.split(",") for line in lines[half:]]
    doubled = [",".join([*c[:6], *(str(2 * int(s)) for s in c[6:])]) for c in later]
    resumed = '# {"event": "resumed", "full_scale": 2048}'
    path.write_text("\n".join([*lines[:half], resumed, *doubled]) + "\n")
    ohm = resistances(session, read_recording(path))
    np.testing.assert_allclose(ohm, resistances(session, whole))


@pytest.mark.parametrize(
    ("start", "code"),
    [
        (None, "full-scale-unknown"),
        ('# {"event": "gap"}', "full-scale-unknown"),
        *(
            (f'# {{"event": "start", "full_scale": {bad}}}', "full-scale-invalid")
            for bad in ('"a"', "null", "0", "-3", "NaN", "true", "[1024]")
        ),
    ],
)
def test_board_without_a_valid_full_scale_is_rejected(tmp_path, start, code):
    session = rig.record_board_session(tmp_path / "s", 1)
    path = session.folder / "run-1" / sessions.BOARD
    lines = path.read_text("utf-8").splitlines()
    path.write_text("\n".join([*lines[:2], *([start] if start else []), *lines[3:]]) + "\n")
    with raises(CaptureError, code):
        resistances(session, read_recording(path))
