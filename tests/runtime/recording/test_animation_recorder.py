"""Frames are resampled, kept on the disk, and written in the format of the suffix."""

import shutil
import threading
from collections import namedtuple

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError, StorageError
from defsense_fab.runtime.recording import animation_recorder
from defsense_fab.runtime.recording.animation import Animation
from defsense_fab.runtime.recording.animation_recorder import (
    SUFFIXES,
    AnimationRecorder,
    FrameResampler,
    RowFile,
    write_animation,
)
from tests.runtime.full_disk import limit_disk
from tests.runtime.live_frames import frame
from tests.runtime.recording_bars import animation, bar, frames, moved
from tests.support.errors import raises

REST, FACES = bar()
MAGIC = {".glb": b"glTF", ".usda": b"#usda", ".npz": b"PK"}


def recorder(path, **limits):
    return AnimationRecorder(path, REST, FACES, **limits)


def record(recording, seconds=2.0, **options):
    for one in frames(seconds, 100, REST, **options):
        recording.add(one)


def test_frames_are_resampled(tmp_path):
    path = tmp_path / "bar.npz"
    with recorder(path, fps=25) as recording:
        record(recording, start=3.21)
        assert (recording.frames, recording.seconds) == (51, 2.0)
        written = recording.finish()
    assert (written.path, written.frames, written.seconds) == (path, 51, 2.0)
    assert written.size == path.stat().st_size
    data = np.load(path)
    np.testing.assert_allclose(data["times"], np.arange(51) / 25)
    expected = np.stack([moved(REST, t) for t in data["times"]])
    np.testing.assert_allclose(data["positions"], expected, atol=1e-4)
    np.testing.assert_array_equal(data["faces"], FACES)
    assert recording.trouble is None
    assert [p.name for p in tmp_path.iterdir()] == ["bar.npz"]


def test_full_disk_ends_the_recording(tmp_path, monkeypatch):
    """The recorded frames are kept and written, and further frames raise no error."""
    path = tmp_path / "bar.npz"
    limit_disk(monkeypatch, int(20.5 * 4 * REST.size))
    recording = recorder(path)
    record(recording)
    assert recording.trouble.code == "disk-full"
    assert recording.trouble.data["seconds"] == pytest.approx(19 / 30)
    assert recording.finish().frames == 20
    np.testing.assert_allclose(np.load(path)["positions"][19], moved(REST, 19 / 30), atol=5e-3)


def test_room_is_left_for_the_finished_file(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    room = iter([33e6] * 10 + [32e6] * 1000)
    monkeypatch.setattr(
        animation_recorder.shutil, "disk_usage", lambda _: usage(1e9, 0, next(room))
    )
    recording = recorder(tmp_path / "bar.npz")
    record(recording)
    assert recording.trouble.code == "disk-full"
    assert recording.finish().frames == 10


def test_finishing_can_be_repeated(tmp_path):
    """A file that cannot be written loses nothing and leaves no partial file."""
    folder = tmp_path / "gone"
    folder.mkdir()
    recording = recorder(folder / "bar.npz")
    record(recording)
    shutil.rmtree(folder)
    with raises(StorageError, "file-not-found"):
        recording.finish()
    assert recording.finish(tmp_path / "other.npz").frames == 61
    assert [p.name for p in tmp_path.iterdir()] == ["other.npz"]
    with raises(LiveError, "recording-closed"):
        recording.finish()


def test_limits_end_the_recording(tmp_path):
    recording = recorder(tmp_path / "bar.npz", max_seconds=1)
    record(recording)
    assert (recording.trouble.code, recording.trouble.data["seconds"]) == ("limit-reached", 1.0)
    assert recording.finish().frames == 31
    recording = recorder(tmp_path / "bar.npz", max_bytes=10 * 4 * REST.size)
    record(recording)
    assert recording.trouble.code == "limit-reached"
    assert recording.finish().frames == 10


def test_frames_without_a_surface_are_skipped(tmp_path):
    recording = recorder(tmp_path / "bar.npz")
    for k, vertices in enumerate([None, REST[:-1], np.full(REST.shape, np.nan), REST]):
        recording.add(frame(k, time=0.1 * k, vertices=vertices))
    assert recording.skipped == 3
    assert recording.finish().frames == 1


def test_recording_without_frames(tmp_path):
    with (
        recorder(tmp_path / "bar.glb") as recording,
        raises(LiveError, "no-frames"),
    ):
        recording.finish()
    assert list(tmp_path.iterdir()) == []


def test_finish_while_frames_arrive(tmp_path):
    """Finishing happens in another thread; frames after the end are ignored."""
    recording = recorder(tmp_path / "bar.npz")
    started, stop = threading.Event(), threading.Event()

    def loop():
        for k, one in enumerate(frames(600, 100, REST)):
            recording.add(one)
            if k == 300:
                started.set()
            if stop.is_set():
                return

    thread = threading.Thread(target=loop)
    thread.start()
    assert started.wait(60)
    written = recording.finish()
    stop.set()
    thread.join(60)
    assert not thread.is_alive()
    data = np.load(tmp_path / "bar.npz")
    assert len(data["times"]) == written.frames >= 90
    np.testing.assert_allclose(data["positions"][-1], moved(REST, data["times"][-1]), atol=5e-3)


@pytest.mark.parametrize(
    ("changes", "code", "data"),
    [
        ({"path": "bar.fbx"}, "unknown-format", {"suffix": ".fbx"}),
        ({"fps": 0}, "out-of-range", {"field": "fps"}),
        ({"rest": np.zeros((4, 2))}, "surface-invalid", {"field": "rest"}),
        ({"faces": np.array([[0, 1, 4]])}, "surface-invalid", {"field": "faces"}),
        ({"faces": np.empty((0, 3), int)}, "surface-invalid", {"field": "faces"}),
    ],
)
def test_invalid_arguments_are_refused(tmp_path, changes, code, data):
    arguments = {
        "path": "bar.glb",
        "rest": np.eye(4)[:, :3],
        "faces": np.array([[0, 1, 2]]),
    } | changes
    with raises(LiveError, code, **data):
        AnimationRecorder(
            tmp_path / arguments["path"],
            arguments["rest"],
            arguments["faces"],
            fps=arguments.get("fps", 30),
        )


def test_missing_folder_is_refused(tmp_path):
    with raises(StorageError, "folder-not-found"):
        recorder(tmp_path / "none" / "bar.npz")


def resampled(times, fps=30.0):
    """Return steps and positions of a vertex at (1, 2, 3) times the frame's number."""
    resampler = FrameResampler(fps)
    steps = [
        step
        for k, t in enumerate(times)
        for step in resampler.add(t, k * np.array([[1.0, 2.0, 3.0]]))
    ]
    return [k for k, _ in steps], np.array([row[0] for _, row in steps])


@pytest.mark.parametrize("rate", [7.0, 30.0, 100.0, 333.3])
def test_resampling_is_linear_between_frames(rate):
    times = 5.0 + np.arange(40) / rate
    steps, values = resampled(times)
    assert steps == list(range(int(39 / rate * 30 + 1e-6) + 1))
    np.testing.assert_allclose(values[:, 0], np.array(steps) / 30 * rate, atol=2e-4)
    np.testing.assert_allclose(values[:, 2], 3 * values[:, 0])


def test_gap_holds_the_last_shape():
    """Only the two ends of a gap are returned, and the motion continues after it."""
    steps, values = resampled([0.0, 0.1, 0.21, 10.05, 10.15], fps=10.0)
    assert steps == [0, 1, 2, 3, 100, 101]
    np.testing.assert_allclose(values[:, 0], [0, 1, 1 + 0.1 / 0.11, 2, 2, 3.5])


def test_gap_that_ends_on_a_step():
    steps, values = resampled([0.0, 0.1, 5.0], fps=10.0)
    assert steps == [0, 1, 2, 49, 50]
    assert values[:, 0].tolist() == [0, 1, 1, 1, 2]


def test_clock_that_restarts():
    steps, values = resampled([7.0, 7.1, 7.2, 0.0, 0.1, 0.2], fps=10.0)
    assert steps == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(values[:, 0], [0, 1, 2, 4, 5])


def test_two_frames_at_the_same_time():
    steps, _ = resampled([1.0, 1.0, 1.0, 1.1], fps=10.0)
    assert steps == [0, 1]


def test_rows_are_read_back(tmp_path):
    rows = RowFile(tmp_path, 3)
    assert rows.rows().shape == (0, 3)
    for k in range(4):
        rows.add(np.array([k, k / 3, -k], np.float32))
    assert (rows.count, rows.size) == (4, 48)
    np.testing.assert_array_equal(rows.rows()[3], np.array([3, 1, -3], np.float32))
    assert list(tmp_path.iterdir()) == []  # the file has no name that could remain
    rows.close()


def test_partial_row_is_removed(tmp_path, monkeypatch):
    room = limit_disk(monkeypatch, 30)
    rows = RowFile(tmp_path, 3)
    for k in range(2):
        rows.add(np.full(3, k, np.float32))
    with pytest.raises(OSError, match="No space left"):
        rows.add(np.full(3, 2, np.float32))
    assert rows.count == 2
    room[0] = 100
    rows.add(np.full(3, 7, np.float32))
    assert rows.rows()[:, 0].tolist() == [0, 1, 7]
    rows.close()


def test_rows_need_a_folder(tmp_path):
    with raises(StorageError, "folder-not-found"):
        RowFile(tmp_path / "none", 3)


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".GLB"])
def test_suffix_chooses_the_format(tmp_path, suffix):
    path = tmp_path / f"bar{suffix}"
    written = write_animation(path, animation(5))
    assert written.path == path
    assert written.size == path.stat().st_size
    assert path.read_bytes().startswith(MAGIC.get(suffix.lower(), b"PXR-USDC"))


def test_unknown_format_is_refused(tmp_path):
    with raises(LiveError, "unknown-format", suffix=".abc"):
        write_animation(tmp_path / "bar.abc", animation(3))


@pytest.mark.parametrize(
    ("count", "steps", "code"),
    [
        (0, [], "no-frames"),
        (2, [0], "wrong-shape"),
        (2, [1, 1], "not-increasing"),
        (2, [-1, 1], "not-increasing"),
    ],
)
def test_invalid_animations_are_refused(count, steps, code):
    with raises(LiveError, code):
        Animation(
            "x",
            np.eye(3),
            np.array([[0, 1, 2]]),
            np.zeros((count, 3, 3), np.float32),
            np.array(steps, int),
            30.0,
        )
