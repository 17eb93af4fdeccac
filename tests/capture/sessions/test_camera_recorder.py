"""The thread of a camera closes what it opened, also if the camera's driver hangs."""

import json
import threading

import numpy as np
import pytest

from defsense_fab.capture.sessions.camera_recorder import CameraRecorder
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.capture.sessions.session import BOARD, LOG, Log
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.errors import StorageError
from tests.capture.sessions import capture_rig as rig


class Hanging:
    """An `ImageSource` that gives one image; the next `read` waits for `resume`."""

    def __init__(self):
        self.name, self.size = "cam_0", rig.SIZE
        self.inside, self.resume = threading.Event(), threading.Event()
        self.closed, self.closed_under_read, self.pictures = 0, False, 0

    def start(self):
        pass

    def read(self, timeout):
        self.pictures += 1
        if self.pictures > 1:
            self.inside.set()
            self.resume.wait(120)
            self.closed_under_read |= self.closed > 0
        return np.zeros(rig.SIZE[::-1], np.uint8), 10**9 * self.pictures

    def close(self):
        self.closed += 1


def make_recorder(run, source, log, **options):
    return CameraRecorder(
        lambda: source, rig.cameras()[0], dictionary("4X4_50"), run, log, **options
    )


def test_camera_that_hangs_is_closed_by_its_own_thread(tmp_path, monkeypatch):
    """It writes the image that was being read, and nothing to other files."""
    log, source = Log(tmp_path / LOG), Hanging()
    recorder = make_recorder(tmp_path, source, log)
    join = recorder._thread.join
    monkeypatch.setattr(recorder._thread, "join", lambda timeout=None: join(0.1))
    recorder.start()
    assert source.inside.wait(120)
    recorder.close()
    log.close()
    with (tmp_path / BOARD).open("wb", buffering=0) as other:  # may get the log's descriptor
        assert not source.closed
        source.resume.set()
        join(120)
        other.write(b"mine")
    assert (tmp_path / BOARD).read_bytes() == b"mine"
    assert source.closed == 1
    assert not source.closed_under_read
    assert read_camera_tags(tmp_path, "cam_0", np.arange(9)).time.tolist() == [10**9, 2 * 10**9]
    kinds = [json.loads(line)["event"] for line in (tmp_path / LOG).read_text("utf-8").splitlines()]
    assert kinds == ["camera hangs"]
    with pytest.raises(StorageError):
        recorder._frames.line("late")


def test_camera_that_returns_late_writes_to_no_other_file(tmp_path, monkeypatch):
    """Its thread logs an event after the log was closed."""
    log, source = Log(tmp_path / LOG), Hanging()
    recorder = make_recorder(tmp_path, source, log)
    join = recorder._thread.join
    monkeypatch.setattr(recorder._thread, "join", lambda timeout=None: join(0.1))
    recorder.start()
    assert source.inside.wait(120)
    recorder.close()
    log.close()
    monkeypatch.setattr(recorder, "_record", lambda *frame: log.event("late"))
    with (tmp_path / BOARD).open("wb", buffering=0) as other:
        source.resume.set()
        join(120)
        other.write(b"mine")
    assert (tmp_path / BOARD).read_bytes() == b"mine"
    assert isinstance(recorder.failure, StorageError)
    assert source.closed == 1


def test_recorder_that_never_started_closes_at_once(tmp_path):
    log = Log(tmp_path / LOG)
    recorder = make_recorder(tmp_path, Hanging(), log)
    recorder.close()
    with pytest.raises(StorageError):
        recorder._tags.line("late")
    log.close()


def test_data_that_do_not_reach_the_disk_raise_on_close(tmp_path, monkeypatch):
    log, source = Log(tmp_path / LOG), Hanging()
    recorder = make_recorder(tmp_path, source, log)
    recorder.start()
    assert source.inside.wait(120)

    def full(file):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    source.resume.set()
    with pytest.raises(StorageError):
        recorder.close()
    monkeypatch.undo()
    assert source.closed == 1
    log.close()
