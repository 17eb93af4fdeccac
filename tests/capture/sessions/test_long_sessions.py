"""Sessions of several runs and long ones: drift of cords between runs, tags read in blocks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.sessions import recorded_tags, results
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.workflow.sessions.processing import process_session
from tests.support import memory

SECONDS = 20.0
MAX_MB_PER_MINUTE = 8.0  # an hour, and the memory of any duration, must fit in 1 GB


def recorded(folder, *runs):
    """Return a session with two cameras and runs with these settings."""
    session = memory.create(folder, 2, 12)
    for k, settings in enumerate(runs):
        memory.record(session, SECONDS, np.random.default_rng(k), **settings)
    return session


def at_rest(result, run):
    """Return the signals (t, c) of a run while the device rests."""
    starts = np.flatnonzero(np.diff(result.tracks.time, prepend=-10.0) > 0.5)
    time = result.tracks.time - result.tracks.time[starts[run]]
    signals = result.signals[(time > 0.5) & (time < memory.RESTS - 0.5)]
    return signals[np.isfinite(signals).all(axis=1)]


@pytest.mark.slow
def test_cords_that_drift_between_runs_are_zero_at_rest_in_both(tmp_path):
    session = recorded(tmp_path / "s", {"ohm": 1200.0}, {"ohm": 1260.0})
    result = process_session(session.folder)
    for run in range(2):
        rest = at_rest(result, run)
        assert len(rest) > 50
        assert np.abs(rest).max() < 1e-3
    assert result.signals[np.isfinite(result.signals[:, 0]), 0].max() > 0.05
    R0 = json.loads((session.folder / "quality.json").read_text("utf-8"))["R0"]
    assert R0["run-1"] == pytest.approx([1200.0] * 4, rel=1e-3)
    assert R0["run-2"] == pytest.approx([1260.0] * 4, rel=1e-3)
    assert not [w for w in result.quality["warnings"] if "R0" in w]


@pytest.mark.slow
def test_runs_of_different_rates_are_reported(tmp_path, monkeypatch):
    session = recorded(tmp_path / "s", {})
    monkeypatch.setattr(memory, "RATE", 25.0)
    memory.record(session, SECONDS, np.random.default_rng(1))
    result = process_session(session.folder)
    (warning,) = [w for w in result.quality["warnings"] if "rates" in w]
    assert "(30, 25 Hz)" in warning
    assert result.quality["rate"] is None


@pytest.mark.slow
def test_run_without_rest_uses_the_nearest_rest_with_a_warning(tmp_path):
    session = recorded(
        tmp_path / "s", {"ohm": 1200.0}, {"ohm": 1230.0}, {"ohm": 1260.0, "rests": False}
    )
    result = process_session(session.folder)
    R0 = result.quality["R0"]
    assert R0["run-3"] == R0["run-2"]
    assert R0["run-1"] != R0["run-2"]
    assert at_rest(result, 2) == pytest.approx(1260 / 1230 - 1, abs=2e-3)
    assert [w for w in result.quality["warnings"] if "R0 is that of run-2" in w and "run-3" in w]


@pytest.mark.slow
def test_all_samples_have_times_of_the_tracks_clock(tmp_path, monkeypatch):
    """The read-out boards of two runs started at different times; the LED is in view."""
    session = recorded(tmp_path / "s", {"led": True}, {"led": True, "ohm": 1260.0})
    for k, run in enumerate(session.runs):
        head = (run / sessions.BOARD).read_text("utf-8").splitlines()
        rows = [line.split(",") for line in head[3:]]
        rows = [",".join([r[0], str(int(r[1]) + 3_000_000 * k), *r[2:]]) for r in rows]
        (run / sessions.BOARD).write_text("\n".join([*head[:3], *rows, ""]))
    result = process_session(session.folder)
    path = session.folder / "samples.csv"
    whole = path.read_text("utf-8")
    names = "run,counter,device_us,time,a,b,c,d,a_ohm,b_ohm,c_ohm,d_ohm"
    assert whole.splitlines()[0] == names
    starts = result.tracks.time[np.diff(result.tracks.time, prepend=-10.0) > 0.5]
    lines = [line.split(",") for line in whole.splitlines()[1:]]
    for k, (name, start) in enumerate(zip(("run-1", "run-2"), starts, strict=True)):
        rows = np.array([line[1:] for line in lines if line[0] == name], float)
        assert rows[:, 0].tolist() == list(range(int(SECONDS * memory.BOARD_RATE)))
        t = rows[:, 0] / memory.BOARD_RATE
        assert rows[:, 1] == pytest.approx(1e6 * t + 3e6 * k, abs=1)
        # Half a sample, by which the LED's flag may be late.
        assert rows[:, 2] == pytest.approx(start + t, abs=0.6 / memory.BOARD_RATE)
        assert rows[:, 3] == pytest.approx(memory.GAINS[0] * memory.level(t, SECONDS), abs=2e-3)
        ohm = (1260.0 if k else 1200.0) * (1 + rows[:, 3])
        assert rows[:, 7] == pytest.approx(ohm, rel=1e-3)
    # At the frames' times the samples agree with the signals.
    table = np.array([[float(x or "nan") for x in line[3:]] for line in lines])
    good = np.isfinite(result.signals[:, 0])
    between = np.interp(result.tracks.time, table[:, 0], table[:, 1])
    assert between[good] == pytest.approx(result.signals[good, 0], abs=1e-5)
    # The size of the blocks does not matter. Without clocks the file is removed.
    monkeypatch.setattr(results, "BLOCK_SAMPLES", 777)
    write = (path, session, result.clocks, result.quality["R0"])
    results.write_samples(*write)
    assert path.read_text("utf-8") == whole
    results.write_samples(path, session, {"run-1": []}, result.quality["R0"])
    assert path.read_text("utf-8").splitlines()[1].startswith("run-1,0,0,,0.0")  # without a time
    results.write_samples(path, session, {}, {})
    assert not path.exists()


@pytest.mark.slow
@pytest.mark.parametrize(("printed", "is_warned"), [(0.97, True), (1.0, False)])
def test_two_cameras_detect_tags_of_another_size(tmp_path, monkeypatch, printed, is_warned):
    side = memory.SIDE
    session = memory.create(tmp_path / "s", 2, 12)
    monkeypatch.setattr(memory, "SIDE", printed * side)
    memory.record(session, SECONDS, np.random.default_rng(0))
    result = process_session(session.folder)
    tracks = result.quality["runs"][0]["tracks"]
    assert tracks["tag_size"] == side
    assert tracks["size"] == pytest.approx(printed * side, abs=0.02)
    assert abs(tracks["size"] - printed * side) < 4 * tracks["size_sigma"] + 0.005
    assert 0 < tracks["size_sigma"] < 0.02
    warnings = [w for w in tracks["warnings"] if w.code == "tag-size-wrong"]
    assert len(warnings) == is_warned
    if is_warned:
        assert "14.55 mm" in warnings[0]
        assert "14.55 mm" in (session.folder / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_one_camera_cannot_measure_the_size(tmp_path, monkeypatch):
    session = memory.create(tmp_path / "s", 1, 12)
    monkeypatch.setattr(memory, "SIDE", 0.97 * memory.SIDE)
    memory.record(session, SECONDS, np.random.default_rng(0))
    tracks = process_session(session.folder).quality["runs"][0]["tracks"]
    assert tracks["size"] is None
    assert "tag-size-wrong" not in [w.code for w in tracks["warnings"]]


@pytest.mark.slow
def test_frames_that_a_camera_dropped_are_the_same_in_all_formats(tmp_path):
    """Six of ten frames are dropped in two runs, and a tag is never visible."""
    session = recorded(tmp_path / "s", {}, {})
    rng = np.random.default_rng(4)
    frame_counts = []
    for run in session.runs:
        for name in ("cam_0.csv", "cam_1.csv"):
            head, *lines = (run / name).read_text("utf-8").splitlines()
            lines = [line for line in lines if line.split(",")[2] != "3"]
            (run / name).write_text("\n".join([head, *lines, ""]))
        drop = {str(k) for k in rng.choice(np.arange(1, 599), 360, replace=False)}
        for name in ("cam_0-frames.csv", "cam_0.csv"):
            head, *lines = (run / name).read_text("utf-8").splitlines()
            lines = [line for line in lines if line.split(",")[0] not in drop]
            (run / name).write_text("\n".join([head, *lines, ""]))
        frame_counts.append(600 - len(drop))
    result = process_session(session.folder)
    q = result.quality
    assert (q["frames"], q["dropped"]) == (sum(frame_counts), 720)
    assert q["rate"] == pytest.approx(30, rel=1e-4)
    whole = read_tracks(session.folder / "aligned.csv")
    assert len(whole.time) == sum(frame_counts) + 720 + 29  # a second between the runs
    assert whole.ids.tolist() == list(range(12))
    for suffix in (".c3d", ".trc", ".npz", ".parquet"):
        written = write_tracks(tmp_path / f"a{suffix}", result.aligned)
        assert written.rate == pytest.approx(q["rate"])
        tracks = read_tracks(tmp_path / f"a{suffix}")
        assert tracks.frame.tolist() == whole.frame.tolist()
        assert tracks.ids.tolist() == whole.ids.tolist()
        np.testing.assert_allclose(tracks.time, whole.time, atol=1e-4)
        np.testing.assert_allclose(tracks.points, whole.points, atol=1e-4)
    signals = np.genfromtxt(session.folder / "signals.csv", delimiter=",", names=True)
    assert signals["frame"].tolist() == whole.frame.tolist()
    np.testing.assert_allclose(signals["time"], whole.time, atol=1e-5)
    is_recorded = np.isin(whole.frame, result.tracks.frame)
    np.testing.assert_allclose(signals["a"][is_recorded], result.signals[:, 0], atol=1e-6)
    assert np.isnan(signals["a"][~is_recorded]).all()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads the memory from Linux")
def test_memory_grows_little_with_duration(tmp_path):
    """An hour of six cameras must fit in 1 GB (`tests/support/memory.py`).

    Imports take 190 MB of it, and the work on any duration 200 MB.
    """
    peaks_mb = []
    for minutes in (0.5, 1.5):
        session = memory.create(tmp_path / f"{minutes}", 6, 20)
        memory.record(session, 60 * minutes, np.random.default_rng(1))
        measured = memory.measure(session.folder)
        peaks_mb.append(measured.peak - measured.imports)
    assert peaks_mb[0] < 250
    assert peaks_mb[1] - peaks_mb[0] < MAX_MB_PER_MINUTE


def test_recorded_tags_belong_to_their_frames(tmp_path, monkeypatch):
    """The size of the blocks, a damaged frame number and tags of no frame do not matter."""
    session = memory.create(tmp_path / "s", 1, 12)
    run = memory.record(session, 11.0, np.random.default_rng(1))
    ids = session.markers.ids[:10]
    path = run / "cam_0.csv"
    frames = np.loadtxt(run / "cam_0-frames.csv", delimiter=",", skiprows=1)
    whole = np.loadtxt(path, delimiter=",", skiprows=1)
    whole = whole[np.isin(whole[:, 2], ids)]
    lines = path.read_text("utf-8").split("\n")
    lines[40] = "999" + lines[40]
    path.write_text("\n".join([*lines[:-1], "12345,1"]))
    for size in (1 << 22, 300):
        monkeypatch.setattr(recorded_tags, "BLOCK_BYTES", size)
        recording = read_camera_tags(run, "cam_0", ids)
        assert recording.cut == 1
        np.testing.assert_array_equal(recording.time, frames[:, 1])
        expected = (whole[:, 0] == frames[:, :1]).sum(axis=1)
        differing = np.flatnonzero(recording.tags.count != expected)
        assert len(differing) == 1
        assert recording.tags.count[differing[0]] == expected[differing[0]] - 1
        k = 200
        rows = recording.tags.store.read(recording.tags.find(np.array([k]))[0])
        lines_k = whole[whole[:, 0] == frames[k, 0]]
        np.testing.assert_array_equal(rows["id"], lines_k[:, 2])
        np.testing.assert_array_equal(rows["corners"].reshape(-1, 8), lines_k[:, 3:11])
        spread = rows["covariance"][:, :, [0, 0, 1], [0, 1, 1]].reshape(-1, 15)
        np.testing.assert_allclose(spread, lines_k[:, 11:], rtol=1e-6)
    # A line with a damaged number is left out.
    lines[60] = lines[60].replace(",", ";", 1)
    path.write_text("\n".join(lines))
    damaged = read_camera_tags(run, "cam_0", ids)
    assert damaged.cut == 1
    assert damaged.tags.count.sum() == recording.tags.count.sum() - 1
    cells = lines[80].split(",")
    for k, wrong in ((3, "1e9"), (11, "0"), (23, "0")):
        path.write_text(
            "\n".join([*lines[:80], ",".join([*cells[:k], wrong, *cells[k + 1 :]]), *lines[81:]])
        )
        assert read_camera_tags(run, "cam_0", ids).cut in (1, 2)  # 1 if the line is of another tag
