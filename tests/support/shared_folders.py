"""Folders that one worker of a test run fills and all of its workers read."""

from __future__ import annotations

import fcntl
import os
import shutil


def shared_root(tmp_path_factory):
    """Return the temporary folder of this run, which all workers see."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


def fill_once(tmp_path_factory, name, fill):
    """Return a folder that `fill(folder)` has filled in the first worker that needs it.

    Tests read it; those that change files copy it first.
    """
    root = shared_root(tmp_path_factory)
    folder, filled = root / name, root / f"{name}.filled"
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not filled.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            fill(folder)
            filled.touch()
    return folder
