"""Capture sessions are recorded, cut off at any moment, resumed and processed."""

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
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.capture.tracking.alignment import align
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.guided_parts import Bars, Picture
from defsense_fab.core.markers import Tracks
from defsense_fab.core.storage.session_manifest import FILE
from defsense_fab.workflow.sessions.options import ProcessOptions
from defsense_fab.workflow.sessions.processing import process_session
from tests.capture.sessions import capture_rig as rig
from tests.support.errors import raises
from tests.support.places import ROOT

pytestmark = pytest.mark.slow

TAGS = np.arange(6)
FROM_VIDEO = ProcessOptions(from_video=True)
KILLS = int(os.environ.get("DEFSENSE_KILLS", "2"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A session whose second camera was disconnected for a while."""
    folder = tmp_path_factory.mktemp("capture") / "session"
    session = rig.create_session(folder, [("rest", 1.5), ("out", 12.0), ("rest", 1.0)])
    screen = rig.Silent()
    assert rig.record(session, screen, disconnected_at=4.0)
    return sessions.load(folder), screen


def test_recorded_data_are_complete_and_consecutive(recorded):
    session, screen = recorded
    run = session.runs[0]
    assert sessions.finished_steps(session) == [0, 1, 2]
    assert sessions.run_ending(run) == "all steps were shown"
    for name in ("cam_0", "cam_1"):
        recording = read_camera_tags(run, name, TAGS)
        assert recording.cut == 0
        assert len(recording.time) > 20
        assert (np.diff(recording.time) > 0).all()
        assert np.median(recording.tags.count) == 6
    kinds = [e["event"] for e in sessions.read_log(run)]
    assert kinds.count("step") == kinds.count("done") == 3
    assert "camera gone" in kinds
    assert "camera back" in kinds
    assert ("camera-disconnected", "cam_1") in screen.notes
    pictures = [part for part in screen.last.parts if isinstance(part, Picture)]
    assert {label for picture in pictures for label in picture.labels} == set(map(str, TAGS))


def test_tracks_in_the_rest_frame_agree_with_the_signals(recorded):
    session, _ = recorded
    result = process_session(session.folder)
    quality = result.quality
    assert quality["aligned_by"] == "anchor"
    assert quality["aligned_frames"] > 0.95
    assert quality["residual"]["median"] < 0.08  # higher on a busy machine with few images
    tracks = read_tracks(session.folder / "aligned.csv")
    # There is no LED. The motion of two tags for twelve seconds synchronizes the clocks, unless the
    # machine is too busy to record them often enough.
    is_frequent = (tracks.time[-1] - tracks.time[0]) / len(tracks.time) < 0.12
    sync = quality["runs"][0]["sync"]
    assert sync["method"] in (("motion",) if is_frequent else ("motion", "arrival"))
    assert sync["error_ms"] < (50 if is_frequent else 100)
    tracks = tracks.select(np.isin(tracks.frame, result.tracks.frame))
    is_accurate = tracks.sigma[..., 2] < 0.3
    # The last two tags move at rest, too, which tilts the rest pose in the design's frame. The
    # anchor must not move.
    deviation = tracks.points[:, :4] - np.nanmedian(tracks.points[:, :4], axis=0)
    assert np.sqrt(np.nanmean(deviation[is_accurate[:, :4]] ** 2)) < 0.12
    lift, signal = tracks.points[:, 4, 2], result.signals[:, 0]
    good = np.isfinite(signal) & is_accurate[:, 4] & np.isfinite(lift)
    assert good.sum() > 50
    assert np.corrcoef(lift[good], signal[good])[0, 1] > 0.97
    assert len(tracks.time) == len(result.signals)
    saved = json.loads((session.folder / "quality.json").read_text("utf-8"))
    assert saved["frames"] == len(tracks.time)
    assert "<h1>plate: session</h1>" in (session.folder / "report.html").read_text("utf-8")


def test_session_without_videos_is_not_processed_from_them(recorded):
    session, _ = recorded
    with raises(CaptureError, "session-unusable", codes=["video-missing"]):
        process_session(session.folder, FROM_VIDEO)


CAPTURE_DELAY_S = 4.0  # between the starts of the board and of the motion-capture system


@pytest.fixture
def take():
    """Tracks of a motion-capture system in a frame of its own."""
    time_ = np.arange(0, 50.0, 0.02)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5])
    points = np.array(
        [
            turn.apply(rig.marker_positions(t + CAPTURE_DELAY_S)) + np.array([100, 50, 900])
            for t in time_
        ]
    )
    points[200:230, 2] = np.nan
    return Tracks(time_, TAGS, points, np.full(points.shape, np.nan), np.arange(len(time_)))


@pytest.fixture
def board_session(tmp_path):
    """A session with a read-out board for a minute, and without cameras."""
    return rig.record_board_session(tmp_path / "s", 60)


def test_markers_of_another_system_replace_the_cameras(board_session, take, tmp_path):
    write_tracks(tmp_path / "take.c3d", take)
    result = process_session(board_session.folder, ProcessOptions(tracks=tmp_path / "take.c3d"))
    sync = result.quality["runs"][0]["sync"]
    assert sync["method"] == "motion"
    assert sync["offset"] == pytest.approx(-CAPTURE_DELAY_S, abs=0.02)
    (step,) = result.quality["runs"][0]["steps"]  # at the board's start, by the tracks' clock
    assert step == [pytest.approx(-CAPTURE_DELAY_S, abs=0.03), "rest"]
    assert result.quality["residual"]["95 %"] < 0.01
    lift = result.aligned.points[:, 4, 2]
    assert np.corrcoef(lift, result.signals[:, 0])[0, 1] > 0.99


def test_session_without_cameras_needs_tracks(board_session):
    with raises(CaptureError, "session-unusable", codes=["calibration-missing"]):
        process_session(board_session.folder)


def test_tracks_of_another_device_are_rejected(board_session, take, tmp_path):
    write_tracks(tmp_path / "other.trc", replace(take, ids=TAGS + 20))
    with raises(CaptureError, "session-unusable", codes=["markers-of-another-device"]):
        process_session(board_session.folder, ProcessOptions(tracks=tmp_path / "other.trc"))


def track_warnings(result):
    """Return the codes of the warnings about the tracks of all runs."""
    return [w.code for run in result.quality["runs"] for w in run["tracks"]["warnings"]]


def test_videos_with_missing_frames_are_paired_by_their_times(tmp_path):
    session = rig.create_session(tmp_path / "s", [("rest", 1.0), ("out", 3.0)])
    assert rig.record(session, video=True)
    whole = process_session(session.folder, FROM_VIDEO)
    assert "frames-missing-in-video" not in track_warnings(whole)
    path = session.folder / "run-1" / "cam_0.mkv"
    data = path.read_bytes()
    middle, late = len(data) // 2, int(0.75 * len(data))
    for damaged, lacks_frames in (
        (data[:late], True),
        (data[:late] + bytes(150_000) + data[late + 150_000 :], True),
        (data[:middle] + bytes(200) + data[middle + 200 :], False),
    ):
        path.write_bytes(damaged)
        result = process_session(session.folder, FROM_VIDEO)
        assert ("frames-missing-in-video" in track_warnings(result)) >= lacks_frames
        k = np.clip(np.searchsorted(whole.tracks.time, result.tracks.time), 0, None)
        is_common = k < len(whole.tracks.time)
        # Only tags that do not move: a busy machine records few images.
        sigma = result.tracks.sigma[is_common][:, :4]
        error = (result.tracks.points[is_common] - whole.tracks.points[k[is_common]])[:, :4]
        is_accurate = sigma.max(axis=2) < 0.3
        assert is_accurate.sum() > 60
        assert (np.abs(error[is_accurate]) < 0.1 + 5 * sigma[is_accurate]).all()


def test_video_with_less_than_half_of_the_frames_is_rejected(tmp_path):
    session = rig.create_session(tmp_path / "s", [("rest", 1.0)])
    assert rig.record(session, video=True)
    path = session.folder / "run-1" / "cam_0.mkv"
    path.write_bytes(path.read_bytes()[:1000])
    with raises(CaptureError, "session-unusable"):
        process_session(session.folder, FROM_VIDEO)


def test_damaged_block_loses_only_its_lines(recorded, tmp_path):
    session, _ = recorded
    whole = process_session(session.folder)
    shutil.copytree(session.folder, tmp_path / "s")
    for name in ("cam_0.csv", "cam_1-frames.csv", sessions.BOARD, sessions.LOG):
        path = tmp_path / "s" / "run-1" / name
        data = path.read_bytes()
        middle = len(data) // 2
        path.write_bytes(data[:middle] + bytes(300) + data[middle + 300 :])
    result = process_session(tmp_path / "s")
    assert len(result.tracks.time) > 0.9 * len(whole.tracks.time)
    assert track_warnings(result).count("lines-damaged") == 1
    assert result.quality["runs"][0]["cut"] >= 2


def test_video_stops_before_the_disk_is_full(tmp_path, monkeypatch):
    session = rig.create_session(tmp_path / "s", [("rest", 2.0)])
    monkeypatch.setattr("defsense_fab.capture.sessions.camera_recorder.MIN_FREE_BYTES", 1e18)
    with raises(StorageError, "disk-full"):
        rig.record(session, video=True)
    assert sessions.run_ending(session.runs[0]).startswith("error: ")


def test_stopped_session_is_resumed(tmp_path):
    session = rig.create_session(tmp_path / "s", [("rest", 1.0), ("out", 1.0)])
    assert not rig.record(session, rig.Silent({3: "q"}))
    assert sessions.finished_steps(session) in ([], [0])
    assert sessions.run_ending(session.runs[0]) == "stopped by the user"
    assert rig.record(session)
    assert sessions.finished_steps(session) == [0, 1]
    assert [r.name for r in session.runs] == ["run-1", "run-2"]
    with raises(CaptureError, "session-exists"):
        rig.create_session(tmp_path / "s", [("rest", 1.0)])


def covered(view):
    """Return which parts of the way to the pose `out` a view shows as recorded."""
    (bars,) = [p for p in view.parts if isinstance(p, Bars) and p.names == ("out",)]
    return bars.values[0] > 0


def test_coverage_includes_earlier_runs(tmp_path):
    session = rig.create_session(tmp_path / "s", [("out", 40.0)])
    screen = rig.Silent({25: "q"})
    assert not rig.record(session, screen, levels=rig.coverage())
    before = covered(screen.last)
    assert before.sum() >= 2
    assert sorted(sessions.covered_parts(session)) == [("out", k) for k in np.flatnonzero(before)]
    again = rig.Silent({1: "q"})
    rig.record(session, again, levels=rig.coverage())
    assert (covered(again.first) >= before).all()


def test_session_that_is_killed_at_any_moment_stays_readable(tmp_path):
    """Each run is complete except for the line that was cut."""
    rng = random.Random(0)
    folder = tmp_path / "s"
    rows = 0
    for k in range(KILLS):
        program = subprocess.Popen(
            [sys.executable, "-m", "tests.capture.sessions.capture_rig", str(folder)],
            cwd=ROOT,
        )
        end = time.monotonic() + 240
        file = folder / f"run-{k + 1}" / "cam_1.csv"
        while time.monotonic() < end and not (file.exists() and file.stat().st_size > 2000):
            time.sleep(0.02)
        time.sleep(rng.uniform(0, 1.5))
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
            recording = read_camera_tags(run, name, TAGS)
            assert recording.cut <= 2
            rows += len(recording.time)
            assert np.median(recording.tags.count[:-1]) == 6
    assert rows > 10 * KILLS
    result = process_session(folder)
    assert len(result.quality["runs"]) == KILLS
    assert all("cut off" in run["ended"] for run in result.quality["runs"])


def test_session_without_runs_is_rejected(tmp_path):
    session = rig.create_session(tmp_path / "s", [("rest", 1.0)])
    with raises(CaptureError, "session-empty"):
        process_session(session.folder)


def test_invalid_sessions_are_rejected(tmp_path):
    with pytest.raises(CaptureError):
        sessions.load(tmp_path)
    session = rig.create_session(tmp_path / "s", [("rest", 1.0)])
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
def test_full_disk_is_an_error():
    with pytest.raises(StorageError):
        sessions.Stream(Path("/dev/full"), ("a",))


def test_closed_stream_does_not_write_to_another_file(tmp_path):
    """The system reuses the descriptor of a closed file for the next one that is opened."""
    stream = sessions.Stream(tmp_path / "x.csv", ("a",))
    stream.close()
    with (tmp_path / "other").open("wb", buffering=0) as other:
        with pytest.raises(StorageError):
            stream.line("1")
        other.write(b"unrelated")
    stream.close()
    assert (tmp_path / "other").read_bytes() == b"unrelated"


def test_only_empty_sessions_are_discarded(tmp_path):
    session = rig.create_session(tmp_path / "s", [("rest", 6.0)], has_cameras=False)
    other = session.folder / "run-old"
    other.mkdir()
    (other / "notes.csv").write_text("unrelated\n")
    rig.record_board(session, 2)
    sessions.discard_empty(session)
    assert (session.folder / "run-1" / sessions.BOARD).exists()
    (session.folder / "run-1" / sessions.BOARD).write_text("# nothing\n")
    sessions.discard_empty(session)
    assert not (session.folder / "run-1").exists()
    assert not (session.folder / FILE).exists()
    assert (other / "notes.csv").exists()


def test_camera_without_data_is_left_out(recorded, tmp_path):
    session, _ = recorded
    folder = tmp_path / "s"
    shutil.copytree(session.folder, folder)
    broken = folder / "run-2"
    shutil.copytree(folder / "run-1", broken)
    (broken / "cam_1-frames.csv").write_text(",".join(sessions.FRAME_COLUMNS) + "\n")
    result = process_session(folder)
    assert [run["run"] for run in result.quality["runs"]] == ["run-1", "run-2"]
    warnings = result.quality["runs"][1]["tracks"]["warnings"]
    assert "camera-left-out" in [w.code for w in warnings]
    (broken / "cam_0-frames.csv").unlink()
    result = process_session(folder)
    assert [run["run"] for run in result.quality["runs"]] == ["run-1"]
    assert [(s["run"], s["code"]) for s in result.quality["skipped"]] == [
        ("run-2", "recordings-unusable")
    ]


def test_session_without_its_calibration_is_rejected(recorded, tmp_path):
    shutil.copytree(recorded[0].folder, tmp_path / "s")
    (tmp_path / "s" / sessions.CAMERAS).unlink()
    with raises(CaptureError, "session-unusable", codes=["calibration-missing"]):
        process_session(tmp_path / "s")


def test_points_of_the_rig_move_rigidly():
    aligned = align(rig.marker_positions(0.3)[None], rig.CENTERS, mask=np.arange(6) < 4)
    assert aligned.residual[0] < 1e-9
