"""The raw readings are recorded from the first sample on, each run in its own folder."""

import os
import threading
import time

import pytest

from defsense_fab.capture.readout.recording import Recorder, read_recording
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.runtime.live import run_files
from defsense_fab.runtime.live.run_files import RawRecording, RunFolder, new_run_folder
from defsense_fab.sensing.serial_frames import Sample
from tests.support.errors import raises


def sample(number, channels=2):
    return StampedSample(number, 10 * number, Sample(number, 0, False, False, 1, (5,) * channels))


def test_run_without_samples_leaves_nothing(tmp_path):
    recording = RawRecording(new_run_folder(tmp_path), 2)
    recording.add(Event(0, "start", {}))
    recording.close()
    recording.add(sample(0))
    assert list(tmp_path.iterdir()) == []
    assert recording.trouble is None


def test_events_before_the_first_sample_are_kept(tmp_path):
    recording = RawRecording(new_run_folder(tmp_path), 2)
    for kind in ("start", "text"):
        recording.add(Event(0, kind, {}))
    assert not recording.wait_until_started(0)
    recording.add(sample(0))
    assert recording.wait_until_started(0)
    recording.add(sample(1))
    recording.close()
    assert recording.path.parent.parent == tmp_path / "live"
    read = read_recording(recording.path)
    assert read.counter.tolist() == [0, 1]
    assert [(at, e["event"]) for at, e in read.events] == [(0, "start"), (0, "text")]


def test_simultaneous_runs_have_separate_folders(tmp_path):
    folders = [RunFolder(tmp_path / "live" / "now", new=True) for _ in range(8)]
    threads = [threading.Thread(target=folder.make) for folder in folders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    names = {folder.make().name for folder in folders}
    assert names == {"now", *(f"now-{k}" for k in range(2, 9))}
    assert {p.name for p in (tmp_path / "live").iterdir()} == names


def test_requested_folder_is_used_unchanged(tmp_path):
    (tmp_path / "mine").mkdir()
    recording = RawRecording(RunFolder(tmp_path / "mine"), 2)
    recording.add(sample(0))
    recording.close()
    again = RawRecording(RunFolder(tmp_path / "mine"), 2)
    again.add(sample(1))
    again.close()
    assert read_recording(tmp_path / "mine" / "board.csv").counter.tolist() == [0, 1]


def test_unusable_folders_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with raises(StorageError, "not-a-folder"):
        RawRecording(RunFolder(tmp_path / "file" / "x"), 2)
    Recorder(tmp_path / "board.csv", 3).close()
    with raises(CaptureError, "wrong-file-format"):
        RawRecording(RunFolder(tmp_path), 2)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_folder_without_permission_is_refused(tmp_path):
    (tmp_path / "no").mkdir(mode=0o500)
    with raises(StorageError, "folder-not-writable"):
        RawRecording(RunFolder(tmp_path / "no" / "x"), 2)


def test_samples_with_other_channels_are_left_out(tmp_path):
    recording = RawRecording(RunFolder(tmp_path / "live"), 2)
    recording.add(sample(0))
    recording.add(sample(1, channels=3))
    assert (recording.trouble.code, recording.trouble.data["count"]) == ("channels-differ", 3)
    recording.add(sample(2))
    assert recording.trouble is None
    recording.close()
    assert read_recording(recording.path).counter.tolist() == [0, 2]


def test_recording_resumes_after_a_full_disk(tmp_path, monkeypatch):
    """It resumes in the same file."""
    recording, add, full = RawRecording(RunFolder(tmp_path / "live"), 2), Recorder.add, [False]

    def perhaps(recorder, item):
        if full[0]:
            raise StorageError("the disk is full", code="disk-full", where="board.csv")
        add(recorder, item)

    monkeypatch.setattr(Recorder, "add", perhaps)
    monkeypatch.setattr(run_files, "_RETRY_DELAY_S", 0.5)
    recording.add(sample(0))
    full[0] = True
    recording.add(sample(1))
    assert recording.trouble.code == "disk-full"
    full[0] = False
    recording.add(sample(2))  # too early to try again
    assert recording.trouble is not None
    time.sleep(0.6)
    recording.add(sample(3))
    assert recording.trouble is None
    recording.close()
    assert read_recording(recording.path).counter.tolist() == [0, 3]


def test_failure_to_start_is_reported(tmp_path):
    recording = RawRecording(RunFolder(tmp_path / "live"), 2)
    (tmp_path / "live").write_text("")
    recording.add(sample(0))
    assert recording.trouble is not None
    assert not recording.wait_until_started(0)
    recording.add(sample(1))
    recording.close()
