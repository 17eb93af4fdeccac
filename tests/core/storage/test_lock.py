"""One holder of a lock at a time, whatever the order of opening, locking and leaving."""

import contextlib
import fcntl
import subprocess
import sys

from defsense_fab.core.errors import StorageError
from defsense_fab.core.storage.lock import locked
from tests.errors import raises


def test_a_second_holder_is_refused_until_the_first_leaves(tmp_path):
    path = tmp_path / "lock"
    path.write_text("kept")
    with locked(path, "busy here"), raises(StorageError, "file-in-use", path=path):
        locked(path, "busy here").__enter__()
    with locked(path, "busy"):
        assert path.read_text("utf-8") == "kept"


def test_a_lock_that_is_left_between_opening_and_locking_has_one_holder(tmp_path, monkeypatch):
    """The second opens the file, the first leaves, the second locks what it opened: a third must
    not come in by a new file of the same name."""
    path, flock = tmp_path / "lock", fcntl.flock
    first = contextlib.ExitStack()
    first.enter_context(locked(path, "busy"))

    def leave_then_lock(file, how):
        first.close()
        flock(file, how)

    with monkeypatch.context() as patch:
        patch.setattr(fcntl, "flock", leave_then_lock)
        second = locked(path, "busy")
        second.__enter__()
    with raises(StorageError, "file-in-use", path=path):
        locked(path, "busy").__enter__()
    second.__exit__(None, None, None)


def test_a_process_that_dies_leaves_no_lock(tmp_path):
    code = (
        "import os, sys\nfrom pathlib import Path\n"
        "from defsense_fab.core.storage.lock import locked\n"
        "with locked(Path(sys.argv[1]), 'busy'):\n    os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "lock"
    assert subprocess.run([sys.executable, "-c", code, str(path)]).returncode == -9
    with locked(path, "busy"):
        assert path.exists()


def test_a_place_where_no_file_can_be_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with raises(StorageError, "not-a-folder", path=tmp_path / "file" / "lock"):
        locked(tmp_path / "file" / "lock", "busy").__enter__()
