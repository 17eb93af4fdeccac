"""Test folders that are written whole or not at all, and locks of files."""

from __future__ import annotations

import contextlib
import fcntl
import os
import subprocess
import sys

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.core.storage.files import (
    check_folder,
    file_lock,
    read_regular,
    replace_folder,
    unused_path,
)
from tests.support.errors import raises


def test_second_holder_is_refused_until_the_first_releases(tmp_path):
    path = tmp_path / "lock"
    path.write_text("kept")
    with file_lock(path, "busy here"), raises(StorageError, "file-in-use", path=path):
        file_lock(path, "busy here").__enter__()
    with file_lock(path, "busy"):
        assert path.read_text("utf-8") == "kept"


def test_lock_released_between_opening_and_locking_has_one_holder(tmp_path, monkeypatch):
    """The second opens the file, the first releases it, then the second locks it: a third must not
    lock a new file of the same name."""
    path, flock = tmp_path / "lock", fcntl.flock
    first = contextlib.ExitStack()
    first.enter_context(file_lock(path, "busy"))

    def release_then_lock(file, how):
        first.close()
        flock(file, how)

    with monkeypatch.context() as patch:
        patch.setattr(fcntl, "flock", release_then_lock)
        second = file_lock(path, "busy")
        second.__enter__()
    with raises(StorageError, "file-in-use", path=path):
        file_lock(path, "busy").__enter__()
    second.__exit__(None, None, None)


def test_killed_process_leaves_no_lock(tmp_path):
    code = (
        "import os, sys\nfrom pathlib import Path\n"
        "from defsense_fab.core.storage.files import file_lock\n"
        "with file_lock(Path(sys.argv[1]), 'busy'):\n    os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "lock"
    assert subprocess.run([sys.executable, "-c", code, str(path)]).returncode == -9
    with file_lock(path, "busy"):
        assert path.exists()


def test_error_names_a_path_that_cannot_exist(tmp_path):
    (tmp_path / "file").write_text("")
    with raises(StorageError, "not-a-folder", path=tmp_path / "file" / "lock"):
        file_lock(tmp_path / "file" / "lock", "busy").__enter__()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def test_folder_appears_only_at_the_end(tmp_path):
    out = tmp_path / "a" / "out"
    with replace_folder(out) as new:
        (new / "x").write_text("1")
        assert not out.exists()
    assert names(out) == ["x"]
    assert names(out.parent) == ["out"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_error_leaves_the_folder_unchanged(tmp_path, overwrite):
    out = tmp_path / "out"
    out.mkdir()
    (out / "before").write_text("1")

    def fail():
        with replace_folder(out, overwrite=overwrite) as new:
            (new / "x").write_text("1")
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        fail()
    assert names(tmp_path) == ["out"]
    assert names(out) == ["before"]


def test_existing_folder_is_replaced_only_on_request(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with replace_folder(out) as new:  # an empty one
        (new / "x").write_text("1")
    with raises(StorageError, "file-exists", path=out), replace_folder(out):
        pass
    assert names(out) == ["x"]
    with replace_folder(out, overwrite=True) as new:
        (new / "y").write_text("1")
    assert names(out) == ["y"]
    file = out / "y"
    with raises(StorageError, "file-exists", path=file), replace_folder(file, overwrite=True):
        pass
    assert names(tmp_path) == ["out"]
    assert names(out) == ["y"]


def test_refusal_of_the_system_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError) as caught, replace_folder(tmp_path / "file/x"):
        pass
    assert caught.value.code in ("not-a-folder", "file-exists")
    assert "\n" not in str(caught.value)


def test_existing_name_gets_a_number(tmp_path):
    path = tmp_path / "x.mid"
    assert unused_path(path) == path
    path.write_text("")
    (tmp_path / "x-2.mid").symlink_to("nowhere")
    assert unused_path(path) == tmp_path / "x-3.mid"


def test_impossible_folder_is_refused_before_it_is_created(tmp_path):
    check_folder(tmp_path / "new" / "within")
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "within"):
        with raises(StorageError, "not-a-folder", path=tmp_path / "file"):
            check_folder(path)


def test_a_link_is_replaced_and_its_target_stays(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine").write_text("mine", encoding="utf-8")
    link = tmp_path / "report"
    link.symlink_to(tmp_path / "other")
    with replace_folder(link, overwrite=True) as new:
        (new / "page").write_text("page", encoding="utf-8")
    assert not link.is_symlink()
    assert [path.name for path in link.iterdir()] == ["page"]
    assert (tmp_path / "other" / "mine").read_text("utf-8") == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"other", "report"}


def test_only_files_are_read(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"content")
    assert read_regular(path) == b"content"
    with pytest.raises(IsADirectoryError):
        read_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_regular(tmp_path / "missing")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(2**40)  # without content on the disk
    for name in ("pipe", "zero", "huge"):
        with pytest.raises(OSError, match=name):
            read_regular(tmp_path / name)
