"""Capture sessions: recorded, cut off at any moment, resumed, processed."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.readout.recording import read_recording
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.capture.sessions.signals import resistances, synchronize_signals
from defsense_fab.capture.tracking.alignment import align
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.markers import Tracks
from defsense_fab.core.storage.session_manifest import FILE
from defsense_fab.workflow.sessions.processing import process_session
from tests.capture.sessions import capture_rig as rig
from tests.support.errors import raises
from tests.support.places import ROOT

TAGS = np.arange(6)
KILLS = int(os.environ.get("DEFSENSE_KILLS", "2"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A session whose second camera went away for a while."""
    folder = tmp_path_factory.mktemp("capture") / "session"
    session = rig.begin(folder, [("rest", 1.5), ("out", 12.0), ("rest", 1.0)])
    screen = rig.Silent()
    assert rig.record(session, screen, gone=4.0)
    return sessions.load(folder), screen


def test_recorded_data_are_complete_and_consecutive(recorded):
    session, screen = recorded
    run = session.runs[0]
    assert sessions.finished_steps(session) == [0, 1, 2]
    assert sessions.run_ending(run) == "all steps were shown"
    for name in ("cam_0", "cam_1"):
        seen = read_camera_tags(run, name, TAGS)
        assert seen.cut == 0
        assert len(seen.time) > 20
        assert (np.diff(seen.time) > 0).all()
        assert np.median(seen.tags.count) == 6
    kinds = [e["event"] for e in sessions.read_log(run)]
    assert kinds.count("step") == kinds.count("done") == 3
    assert "camera gone" in kinds
    assert "camera back" in kinds
    assert any("cam_1" in note for note in screen.notes)
    assert screen.last.tags == 6


def test_processed_in_the_rest_frame_with_signals(recorded):
    session, _ = recorded
    result = process_session(session.folder)
    q = result.quality
    assert q["aligned_by"] == "anchor"
    assert q["aligned_frames"] > 0.95
    assert q["residual"]["median"] < 0.08  # more where a busy machine shows few pictures
    # There is no LED; two tags that move for twelve seconds tell the clocks, where the machine is
    # not too busy to show them often enough.
    times = read_tracks(session.folder / "aligned.csv").time
    often = (times[-1] - times[0]) / len(times) < 0.12
    assert q["runs"][0]["sync"]["method"] in (("motion",) if often else ("motion", "arrival"))
    assert q["runs"][0]["sync"]["error_ms"] < (50 if often else 100)
    t = read_tracks(session.folder / "aligned.csv")
    t = t.select(np.isin(t.frame, result.tracks.frame))
    several = t.sigma[..., 2] < 0.3
    # The last two move at rest, too, which tilts the rest pose in the design's frame: what counts
    # is that the anchor stays.
    still = t.points[:, :4] - np.nanmedian(t.points[:, :4], axis=0)
    assert np.sqrt(np.nanmean(still[several[:, :4]] ** 2)) < 0.12
    good = np.isfinite(result.signals[:, 0]) & several[:, 4] & np.isfinite(t.points[:, 4, 2])
    assert good.sum() > 50
    together = np.corrcoef(t.points[good, 4, 2], result.signals[good, 0])[0, 1]
    assert together > 0.97
    assert len(t.time) == len(result.signals)
    assert json.loads((session.folder / "quality.json").read_text("utf-8"))["frames"] == len(t.time)
    assert "<h1>plate: session</h1>" in (session.folder / "report.html").read_text("utf-8")
    with pytest.raises(CaptureError):
        process_session(session.folder, video=True)


def test_markers_of_another_system_replace_the_cameras(tmp_path):
    session = rig.begin(tmp_path / "s", [("rest", 6.0)], seen=False)
    rig.board_alone(session, 60)
    with pytest.raises(CaptureError):
        process_session(session.folder)
    time_ = np.arange(0, 50.0, 0.02)
    moved = Rotation.from_rotvec([0.3, -0.2, 0.5])
    # The other system began 4 s after the board.
    points = np.array([moved.apply(rig.places(t + 4)) + np.array([100, 50, 900]) for t in time_])
    points[200:230, 2] = np.nan
    nothing = np.full(points.shape, np.nan)
    take = Tracks(time_, np.arange(6), points, nothing, np.arange(len(time_)))
    write_tracks(tmp_path / "take.c3d", take)
    result = process_session(session.folder, tracks=tmp_path / "take.c3d")
    sync = result.quality["runs"][0]["sync"]
    assert sync["method"] == "motion"
    assert sync["offset"] == pytest.approx(-4, abs=0.02)
    (shown,) = result.quality["runs"][0]["steps"]  # at the board's beginning, by the tracks' clock
    assert shown == [pytest.approx(-4, abs=0.03), "rest"]
    assert result.quality["residual"]["95 %"] < 0.01
    lift = result.aligned.points[:, 4, 2]
    assert np.corrcoef(lift, result.signals[:, 0])[0, 1] > 0.99
    wrong = Tracks(time_, np.arange(20, 26), points, nothing, np.arange(len(time_)))
    write_tracks(tmp_path / "wrong.trc", wrong)
    with pytest.raises(CaptureError):
        process_session(session.folder, tracks=tmp_path / "wrong.trc")


def test_videos_with_missing_frames_are_paired_by_their_times(tmp_path):
    session = rig.begin(tmp_path / "s", [("rest", 1.0), ("out", 3.0)])
    assert rig.record(session, video=True)
    whole = process_session(session.folder, video=True)
    assert not [w for r in whole.quality["runs"] for w in r["tracks"]["warnings"] if "lacks" in w]
    film = session.folder / "run-1" / "cam_0.mkv"
    data = film.read_bytes()
    late = int(0.75 * len(data))  # less than half of the frames would be refused
    for damaged, told in (
        (data[:late], True),
        (data[:late] + bytes(150_000) + data[late + 150_000 :], True),
        (data[: len(data) // 2] + bytes(200) + data[len(data) // 2 + 200 :], False),
    ):
        film.write_bytes(damaged)
        result = process_session(session.folder, video=True)
        notes = [w for r in result.quality["runs"] for w in r["tracks"]["warnings"]]
        assert bool([w for w in notes if "cam_0.mkv lacks" in w]) >= told
        k = np.clip(np.searchsorted(whole.tracks.time, result.tracks.time), 0, None)
        same = k < len(whole.tracks.time)
        # The tags that do not move: few pictures of a busy machine, and linear ways between them.
        sigma = result.tracks.sigma[same][:, :4]
        there = sigma.max(axis=2) < 0.3
        off = (result.tracks.points[same] - whole.tracks.points[k[same]])[:, :4]
        assert there.sum() > 60
        assert (np.abs(off[there]) < 0.1 + 5 * sigma[there]).all()
    film.write_bytes(data[:1000])
    with pytest.raises(CaptureError):
        process_session(session.folder, video=True)


def test_a_damaged_block_loses_only_its_lines(recorded, tmp_path):
    session, _ = recorded
    whole = process_session(session.folder)
    shutil.copytree(session.folder, tmp_path / "s")
    for name in ("cam_0.csv", "cam_1-frames.csv", sessions.BOARD, sessions.LOG):
        path = tmp_path / "s" / "run-1" / name
        data = path.read_bytes()
        at = len(data) // 2
        path.write_bytes(data[:at] + bytes(300) + data[at + 300 :])
    result = process_session(tmp_path / "s")
    assert len(result.tracks.time) > 0.9 * len(whole.tracks.time)
    told = " ".join(w for r in result.quality["runs"] for w in r["tracks"]["warnings"])
    assert "lines of run-1/cam_0's files: 1" in told
    assert f"lines of run-1/{sessions.BOARD}: 1" in told


def test_a_video_stops_before_the_disk_is_full(tmp_path, monkeypatch):
    session = rig.begin(tmp_path / "s", [("rest", 2.0)])
    monkeypatch.setattr("defsense_fab.capture.sessions.camera_recorder.MIN_FREE_BYTES", 1e18)
    with raises(StorageError, "disk-full"):
        rig.record(session, video=True)
    assert sessions.run_ending(session.runs[0]).startswith("error: ")


def test_a_board_that_restarts_is_synchronized_in_parts(tmp_path):
    session = rig.begin(tmp_path / "s", [("rest", 6.0)], seen=False)
    rig.board_alone(session, 60)
    board = read_recording(session.folder / "run-1" / sessions.BOARD)
    half = len(board.counter) // 2
    late = np.where(np.arange(len(board.counter)) < half, 0, 60_000)  # us
    again = replace(
        board, device_us=board.device_us + late,
        host_ns=board.host_ns + np.random.default_rng(0).exponential(4e6, len(late)).astype(int),
        events=(*board.events, (half, {"event": "restart"})),
    )  # fmt: skip
    time_ = np.arange(0.5, 59.5, 0.04)
    points = np.array([rig.places(t) for t in time_])
    tracks = Tracks(time_, np.arange(6), points, np.full(points.shape, 0.01), np.arange(len(time_)))
    ohm, told, clocks = synchronize_signals(session, again, [], 0, [], tracks)
    assert [p["method"] for p in told["parts"]] == ["motion", "motion"]
    assert [c.samples for c in clocks] == [slice(0, half), slice(half, len(board.counter))]
    for part in clocks:
        at = part.offset + (1 + part.drift) * again.device_us[part.samples] / 1e6
        assert at == pytest.approx(board.device_us[part.samples] / 1e6, abs=0.04)
    assert len(told["notes"]) == 1
    assert told["error_ms"] < 40
    truth, *_ = synchronize_signals(session, board, [], 0, [], tracks)
    good = np.isfinite(ohm[:, 0]) & np.isfinite(truth[:, 0])
    assert good.mean() > 0.95
    speed = np.nanmax(np.abs(np.diff(truth[:, 0]))) / 0.04
    # By what the signal changes at most in a second: as time, s.
    off = np.abs(ohm[good, 0] - truth[good, 0]).max() / speed
    as_one, *_ = synchronize_signals(
        session, replace(again, events=board.events), [], 0, [], tracks
    )
    # Back by 20 s without an event, as in a file that was put together: known all the same.
    back = replace(again, events=board.events, device_us=board.device_us - 300 * late)
    parts, about, _ = synchronize_signals(session, back, [], 0, [], tracks)
    assert len(about["parts"]) == 2
    np.testing.assert_allclose(parts[good], ohm[good], rtol=1e-3)
    # What did not arrive for a while is a pause, at which no clock jumped.
    there = np.ones(len(late), bool)
    there[half : half + 80] = False
    less = replace(
        board, **{n: getattr(board, n)[there]
                  for n in ("device_us", "host_ns", "counter", "sums", "led", "late", "averages",
                           "full_scale")},
    )  # fmt: skip
    paused, about, _ = synchronize_signals(session, less, [], 0, [], tracks)
    assert about["method"] == "motion"
    assert "parts" not in about
    rest = good & np.isfinite(paused[:, 0])
    assert 0.9 < rest.sum() / good.sum() < 0.99
    np.testing.assert_allclose(paused[rest], truth[rest], rtol=1e-3)
    both = good & np.isfinite(as_one[:, 0])
    assert off < 0.005
    assert np.abs(as_one[both, 0] - truth[both, 0]).max() / speed > 0.02


def test_each_part_of_a_run_has_its_boards_full_scale(tmp_path):
    """A board that was unplugged may be followed by another."""
    session = rig.begin(tmp_path / "s", [("rest", 6.0)], seen=False)
    rig.board_alone(session, 4)
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
        *((f'# {{"event": "start", "full_scale": {bad}}}', "full-scale-invalid")
          for bad in ('"a"', "null", "0", "-3", "NaN", "true", "[1024]")),
    ],
)  # fmt: skip
def test_a_board_without_a_full_scale(tmp_path, start, code):
    session = rig.begin(tmp_path / "s", [("rest", 6.0)], seen=False)
    rig.board_alone(session, 1)
    path = session.folder / "run-1" / sessions.BOARD
    lines = path.read_text("utf-8").splitlines()
    path.write_text("\n".join([*lines[:2], *([start] if start else []), *lines[3:]]) + "\n")
    with raises(CaptureError, code):
        resistances(session, read_recording(path))


def test_stopped_and_resumed(tmp_path):
    session = rig.begin(tmp_path / "s", [("rest", 1.0), ("out", 1.0)])
    assert not rig.record(session, rig.Silent({8: "q"}))
    assert sessions.finished_steps(session) in ([], [0])
    assert sessions.run_ending(session.runs[0]) == "stopped by the user"
    assert rig.record(session)
    assert sessions.finished_steps(session) == [0, 1]
    assert [r.name for r in session.runs] == ["run-1", "run-2"]
    with raises(CaptureError, "session-exists"):
        rig.begin(tmp_path / "s", [("rest", 1.0)])


def test_coverage_includes_earlier_runs(tmp_path):
    session = rig.begin(tmp_path / "s", [("out", 40.0)])
    screen = rig.Silent({25: "q"})
    assert not rig.record(session, screen, levels=rig.coverage())
    most, before = screen.last.reached["out"]
    assert before.sum() >= 2
    assert sorted(sessions.covered_parts(session)) == [("out", k) for k in np.flatnonzero(before)]
    again = rig.Silent({1: "q"})
    rig.record(session, again, levels=rig.coverage())
    assert (again.first.reached["out"][1] >= before).all()
    assert again.first.reached["out"][0] >= most


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path):
    """Each run is whole but for the line that was cut; the session opens and says how it ended."""
    chance = random.Random(0)
    folder = tmp_path / "s"
    cut = rows = 0
    for k in range(KILLS):
        program = subprocess.Popen(
            [sys.executable, "-m", "tests.capture.sessions.capture_rig", str(folder)],
            cwd=ROOT,
        )
        until = time.monotonic() + 90
        written = folder / f"run-{k + 1}" / "cam_1.csv"
        while time.monotonic() < until and not (written.exists() and written.stat().st_size > 2000):
            time.sleep(0.02)
        time.sleep(chance.uniform(0, 1.5))
        program.send_signal(signal.SIGKILL)
        program.wait()
        session = sessions.load(folder)
        run = session.runs[-1]
        assert "cut off" in sessions.run_ending(run)
        for name in ("cam_0", "cam_1"):
            frames = np.loadtxt(
                (run / f"{name}-frames.csv").read_text("utf-8").splitlines()[1:-1],
                delimiter=",",
                ndmin=2,
            )
            assert (frames[:, 0] == np.arange(len(frames))).all()
            seen = read_camera_tags(run, name, TAGS)
            assert seen.cut <= 2
            cut += seen.cut
            rows += len(seen.time)
            assert np.median(seen.tags.count[:-1]) == 6
    assert rows > 10 * KILLS
    result = process_session(folder)
    assert len(result.quality["runs"]) == KILLS
    assert all("cut off" in r["ended"] for r in result.quality["runs"])


def test_invalid_sessions_are_refused(tmp_path):
    with pytest.raises(CaptureError):
        sessions.load(tmp_path)
    session = rig.begin(tmp_path / "s", [("rest", 1.0)])
    with pytest.raises(CaptureError):
        process_session(session.folder)
    run = session.folder / "run-1"
    run.mkdir()
    (run / sessions.LOG).write_text('{"event": "start"}\nnonsense\n')
    with raises(CaptureError, "event-invalid", line=2):
        sessions.read_log(run)
    (run / "cam_0-frames.csv").write_text(
        "frame,host_ns,lamp\n0,x,1\n1,5,1\n2,4,1\n3,9,1\n4,10,1\n"
    )
    (run / "cam_0.csv").write_text(",".join(sessions.TAG_COLUMNS) + "\n")
    damaged = read_camera_tags(run, "cam_0", TAGS)
    assert damaged.cut == 2
    assert damaged.time[-2:].tolist() == [9, 10]
    (run / "cam_0-frames.csv").write_text("frame,ns\n")
    with raises(CaptureError, "header-wrong", line=1):
        read_camera_tags(run, "cam_0", TAGS)
    (session.folder / FILE).write_text("{}")
    with pytest.raises(CaptureError):
        sessions.load(session.folder)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_an_error():
    with pytest.raises(StorageError):
        sessions.Stream(Path("/dev/full"), ("a",))


def test_a_closed_stream_does_not_write_to_another_file(tmp_path):
    """The system gives a closed file's descriptor to the next one that is opened."""
    stream = sessions.Stream(tmp_path / "x.csv", ("a",))
    stream.close()
    with (tmp_path / "other").open("wb", buffering=0) as other:
        with pytest.raises(StorageError):
            stream.line("1")
        other.write(b"mine")
    stream.close()
    assert (tmp_path / "other").read_bytes() == b"mine"


def test_only_empty_sessions_are_discarded(tmp_path):
    session = rig.begin(tmp_path / "s", [("rest", 6.0)], seen=False)
    other = session.folder / "run-old"
    other.mkdir()
    (other / "thesis.csv").write_text("mine\n")
    rig.board_alone(session, 2)
    sessions.discard_empty(session)
    assert (session.folder / "run-1" / sessions.BOARD).exists()
    (session.folder / "run-1" / sessions.BOARD).write_text("# nothing\n")
    sessions.discard_empty(session)
    assert not (session.folder / "run-1").exists()
    assert not (session.folder / FILE).exists()
    assert (other / "thesis.csv").exists()


def test_a_camera_without_data_leaves_the_other(recorded, tmp_path):
    session, _ = recorded
    folder = tmp_path / "s"
    shutil.copytree(session.folder, folder)
    broken = folder / "run-2"
    shutil.copytree(folder / "run-1", broken)
    (broken / "cam_1-frames.csv").write_text(",".join(sessions.FRAME_COLUMNS) + "\n")
    result = process_session(folder)
    assert [r["run"] for r in result.quality["runs"]] == ["run-1", "run-2"]
    warnings = result.quality["runs"][1]["tracks"]["warnings"]
    assert [w for w in warnings if "run-2 is processed without cam_1" in w]
    (broken / "cam_0-frames.csv").unlink()
    result = process_session(folder)
    assert [r["run"] for r in result.quality["runs"]] == ["run-1"]
    assert "no picture was recorded by cam_1" in result.quality["skipped"][0]["why"]
    assert "cam_0-frames.csv: cannot be read" in result.quality["skipped"][0]["why"]
    (folder / sessions.CAMERAS).unlink()
    with pytest.raises(CaptureError):
        process_session(folder)


def test_the_test_rig_is_rigid():
    there = align(rig.places(0.3)[None], rig.CENTERS, mask=np.arange(6) < 4)
    assert there.residual[0] < 1e-9


def test_a_session_described_in_toml_is_read(tmp_path):
    """As sessions were written before they had the same format as those on the specimen."""
    session = rig.begin(tmp_path / "s", [("rest", 1.0), ("out", 1.5)])
    lines = ["schema = 1", f'device = "{session.device}"', 'begun = "2026-01-02T03:04:05+0000"',
             f"channels = {json.dumps(session.channels)}", f"reference = {list(session.reference)}",
             'steps = [["rest", 1.0], ["out", 1.5]]']  # fmt: skip
    (session.folder / "session.toml").write_text("\n".join(lines))
    (session.folder / FILE).unlink()
    found = sessions.load(session.folder)
    assert (found.steps, found.channels) == (session.steps, session.channels)
    assert found.reference == session.reference
    with raises(CaptureError, "session-exists"):
        rig.begin(tmp_path / "s", [("rest", 1.0)])
