"""Animations of a run: one at a time, none overwritten, none lost."""

import shutil

import numpy as np

from defsense_fab.core.errors import LiveError, StorageError
from defsense_fab.runtime.live.run_files import Animations, RunFolder
from defsense_fab.workflow.run.run import format_latency, record_action
from tests.runtime.full_disk import limit_disk
from tests.runtime.recording_bars import bar, frames
from tests.support.errors import raises

REST, FACES = bar()


def send(animations, seconds=1.0):
    for frame in frames(seconds, 60, REST):
        animations.send(frame)


def test_second_recording_is_refused(tmp_path):
    animations = Animations(REST, FACES)
    assert animations.start(tmp_path / "a.npz") == tmp_path / "a.npz"
    send(animations)
    with raises(LiveError, "recording-active"):
        animations.start(tmp_path / "b.npz")
    assert animations.recording == tmp_path / "a.npz"
    animations.close()  # called by the loop; writing comes last
    assert animations.finish().file.frames == 31
    assert animations.recording is None
    assert animations.finish() is None
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_existing_file_is_kept(tmp_path):
    first, late = tmp_path / "a.npz", tmp_path / "a-2.npz"
    first.write_text("mine")
    animations = Animations(REST, FACES)
    assert animations.start(first) == late
    send(animations)
    late.write_text("of another program, meanwhile")
    assert animations.finish().file.path.name == "a-2-2.npz"
    assert first.read_text("utf-8") == "mine"
    assert late.read_text("utf-8") == "of another program, meanwhile"


def test_missing_folder_is_replaced_by_a_spare_one(tmp_path):
    gone, taken, spare = (tmp_path / name for name in ("gone", "taken", "spare"))
    for folder in (gone, spare):
        folder.mkdir()
    taken.write_text("")
    animations = Animations(REST, FACES, (RunFolder(taken / "x").make, lambda: spare))
    animations.start(gone / "a.npz")
    send(animations)
    shutil.rmtree(gone)
    written = animations.finish()
    assert written.file.path == spare / "a.npz"
    assert (written.file.frames, written.file.seconds) == (31, 1.0)
    assert str(gone) in written.instead
    assert str(spare / "a.npz") in written.summary
    assert len(np.load(spare / "a.npz")["times"]) == 31


def test_animation_is_kept_until_it_is_written(tmp_path):
    gone, spare = tmp_path / "gone", tmp_path / "spare"
    gone.mkdir()
    animations = Animations(REST, FACES, (lambda: gone, lambda: spare))
    animations.start(gone / "a.npz")
    send(animations)
    shutil.rmtree(gone)
    with raises(StorageError, "animation-not-written"):
        animations.finish()
    assert animations.recording == gone / "a.npz"
    gone.mkdir()
    assert animations.finish().file.frames == 31


def test_animation_without_frames_is_discarded(tmp_path):
    animations = Animations(REST, FACES)
    animations.start(tmp_path / "a.npz")
    assert animations.is_empty
    with raises(LiveError, "no-frames"):
        animations.finish()
    assert animations.recording is None


def test_trouble_ends_with_its_recording(tmp_path, monkeypatch):
    limit_disk(monkeypatch, int(5.5 * 4 * REST.size))
    animations = Animations(REST, FACES)
    animations.start(tmp_path / "a.npz")
    send(animations)
    assert animations.trouble.code == "disk-full"
    animations.finish()
    assert animations.trouble is None


def test_button_records_into_the_folder_of_the_run(tmp_path):
    folder = RunFolder(tmp_path / "live" / "now", new=True)
    animations = Animations(REST, FACES)
    clicked = record_action(animations, folder)
    assert not folder.path.exists()
    for name in ("animation.glb", "animation-2.glb"):
        assert str(folder.path / name) in clicked(True)
        assert str(folder.path / name) in clicked(True)  # it is being recorded already
        send(animations)
        assert clicked(False).startswith(f"{folder.path / name}: 31 frames")
    assert clicked(False)
    assert len(animations.written) == 2
    clicked(True)
    send(animations)
    shutil.rmtree(folder.path)
    assert clicked(False)
    assert animations.recording is not None
    folder.make()
    assert clicked(False).startswith(f"{folder.path}/animation-3.glb: 31 frames")


def test_latency_sentence():
    assert format_latency((0.0123, 0.0456)) == "12 ms from the sample to the view (99 %: 46 ms)"
    assert format_latency((np.nan, np.nan)) == ""
