"""A device is recorded step by step on the page."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.reader import Reader
from defsense_fab.capture.sessions.guided_recording import CameraView, CaptureView
from defsense_fab.core.markers import Markers, write_markers_file
from defsense_fab.studio.measure.recording_screen import (
    PICTURE_WIDTH,
    RecordingScreen,
    camera_text,
    coverage_bars,
    small_picture,
    step_text,
)
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.replayed_cords import ReplayedCords
from defsense_fab.twin.live import capture_setup
from defsense_fab.twin.live.sample_sources import OpenedSource
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for

TIMEOUT_S = 60.0
OUTLINE = np.array([[[2.0, 2], [20, 2], [20, 20], [2, 20]]])
VIEW = CaptureView(
    phase="ready",
    step=1,
    steps=(("rest", 4.0), ("bend<b>", 8.0)),
    left=8.0,
    cameras=(
        CameraView(
            "cam_0", np.zeros((48, 64, 3), np.uint8), OUTLINE, (7,), np.array([True]), 14.6, 0
        ),
        CameraView("cam_1", None, np.zeros((0, 4, 2)), (), np.zeros(0, bool), 0.0, 0),
    ),
    channels=NAMES,
    signals=np.array([0.01, np.nan]),
    history=np.zeros((0, 2)),
    reached={"bend<b>": (0.4, np.array([False, True, False, False, False]))},
    several=3,
    single=1,
    tags=12,
    residual=0.21,
    samples=120,
    frames=30,
    notes=("camera cam_1 is gone",),
    next="Show bend.",
)


@pytest.fixture
def recording(studio_page):
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
        capture_setup,
        "open_source",
        lambda port, settings: OpenedSource(Reader(twin, port, settings)),
    )
    axes, centers = np.tile(np.eye(3), (3, 1, 1)), live_bar.rest_points[:3]
    tags = Markers("bar", "4X4_50", 6.0, np.arange(3), centers, axes, np.ones(3, bool))
    folder = studio_page.bench.project.folder / "markers"
    folder.mkdir()
    write_markers_file(tags, folder / "markers.json")


def test_a_recording_is_stopped_and_continued(recording, board, studio_page):
    before = set(recording.folder._children)
    for _ in range(2):
        recording.start()
        assert wait_for(lambda: recording.screen is not None or not recording.busy)
        assert recording.screen is not None, recording.status.text
        assert not recording.shows_options
        screen = recording.screen
        assert wait_for(lambda screen=screen: screen.view is not None)
        assert (screen.view.step, len(screen.view.steps)) == (0, 5)
        screen.press("enter")
        screen.press("q")
        assert recording.wait(TIMEOUT_S)
        assert recording.status.code == "recording-incomplete"
        assert (recording.finished_steps, recording.step_count) == (0, 5)
        assert recording.shows_options
        assert set(recording.folder._children) == before
    runs = studio_page.bench.project.folder / "session"
    assert len(list(runs.glob("run-*"))) == 2


def test_a_recording_ends_with_the_studio(recording, board):
    recording.start()
    assert wait_for(lambda: recording.screen is not None or not recording.busy)
    recording.close()
    assert not recording.busy


def test_a_missing_camera_file_is_reported_and_leaves_no_session(recording, board, studio_page):
    recording.set_options(cameras="0 2")
    recording.start()
    assert recording.wait(TIMEOUT_S)
    assert recording.status.code == "file-unreadable"
    session = studio_page.bench.project.folder / "session"
    assert not session.exists() or not list(session.iterdir())


def test_a_twin_board_needs_twin_cameras(recording, board):
    recording.set_options(port="twin")
    recording.start()
    assert recording.wait(TIMEOUT_S)
    assert recording.status.code == "twin-incomplete"


@pytest.mark.parametrize("name", ["..", "a/b", ""])
def test_the_session_must_be_a_folder_of_the_device(recording, name):
    recording.set_options(name=name)
    recording.start()
    assert recording.status.code == "invalid-session-name"
    assert not recording.busy


def test_a_device_without_tags_is_not_recorded(recording):
    recording.start()
    assert recording.wait(TIMEOUT_S)
    assert recording.status.code == "file-not-found"


def test_the_screen_shows_the_state_and_is_removed(recording, studio_page):
    folder = studio_page.bench.server.gui.add_folder("test")
    screen = RecordingScreen(studio_page.bench, folder, NAMES)
    screen.text_interval_s = screen.picture_interval_s = 0.0
    screen.show(VIEW)
    assert screen.view is VIEW
    assert screen.pictures["cam_0"].shape[1] == PICTURE_WIDTH
    screen.show(replace(VIEW, cameras=VIEW.cameras[1:]))
    assert set(screen.pictures) == {"cam_0", "cam_1"}
    screen.press("r")
    assert screen.key(TIMEOUT_S) == "r"
    screen.close()
    assert not folder._children
    folder.remove()


def test_step_text_has_the_step_the_counts_and_the_notes():
    text = step_text(VIEW)
    assert "2 of 2: bend<b>, 8 s" in text
    assert VIEW.next in text
    assert "3 of 12" in text
    assert "0.21 px" in text
    assert f"- **{VIEW.notes[0]}**" in text


def test_coverage_bars_show_the_seen_parts():
    bars = coverage_bars(VIEW.reached)
    assert "bend&lt;b&gt;" in bars
    assert bars.count("#1f77b4") == 1
    assert "40 %" in bars
    assert coverage_bars({}) == ""


def test_pictures_are_small_and_have_outlined_tags():
    picture = small_picture(VIEW.cameras[0])
    assert picture.shape == (240, PICTURE_WIDTH, 3)
    assert (picture.reshape(-1, 3) == (0, 158, 115)).all(axis=1).any()
    assert small_picture(VIEW.cameras[1]).shape == (180, PICTURE_WIDTH, 3)


def test_camera_text_has_the_tags_and_the_rate():
    text = camera_text(VIEW.cameras[0])
    assert text.startswith("cam_0: 1 ")
    assert "15 " in text
