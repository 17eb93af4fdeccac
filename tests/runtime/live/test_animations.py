"""Animations of a run: one at a time, none written over, none lost where a folder is."""

import shutil

import numpy as np
import pytest
from defsense_fab.runtime.live.animations import Animations
from defsense_fab.runtime.live.live_run import latency, record_button
from defsense_fab.runtime.live.run_folder import RunFolder

from defsense_fab.core.errors import LiveError, StorageError
from tests.runtime.full_disk import fill
from tests.runtime.recording_bars import bar, frames

REST, FACES = bar()


def send(animations, seconds=1.0):
    for frame in frames(seconds, 60, REST):
        animations.send(frame)


def test_one_that_runs_is_not_replaced_by_another(tmp_path):
    animations = Animations(REST, FACES)
    assert animations.start(tmp_path / "a.npz") == tmp_path / "a.npz"
    send(animations)
    with pytest.raises(LiveError, match=r"a\.npz is being recorded; stop that first"):
        animations.start(tmp_path / "b.npz")
    assert animations.recording == tmp_path / "a.npz"
    animations.close()  # of the loop: writing comes after all else
    assert animations.finish().file.frames == 31
    assert animations.recording is None
    assert animations.finish() is None
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_a_file_that_is_there_stays(tmp_path):
    first, late = tmp_path / "a.npz", tmp_path / "a-2.npz"
    first.write_text("mine")
    animations = Animations(REST, FACES)
    assert animations.start(first) == late
    send(animations)
    late.write_text("of another program, meanwhile")
    assert animations.finish().file.path.name == "a-2-2.npz"
    assert first.read_text("utf-8") == "mine"
    assert late.read_text("utf-8") == "of another program, meanwhile"


def test_what_a_folder_does_not_take_goes_to_another(tmp_path):
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
    assert written.told.startswith(f"{spare}/a.npz: 31 frames, 1.0 s")
    assert "it is there since it could not be written to" in written.told
    assert "gone" in written.told
    assert len(np.load(spare / "a.npz")["times"]) == 31


def test_what_no_folder_takes_is_kept_until_one_does(tmp_path):
    gone, spare = tmp_path / "gone", tmp_path / "spare"
    gone.mkdir()
    animations = Animations(REST, FACES, (lambda: gone, lambda: spare))
    animations.start(gone / "a.npz")
    send(animations)
    shutil.rmtree(gone)
    with pytest.raises(StorageError, match=r"the animation is not written: .*nor elsewhere: "):
        animations.finish()
    assert animations.recording == gone / "a.npz"
    gone.mkdir()
    assert animations.finish().file.frames == 31


def test_one_without_a_frame_is_told_and_over(tmp_path):
    animations = Animations(REST, FACES)
    animations.start(tmp_path / "a.npz")
    assert animations.empty
    with pytest.raises(LiveError, match=r"a\.npz: no frame with a surface was recorded"):
        animations.finish()
    assert animations.recording is None


def test_trouble_ends_with_the_recording_that_had_it(tmp_path):
    animations = Animations(REST, FACES)
    animations.start(tmp_path / "a.npz")
    fill(animations._recorder._rows, int(5.5 * 4 * REST.size))
    send(animations)
    assert "the disk is full" in animations.trouble
    animations.finish()
    assert animations.trouble is None


def test_the_button_records_into_the_run_s_folder_and_says_what_came_of_it(tmp_path):
    folder = RunFolder(tmp_path / "live" / "now", new=True)
    animations = Animations(REST, FACES)
    clicked = record_button(animations, folder)
    assert not folder.path.exists()
    for name in ("animation.glb", "animation-2.glb"):
        assert clicked(True) == f"recording into {folder.path / name}"
        assert "is being recorded; stop that first" in clicked(True)
        send(animations)
        assert clicked(False).startswith(f"{folder.path / name}: 31 frames")
    assert clicked(False) == "no animation was being recorded"
    clicked(True)
    send(animations)
    shutil.rmtree(folder.path)
    assert clicked(False).endswith("press again to try once more")
    folder.make()
    assert clicked(False).startswith(f"{folder.path}/animation-3.glb: 31 frames")


def test_latency_in_words():
    assert latency((0.0123, 0.0456)) == "12 ms from the sample to the view (99 %: 46 ms)"
    assert latency((np.nan, np.nan)) == ""
