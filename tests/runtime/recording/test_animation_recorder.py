"""Frames are recorded as an animation; failures on the way lose no frames."""

import shutil
import threading
from collections import namedtuple

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError, StorageError
from defsense_fab.runtime.recording import animation_recorder
from defsense_fab.runtime.recording.animation_recorder import AnimationRecorder
from tests.runtime.full_disk import fill
from tests.runtime.live_frames import frame
from tests.runtime.recording_bars import bar, frames, moved
from tests.support.errors import raises

REST, FACES = bar()


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


def test_full_disk_ends_the_recording(tmp_path):
    """The recorded frames are kept and written, and further frames raise no error."""
    path = tmp_path / "bar.npz"
    recording = recorder(path)
    fill(recording._rows, int(20.5 * 4 * REST.size))
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
