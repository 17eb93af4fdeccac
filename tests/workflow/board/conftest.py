"""A small bar with two cords that is built until its parts."""

from __future__ import annotations

import shutil

import pytest

import defsense_fab as df
from defsense_fab.cli.main import main
from tests.support.shared_folders import fill_once
from tests.workflow.conftest import small_bar

POINTS = [[x, 0] for x in (1, 6, 25, 55, 74, 79)]


def build_wired_bar(folder):
    """Build a bar whose cords are bent in opposite directions."""
    cords = [
        df.DrawnCord("top", POINTS, [0, 0, 6], [0, 0, 1], [1, 0, 0], free=()),
        df.DrawnCord("bottom", POINTS, [0, 0, -6], [0, 0, 1], [1, 0, 0], free=()),
    ]
    poses = [df.Pose("bend", ["base"], [df.Handle("tip", (0, 1, 0), 25.0, "free")])]
    small_bar(cords=cords, poses=poses).save(folder / "bar")
    assert main(["fabricate", str(folder / "bar")]) == 0


@pytest.fixture(scope="session")
def wired_bar(tmp_path_factory):
    """Return the folder of the bar."""
    made = fill_once(tmp_path_factory, "wired-bar", build_wired_bar)
    return shutil.copytree(made / "bar", tmp_path_factory.mktemp("wired") / "bar")
