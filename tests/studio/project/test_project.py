"""Undo and redo of a device's file, with other programs and a program that is killed."""

from __future__ import annotations

import os

import numpy as np
import pytest

from defsense_fab.core.errors import DeviceError, StorageError
from defsense_fab.studio.edits import body, cords, poses
from defsense_fab.studio.edits.edit import Edit, free_name
from defsense_fab.studio.project import history
from defsense_fab.studio.project import project as project_module
from defsense_fab.studio.project.project import Project
from tests.studio.devices import TEXT, write_device
from tests.support.errors import raises


@pytest.fixture
def folder(tmp_path):
    return write_device(tmp_path / "grip")


def file_text(folder):
    return (folder / "device.toml").read_bytes().decode()


def random_edit(project, rng):
    """Return a random edit, sometimes of a part that does not exist."""
    device = project.device
    cord = str(rng.choice([s.name for s in device.sensors] or ["none"]))
    pose = str(rng.choice([p.name for p in device.poses] or ["none"]))
    index, point = int(rng.integers(0, 6)), rng.uniform(-20, 150, 2)
    new = free_name("copy", [s.name for s in device.sensors])
    pose_new = free_name("pose", [p.name for p in device.poses])
    edits = [
        cords.move_point(cord, index, point),
        cords.insert_point(cord, index, point),
        cords.delete_point(cord, index),
        cords.rename_cord(cord, new),
        cords.remove_cord(cord),
        cords.mirror_cord(cord, new, np.zeros(3), rng.normal(size=3)),
        cords.set_freedoms(cord, ["path"] if index % 2 else []),
        poses.duplicate_pose(pose, pose_new),
        poses.rename_pose(pose, pose_new),
        poses.remove_pose(pose),
        poses.turn_handle(pose, "tip", rng.normal(size=3), 20.0),
        poses.rename_region("tip", "end"),
        poses.rename_region("end", "tip"),
        body.set_parameter("length", float(rng.uniform(100, 200))),
        body.set_value("fabrication", "wall", float(rng.uniform(1, 3))),
        body.reset_value("fabrication", "wall"),
    ]
    return edits[rng.integers(len(edits))]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_undo_and_redo_through_two_hundred_operations(folder, seed):
    rng = np.random.default_rng(seed)
    project, texts, refused = Project(folder), [TEXT], 0
    while len(texts) < 201:
        before = file_text(folder)
        try:
            project.apply(random_edit(project, rng))
        except DeviceError:
            refused += 1
            assert file_text(folder) == before
            continue
        if file_text(folder) != before:
            texts.append(file_text(folder))
    assert refused > 10
    for text in reversed(texts[:-1]):
        assert project.undo()
        assert file_text(folder) == text
    assert project.undo() is None
    assert file_text(folder) == TEXT
    for text in texts[1:]:
        assert project.redo()
        assert file_text(folder) == text
    assert project.redo() is None


def test_undo_and_redo_mixed_with_edits(folder):
    rng, project = np.random.default_rng(5), Project(folder)
    done, undone = [TEXT], []
    for _ in range(200):
        choice = rng.integers(3)
        if choice == 0:
            assert (project.undo() is not None) == (len(done) > 1)
            if len(done) > 1:
                undone.append(done.pop())
        elif choice == 1:
            assert (project.redo() is not None) == bool(undone)
            if undone:
                done.append(undone.pop())
        else:
            value = float(np.round(rng.uniform(100, 200), 2))
            project.apply(body.set_parameter("length", value))
            if file_text(folder) != done[-1]:
                done.append(file_text(folder))
                undone.clear()
        assert file_text(folder) == done[-1] == project.text


def test_watchers_are_called_with_the_names_of_steps(folder):
    project, names = Project(folder), []
    project.watchers.append(names.append)
    assert project.undo_name is None
    project.apply(cords.move_point("top", 2, np.array([70.0, 1.0])))
    assert project.undo_name == "move control point 3 of `top`"
    assert project.undo() == "move control point 3 of `top`"
    assert project.redo_name == "move control point 3 of `top`"
    project.redo()
    name = "move control point 3 of `top`"
    assert names == [name, f"undo: {name}", f"redo: {name}"]
    project.apply(body.set_parameter("length", 150))  # no change
    assert len(names) == 3


def test_the_history_survives_a_program_that_is_killed(folder):
    project = Project(folder)
    for k in range(5):
        project.apply(body.set_parameter("length", 151 + k))
    project.undo()
    again = Project(folder)
    assert again.undo_name == "set length to 154"
    assert again.redo_name == "set length to 155"
    # The program was killed while it wrote a line.
    file = folder / history.FOLDER / history.FILE
    file.write_bytes(file.read_bytes()[:-4])
    other = Project(folder)
    assert other.undo_name == "edit outside of the studio" or other.undo_name == "set length to 154"
    for _ in range(6):
        other.undo()
    assert file_text(folder) == TEXT
    file.write_text("garbage\n" * 3, encoding="utf-8")
    assert Project(folder).undo_name is None


def test_an_edit_by_another_program_is_a_step_and_loses_nothing(folder):
    project = Project(folder)
    project.apply(cords.move_point("top", 2, np.array([70.0, 1.0])))
    before = file_text(folder)
    outside = before.replace('name = "side"', 'name = "flank"  # changed elsewhere')
    (folder / "device.toml").write_text(outside, encoding="utf-8")
    project.apply(body.set_parameter("length", 160))
    assert "flank" in file_text(folder)
    assert "length = 160" in file_text(folder)
    assert [s.name for s in project.device.sensors] == ["top", "flank"]
    with raises(DeviceError, "not-in-device", name="side", names=("top", "flank")):
        project.apply(cords.remove_cord("side"))
    assert project.undo() == "set length to 160"
    assert project.undo() == "edit outside of the studio"
    assert file_text(folder) == before


def test_an_invalid_file_keeps_the_last_device(folder):
    project = Project(folder)
    (folder / "device.toml").write_text("name = ", encoding="utf-8")
    for action in (project.refresh, project.undo, lambda: project.apply(body.rename_device("x"))):
        with raises(DeviceError, "toml-invalid"):
            action()
    assert project.device.name == "grip"
    project.restore()
    assert file_text(folder) == TEXT
    assert not project.refresh()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_folder_that_is_missing_for_a_while_is_not_made_again(folder):
    project = Project(folder)
    away = folder.rename(folder.with_name("away"))
    with raises(DeviceError, "folder-missing"):
        project.refresh()
    with pytest.raises(StorageError):
        project.restore()
    assert not folder.exists()
    away.rename(folder)
    assert not project.refresh()
    project.apply(body.rename_device("back"))
    assert "back" in file_text(folder)


def test_a_pipe_in_place_of_the_file_is_an_error_and_blocks_nothing(folder):
    project = Project(folder)
    path = folder / "device.toml"
    path.unlink()
    os.mkfifo(path)
    for call in (project.refresh, lambda: project.apply(body.rename_device("b")), project.undo):
        with raises(DeviceError, "file-unreadable"):
            call()
    path.unlink()
    path.mkdir()
    with raises(DeviceError, "file-unreadable"):
        project.refresh()
    path.rmdir()
    project.restore()
    project.apply(body.rename_device("c"))
    (folder / history.FOLDER / history.FILE).unlink()
    os.mkfifo(folder / history.FOLDER / history.FILE)
    assert Project(folder).undo_name is None


def test_an_edit_with_an_invalid_result_changes_nothing(folder):
    project = Project(folder)
    for edit, code in (
        (body.set_value("mesh", "edge_length", -1.0), "out-of-range"),
        (cords.rename_cord("side", "top"), "name-repeated"),
        (Edit("spoil", lambda d: d.add("name", 3)), "edit-not-possible"),
    ):
        with raises(DeviceError, code):
            project.apply(edit)
        assert file_text(folder) == TEXT
        assert project.undo_name is None


def test_a_failed_write_is_an_error_and_changes_nothing(folder, monkeypatch):
    project = Project(folder)

    def refuse(path, text):
        raise StorageError("the disk is full", code="disk-full", where=path)

    monkeypatch.setattr("defsense_fab.studio.project.project.write_text", refuse)
    with raises(StorageError, "disk-full"):
        project.apply(body.set_parameter("length", 160))
    assert project.undo_name is None
    assert project.text == file_text(folder) == TEXT


def test_line_ends_stay_as_they_are(folder):
    (folder / "device.toml").write_bytes(TEXT.replace("\n", "\r\n").encode())
    project = Project(folder)
    project.apply(cords.move_point("top", 2, np.array([70.0, 1.0])))
    assert b"\r\n" in (folder / "device.toml").read_bytes()
    assert "\n" not in file_text(folder).replace("\r\n", "")


def test_long_histories_are_trimmed(folder, monkeypatch):
    monkeypatch.setattr(history, "MAX_STEPS", 10)
    project = Project(folder)
    for k in range(25):
        project.apply(body.set_parameter("length", 160 + k))
    assert sum(project.undo() is not None for _ in range(30)) == 9
    assert Project(folder).step_count == 10


def test_histories_of_large_files_are_trimmed(folder, monkeypatch):
    monkeypatch.setattr(history, "MAX_CHARACTERS", 10 * len(TEXT))
    project = Project(folder)
    for k in range(25):
        project.apply(body.set_parameter("length", 160 + k))
    assert 5 < project.step_count < 11
    assert (folder / history.FOLDER / history.FILE).stat().st_size < 15 * len(TEXT)
    monkeypatch.setattr(history, "MAX_CHARACTERS", 1)
    project.apply(body.set_parameter("length", 200))
    assert project.undo() is not None  # one step can always be undone


def test_an_edit_that_makes_the_file_too_large_is_refused(folder, monkeypatch):
    monkeypatch.setattr(project_module, "MAX_CHARACTERS", len(TEXT) + 20)
    project = Project(folder)
    with raises(DeviceError, "device-too-large"):
        project.apply(body.rename_device("x" * 100))
    assert file_text(folder) == TEXT
    project.apply(body.rename_device("y"))


def test_a_truncated_row_loses_no_other_row(folder):
    project = Project(folder)
    for name in ("a", "b", "c"):
        project.apply(body.rename_device(name))
    path = folder / history.FOLDER / history.FILE
    path.write_bytes(path.read_bytes()[:-9])
    again = Project(folder)  # the file has the name `c`
    again.apply(body.rename_device("d"))
    again.undo()
    text = again.text
    last = Project(folder)
    assert last.text == text
    assert last.redo_name == "rename the device to `d`"
    last.undo()
    assert last.device.name == "b"
