"""A device is recorded step by step on the page."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.reader import Reader
from defsense_fab.core.markers import Markers, write_markers_file
from defsense_fab.twin.electronics.cords import ReplayedCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.live.sample_sources import OpenedSource
from defsense_fab.workflow.sessions import recording as recording_module
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for

TIMEOUT_S = 600.0


@pytest.fixture
def part(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].recording
    part.set_options(cameras="none", port="COM3", rounds=1)
    return part


@pytest.fixture
def board(live_bar, monkeypatch, studio_page):
    """A read-out board at every port, and the device's tags."""
    run, _ = live_bar.run(40.0, 3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm)
    twin = partial(ReadoutTwin, cords, np.array([1500.0, 1000.0]), speed=4.0)
    monkeypatch.setattr(
        recording_module,
        "open_source",
        lambda port, settings: OpenedSource(Reader(twin, port, settings)),
    )
    axes, centers = np.tile(np.eye(3), (3, 1, 1)), live_bar.rest_points[:3]
    tags = Markers("bar", "4X4_50", 6.0, np.arange(3), centers, axes, np.ones(3, bool))
    folder = studio_page.bench.project.folder / "markers"
    folder.mkdir()
    write_markers_file(tags, folder / "markers.json")


def test_a_recording_is_stopped_and_continued(part, board, studio_page):
    for _ in range(2):
        part.start()
        assert wait_for(lambda: part.recording.screen is not None or not part.recording.is_busy)
        assert part.recording.screen is not None, part.status.text
        assert not part.shows_options
        screen = part.recording.screen
        assert wait_for(lambda screen=screen: screen.view is not None)
        assert screen.view.state.step == 0
        screen.press("enter")
        screen.press("q")
        assert part.recording.wait(TIMEOUT_S)
        assert part.status.code == "recording-incomplete"
        assert (part.recording.finished_steps, part.recording.step_count) == (0, 5)
        assert part.shows_options
        assert part.recording.screen is None
    runs = studio_page.bench.project.folder / "session"
    assert len(list(runs.glob("run-*"))) == 2


def test_a_recording_ends_with_the_studio(part, board):
    part.start()
    assert wait_for(lambda: part.recording.screen is not None or not part.recording.is_busy)
    part.close()
    assert not part.recording.is_busy


def test_a_missing_camera_file_is_reported_and_leaves_no_session(part, board, studio_page):
    part.set_options(cameras="0 2")
    part.start()
    assert part.recording.wait(TIMEOUT_S)
    assert part.status.code == "file-unreadable"
    session = studio_page.bench.project.folder / "session"
    assert not session.exists() or not list(session.iterdir())


def test_a_twin_board_needs_twin_cameras(part, board):
    part.set_options(port="twin")
    part.start()
    assert part.recording.wait(TIMEOUT_S)
    assert part.status.code == "twin-incomplete"


@pytest.mark.parametrize("name", ["..", "a/b", ""])
def test_the_session_must_be_a_folder_of_the_device(part, name):
    part.set_options(name=name)
    part.start()
    assert part.status.code == "invalid-session-name"
    assert not part.recording.is_busy


def test_a_device_without_tags_is_not_recorded(part):
    part.start()
    assert part.recording.wait(TIMEOUT_S)
    assert part.status.code == "file-not-found"
