"""The board is checked and the device recorded, step by step, with buttons of the page."""

from __future__ import annotations

import shutil
from functools import partial

import numpy as np
import pytest

from defsense_fab.capture.readout.reader import Reader
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.core.markers import Markers, write_markers_file
from defsense_fab.store.build import Build
from defsense_fab.studio.messages import measure as messages
from defsense_fab.twin.electronics.cords import ReplayedCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.live.sample_sources import OpenedSource
from defsense_fab.workflow.sessions import recording as recording_module
from defsense_fab.workflow.view import live_messages
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for
from tests.studio.steps.measure_page import TIMEOUT_S, MeasurePage, write_specimen
from tests.workflow.board.conftest import wired_bar as wired_bar_fixture

wired_bar = wired_bar_fixture

RECORDING = {
    "port": "COM3",
    "cameras": "none",
    "calibration": "cameras.toml",
    "session": "session",
    "rounds": 1,
    "seconds": 8.0,
}
CHECK = {"wiggle": False, "poses": False, "reference": []}


def page_of(built, folder):
    shutil.copytree(built, folder)
    page = MeasurePage(folder)
    yield page
    page.close()


@pytest.fixture
def page(live_bar, tmp_path):
    yield from page_of(live_bar.folder, tmp_path / "bar")


@pytest.fixture
def wired_page(wired_bar, tmp_path):
    yield from page_of(wired_bar, tmp_path / "bar")


@pytest.fixture
def board(live_bar, monkeypatch, page):
    """A read-out board at every port, and the device's tags."""
    connect(page, live_bar, monkeypatch)


def connect(page, live_bar, monkeypatch):
    """Connect a read-out board to every port, and write the tags of a page's device."""
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
    folder = page.folder / "markers"
    folder.mkdir()
    write_markers_file(tags, folder / "markers.json")


def press(page, key):
    """Press a key, as the buttons of the shown state do."""
    state = page.server.events[live_messages.GuidedState]
    page.send(live_messages.PressKey, key=key, step=state.step, phase=state.phase)


def shown(page):
    return page.server.events[live_messages.GuidedState]


def ended(page, task):
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.step.guided.screen is None
    assert shown(page).run == ""
    return page.status(task)


def test_a_recording_is_stopped_and_continued(page, board):
    for _ in range(2):
        page.send(messages.StartRecording, **RECORDING)
        assert page.refusal(messages.StartRecording, **RECORDING) == "busy"
        screen = page.wait_for_screen()
        assert shown(page).run == "Record the device"
        assert screen.view.state.step == 0
        press(page, "enter")
        assert wait_for(lambda: shown(page).phase == "active")
        page.send(messages.StopGuided)
        status = ended(page, "record")
        assert status.code == "recording-incomplete"
        assert "0 of 5 steps" in status.text
    assert len(list((page.folder / "session").glob("run-*"))) == 2


def test_recorded_resistances_use_the_resistors_of_the_guide(wired_page, live_bar, monkeypatch):
    connect(wired_page, live_bar, monkeypatch)
    wired_page.send(messages.StartRecording, **RECORDING)
    wired_page.wait_for_screen()
    build = Build(wired_page.folder / "build")
    proposed = {cord.sensor: cord.reference_resistor for cord in build.manifest.cords}
    session = sessions.load(wired_page.folder / "session")
    assert dict(zip(session.channels, session.reference, strict=True)) == proposed
    wired_page.send(messages.StopGuided)
    ended(wired_page, "record")


def test_a_recording_ends_with_the_studio(page, board):
    page.send(messages.StartRecording, **RECORDING)
    page.wait_for_screen()
    page.step.guided.close()
    assert not page.step.guided.is_busy


@pytest.mark.parametrize("name", ["..", "a/b", "", ".", ".studio", "a\0b", "CON"])
def test_the_session_must_be_a_folder_of_the_device(page, name):
    request = {**RECORDING, "session": name}
    assert page.refusal(messages.StartRecording, **request) == "invalid-session-name"
    assert not page.step.guided.is_busy


def test_a_session_takes_no_folder_with_other_content(page, tmp_path):
    (page.folder / "notes").mkdir()
    (page.folder / "notes" / "mine.txt").write_text("mine", encoding="utf-8")
    for name, code in (("build", "file-exists"), ("notes", "file-exists")):
        assert page.refusal(messages.StartRecording, **{**RECORDING, "session": name}) == code
    (tmp_path / "other").mkdir()
    (page.folder / "linked").symlink_to(tmp_path / "other")
    request = {**RECORDING, "session": "linked"}
    assert page.refusal(messages.StartRecording, **request) == "outside-device-folder"
    request = {**RECORDING, "calibration": "../../cameras.toml"}
    assert page.refusal(messages.StartRecording, **request) == "outside-device-folder"


def test_a_missing_camera_file_is_reported_and_leaves_no_session(page, board):
    page.send(messages.StartRecording, **{**RECORDING, "cameras": "0 2"})
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.status("record").problem.code == "file-unreadable"
    session = page.folder / "session"
    assert not session.exists() or not list(session.iterdir())


def test_a_twin_board_needs_twin_cameras(page, board):
    page.send(messages.StartRecording, **{**RECORDING, "port": "twin"})
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.status("record").problem.code == "twin-incomplete"


def test_a_device_without_tags_is_not_recorded(page):
    page.send(messages.StartRecording, **RECORDING)
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.status("record").problem.code == "file-not-found"


def test_a_specimen_is_measured_jig_by_jig(page):
    write_specimen(page.folder)
    page.send(messages.MeasureSpecimen, port="twin:speed=50", specimen="specimen")
    screen = page.wait_for_screen()
    press(page, "enter")
    assert wait_for(lambda: len(screen.view.state.done) == 1)
    assert wait_for(lambda: [p.title for p in shown(page).parts if p.__struct_config__.tag])
    page.send(messages.StopGuided)
    status = ended(page, "specimen")
    assert status.code == "measurement-incomplete"
    assert "1 of 24" in status.text


def test_a_missing_specimen_is_reported(page):
    page.send(messages.MeasureSpecimen, port="twin", specimen="specimen")
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.status("specimen").problem.code == "file-not-found"


def test_faults_of_the_wiring_are_found(wired_page):
    page = wired_page
    page.send(messages.StartCheck, port="twin:cut=top", **CHECK)
    page.wait_for_screen()
    press(page, "enter")
    assert ended(page, "check").code == "check-complete"
    result = page.results.check
    assert (result.is_sound, result.is_complete) == (False, True)
    codes = {f.cord: f.code for f in result.findings}
    assert codes == {"top": "open", "bottom": "ok"}
    assert all(f.action for f in result.findings if f.code != "ok")


def test_a_stopped_check_has_no_result(wired_page):
    page = wired_page
    page.send(messages.StartCheck, port="twin", **CHECK)
    page.wait_for_screen()
    press(page, "q")
    assert ended(page, "check").code == "check-stopped"
    assert page.results.check is None


def test_a_missing_board_is_reported(wired_page):
    page = wired_page
    page.send(messages.StartCheck, port="/dev/nowhere", **CHECK)
    assert page.step.guided.wait(TIMEOUT_S)
    assert page.status("check").problem.code == "port-not-found"
