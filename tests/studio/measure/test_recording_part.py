"""A device is recorded step by step, watched on the page."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.reader import Reader
from defsense_fab.capture.sessions.guided_recording import CameraView, CaptureView
from defsense_fab.core.markers import Markers, write_markers_file
from defsense_fab.studio.measure.recording_screen import small_picture, WIDTH
from defsense_fab.studio.measure.recording_screen import RecordingScreen
from defsense_fab.studio.measure.recording_screen import coverage_bars, step_words
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.replayed_cords import ReplayedCords
from defsense_fab.twin.live import capture_setup
from defsense_fab.twin.live.sample_sources import OpenedSource
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for

LONG = 60.0
QUAD = np.array([[[2.0, 2], [20, 2], [20, 20], [2, 20]]])
VIEW = CaptureView(
    "ready", 1, (("rest", 4.0), ("bend<b>", 8.0)), 8.0,
    (CameraView("cam_0", np.zeros((48, 64, 3), np.uint8), QUAD, (7,), np.array([True]), 14.6, 0),
     CameraView("cam_1", None, np.zeros((0, 4, 2)), (), np.zeros(0, bool), 0.0, 0)),
    NAMES, np.array([0.01, np.nan]), np.zeros((0, 2)),
    {"bend<b>": (0.4, np.array([False, True, False, False, False]))}, 3, 1, 12, 0.21, 120, 30,
    ("camera cam_1 is gone: plug it in again",), "Show bend.",
)  # fmt: skip


@pytest.fixture
def recording(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].recording
    part._cameras.value, part._port.value, part._rounds.value = "none", "COM3", 1
    return part


@pytest.fixture
def board(live_bar, monkeypatch, studio_page):
    """A read-out board at every port, and the device's tags."""
    run, _ = live_bar.run(40.0, 3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm)
    made = partial(ReadoutTwin, cords, np.array([1500.0, 1000.0]), speed=4.0)
    monkeypatch.setattr(
        capture_setup, "open_source", lambda port, settings: OpenedSource(Reader(made, port, settings))
    )
    axes, places = np.tile(np.eye(3), (3, 1, 1)), live_bar.rest_points[:3]
    tags = Markers("bar", "4X4_50", 6.0, np.arange(3), places, axes, np.ones(3, bool))
    folder = studio_page.bench.project.folder / "markers"
    folder.mkdir()
    write_markers_file(tags, folder / "markers.json")


def test_a_recording_is_stopped_and_gone_on_with(recording, board):
    before = set(recording._folder._children)
    for _ in range(2):
        recording.start()
        assert wait_for(lambda: recording.screen is not None or not recording.busy)
        assert recording.screen is not None, recording._told.content
        assert not recording._asked.visible
        said = recording.screen._said
        assert wait_for(lambda said=said: "1 of 5: rest" in said.content)
        recording.screen.press("enter")
        recording.screen.press("q")
        assert recording.wait(LONG)
        assert "`session`: 0 of 5 steps were shown; *Record* goes on" in recording._told.content
        assert recording._asked.visible
        assert set(recording._folder._children) == before
    runs = recording._bench.project.folder / "session"
    assert len(list(runs.glob("run-*"))) == 2


def test_the_studio_s_end_ends_it(recording, board):
    recording.start()
    assert wait_for(lambda: recording.screen is not None or not recording.busy)
    recording.close()
    assert not recording.busy


def test_what_lacks_is_told_with_what_to_do(recording, board, studio_page):
    recording._cameras.value = "0 2"
    recording.start()
    assert recording.wait(LONG)
    assert "cameras.toml: cannot be read" in recording._told.content
    assert not (studio_page.bench.project.folder / "session").exists() or not list(
        (studio_page.bench.project.folder / "session").iterdir()
    )
    recording._cameras.value = "none"
    recording._port.value = "twin"
    recording.start()
    assert recording.wait(LONG)
    assert "a twin has its own cameras and read-out board" in recording._told.content
    for name in ("..", "a/b", ""):
        recording._name.value = name
        recording.start()
        assert "give the name of a folder" in recording._told.content
        assert not recording.busy


def test_without_tags_it_is_told_how_they_are_made(recording):
    recording.start()
    assert recording.wait(LONG)
    assert "defsense capture markers" in recording._told.content


def test_what_is_seen_is_shown_and_taken_away(recording):
    gui = recording._bench.server.gui
    folder = gui.add_folder("test")
    screen = RecordingScreen(recording._bench, folder, NAMES)
    screen.show(VIEW)
    assert "2 of 2: bend<b>, 8 s" in screen._said.content
    assert [len(x) for x in screen._plot.data] == [1, 1, 1]
    words, shown = screen._cameras["cam_0"]
    assert words.content == "cam_0: 1 tags, 15 pictures/s"
    assert shown.image.shape[1] == WIDTH
    screen._pictured = screen._drawn = 0.0
    screen.show(replace(VIEW, cameras=VIEW.cameras[1:]))
    assert set(screen._cameras) == {"cam_0", "cam_1"}
    screen.press("r")
    assert screen.key(LONG) == "r"
    screen.close()
    assert not folder._children
    folder.remove()


def test_words_and_bars_say_what_is_next_and_what_was_seen():
    told = step_words(VIEW)
    assert "**Show bend.** *Begin* when you are ready." in told
    assert "tags: 3 of 12 by several cameras, 1 by one" in told
    assert "- **camera cam_1 is gone: plug it in again**" in told
    bars = coverage_bars(VIEW.reached)
    assert "bend&lt;b&gt;" in bars
    assert bars.count("#1f77b4") == 1
    assert "40 %" in bars
    assert coverage_bars({}) == ""


def test_tags_are_outlined_in_small_pictures():
    picture = small_picture(VIEW.cameras[0])
    assert picture.shape == (240, WIDTH, 3)
    assert (picture.reshape(-1, 3) == (0, 158, 115)).all(axis=1).any()
    assert small_picture(VIEW.cameras[1]).shape == (180, WIDTH, 3)
