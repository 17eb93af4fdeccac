"""The readings' file: there from the first sample on, beside no other run's."""

import os
import threading

import pytest
from defsense_fab.runtime.live.raw_recording import RawRecording
from defsense_fab.runtime.live.run_folder import new_run_folder, RunFolder

from defsense_fab.capture.readout.recording import Recorder, read_recording
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.sensing.serial_frames import Sample


def sample(number, channels=2):
    return StampedSample(number, 10 * number, Sample(number, 0, False, False, 1, (5,) * channels))


def test_a_run_without_a_sample_leaves_nothing(tmp_path):
    recording = RawRecording(new_run_folder(tmp_path), 2)
    recording.add(Event(0, "start", {}))
    recording.close()
    recording.add(sample(0))
    assert list(tmp_path.iterdir()) == []
    assert recording.trouble is None


def test_what_happened_before_the_first_sample_is_kept(tmp_path):
    recording = RawRecording(new_run_folder(tmp_path), 2)
    for kind in ("start", "text"):
        recording.add(Event(0, kind, {}))
    assert not recording.wait_until_begun(0)
    recording.add(sample(0))
    assert recording.wait_until_begun(0)
    recording.add(sample(1))
    recording.close()
    assert recording.path.parent.parent == tmp_path / "live"
    found = read_recording(recording.path)
    assert found.counter.tolist() == [0, 1]
    assert [(at, e["event"]) for at, e in found.events] == [(0, "start"), (0, "text")]


def test_runs_of_one_second_have_folders_of_their_own(tmp_path):
    folders = [RunFolder(tmp_path / "live" / "now", new=True) for _ in range(8)]
    threads = [threading.Thread(target=folder.make) for folder in folders]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    names = {folder.make().name for folder in folders}
    assert names == {"now", *(f"now-{k}" for k in range(2, 9))}
    assert {p.name for p in (tmp_path / "live").iterdir()} == names


def test_a_folder_that_was_asked_for_is_used_as_it_is(tmp_path):
    (tmp_path / "mine").mkdir()
    recording = RawRecording(RunFolder(tmp_path / "mine"), 2)
    recording.add(sample(0))
    recording.close()
    again = RawRecording(RunFolder(tmp_path / "mine"), 2)
    again.add(sample(1))
    again.close()
    assert read_recording(tmp_path / "mine" / "board.csv").counter.tolist() == [0, 1]


def test_what_cannot_be_recorded_into_is_refused_beforehand(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="file: is no folder; choose another place"):
        RawRecording(RunFolder(tmp_path / "file" / "x"), 2)
    Recorder(tmp_path / "board.csv", 3).close()
    with pytest.raises(CaptureError, match="is no recording of 2 channels"):
        RawRecording(RunFolder(tmp_path), 2)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused_beforehand(tmp_path):
    (tmp_path / "no").mkdir(mode=0o500)
    with pytest.raises(StorageError, match="files cannot be made there"):
        RawRecording(RunFolder(tmp_path / "no" / "x"), 2)


def test_samples_of_other_channels_are_left_out_and_told(tmp_path):
    recording = RawRecording(RunFolder(tmp_path / "live"), 2)
    recording.add(sample(0))
    recording.add(sample(1, channels=3))
    assert recording.trouble.startswith("a sample of 3 channels is not recorded among those of 2")
    recording.add(sample(2))
    assert recording.trouble is None
    recording.close()
    assert read_recording(recording.path).counter.tolist() == [0, 2]


def test_a_disk_that_was_full_for_a_while(tmp_path, monkeypatch):
    """The recording goes on where it can, into the same file."""
    recording, add, full = RawRecording(RunFolder(tmp_path / "live"), 2), Recorder.add, [False]

    def perhaps(recorder, item):
        if full[0]:
            raise StorageError("board.csv: the disk is full")
        add(recorder, item)

    monkeypatch.setattr(Recorder, "add", perhaps)
    recording.add(sample(0))
    full[0] = True
    recording.add(sample(1))
    assert recording.trouble == "the readings are no longer recorded: board.csv: the disk is full"
    full[0] = False
    recording.add(sample(2))  # not yet tried again
    assert recording.trouble is not None
    monkeypatch.setattr(recording, "_again", 0.0)
    recording.add(sample(3))
    assert recording.trouble is None
    recording.close()
    assert read_recording(recording.path).counter.tolist() == [0, 3]


def test_what_cannot_be_begun_is_told(tmp_path):
    recording = RawRecording(RunFolder(tmp_path / "live"), 2)
    (tmp_path / "live").write_text("")
    recording.add(sample(0))
    assert recording.trouble.startswith("the readings cannot be recorded: ")
    recording.add(sample(1))
    recording.close()
