"""The device runs live on the studio's page, read from a simulated board."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.studio.edits.cords import add_cord
from defsense_fab.studio.messages import measure as messages
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.twin.electronics.cords import ReplayedCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.workflow.run import sources
from defsense_fab.workflow.view import live_messages
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for
from tests.studio.steps.measure_page import TIMEOUT_S, MeasurePage

pytestmark = pytest.mark.slow
LIVE = {
    "model": "model.json",
    "port": "COM3",
    "outputs": "",
    "uses_file": False,
    "keeps_readings": False,
}


@pytest.fixture
def page(live_bar, tmp_path):
    shutil.copytree(live_bar.folder, tmp_path / "bar")
    page = MeasurePage(tmp_path / "bar")
    yield page
    page.close()


@pytest.fixture
def board(live_bar, monkeypatch):
    """A read-out board at every port, which replays the bar's cords."""
    run, _ = live_bar.run(40.0, 3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm)
    twin = partial(ReadoutTwin, cords, np.array([1500.0, 1000.0]), speed=4.0, converter="ads1115")
    monkeypatch.setattr(sources, "open_port", lambda url: twin())
    return twin


def run_live(page, **changes):
    page.send(messages.StartLive, **{**LIVE, **changes})
    live = page.step.live
    assert wait_for(lambda: live.run is not None or not live.is_busy)
    assert live.run is not None, page.status("live")
    return live.run


def stop(page):
    page.send(messages.StopLive)
    assert page.step.live.wait(TIMEOUT_S)


def test_frames_are_sent_to_browsers_that_watch(page, board):
    run = run_live(page)
    device = page.server.events[live_messages.LiveDevice]
    assert (device.channels, device.has_surface) == (list(NAMES), True)
    assert page.server.arrays["live-device"].arrays["faces"].shape[1] == 3
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert page.browser.posted == []
    page.send(live_messages.WatchLive, is_watching=True)
    assert wait_for(lambda: len(page.browser.posted) > 2)
    page.send(live_messages.TakeRest)
    assert page.refusal(messages.StartLive, **LIVE) == "busy"
    stop(page)
    assert page.server.events[live_messages.LiveDevice].name == ""
    assert page.status("live").problem is None
    assert page.refusal(live_messages.TakeRest) == "not-running"


def test_a_run_can_be_repeated_and_ends_with_the_studio(page, board):
    run = run_live(page)
    stop(page)
    assert run_live(page) is not run
    page.step.close()
    assert not page.step.live.is_busy
    assert page.step.live.run is None


def test_outputs_are_sent_only_if_they_are_chosen(page, board):
    path = page.folder / "live.toml"
    path.write_text('[outputs.osc]\nport = 9123\n[controls]\nup = "bend_up"\n', encoding="utf-8")
    run = run_live(page)
    assert run.outputs == []
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert wait_for(lambda: "up" in run.loop.status.frame.controls)
    stop(page)
    run = run_live(page, outputs="osc,port=9124", uses_file=True)
    assert [o.name for o in run.outputs] == ["osc", "osc 2"]
    stop(page)
    assert page.refusal(messages.StartLive, **{**LIVE, "outputs": "horn"}) == "unknown-output"
    assert not page.step.live.is_busy


def test_a_missing_port_is_reported(page):
    page.send(messages.StartLive, **{**LIVE, "port": "/dev/nowhere"})
    assert page.step.live.wait(TIMEOUT_S)
    assert page.status("live").problem.code == "port-not-found"
    assert page.status("live").state == "idle"


def test_a_disconnected_board_is_reported_until_it_is_back(page, board, monkeypatch):
    unplugged = threading.Event()

    class UnpluggedBoard(ReadoutTwin):
        def read(self, size):
            if unplugged.is_set():
                raise OSError("unplugged")
            return super().read(size)

    def open_board(url):
        if unplugged.is_set():
            raise CaptureError("there is no such port", code="port-not-found", where=url)
        return UnpluggedBoard(*board.args, **board.keywords)

    monkeypatch.setattr(sources, "open_port", open_board)
    run = run_live(page)
    assert wait_for(lambda: run.loop.status.frame is not None)
    unplugged.set()
    codes = lambda: {note.code for note in run.loop.status.notes}  # noqa: E731
    assert wait_for(lambda: "board-disconnected" in codes())
    assert wait_for(lambda: page.server.events[live_messages.LiveNotes].notes != [])
    unplugged.clear()
    samples = run.loop.status.samples
    assert wait_for(lambda: run.loop.status.samples > samples + 20)


def test_a_device_without_a_model_cannot_run(page):
    (page.folder / "model.json").unlink()
    assert page.refresh().models == []
    assert page.refusal(messages.StartLive, **LIVE) == "no-model"
    (page.folder / "build" / "layout.json").unlink()
    assert not page.refresh().is_built


@pytest.mark.parametrize(
    "change", [{"layout": "0" * 16}, {"channels": ("a", "b")}, {"device": "cube"}]
)
def test_a_model_that_does_not_fit_the_device_cannot_run(page, change):
    path = page.folder / "model.json"
    write_model(path, replace(load_model(path), **change))
    assert page.refresh().models[0].problem
    assert page.refusal(messages.StartLive, **LIVE) == "model-unusable"


def test_a_damaged_model_cannot_run(page):
    path = page.folder / "model.json"
    path.write_text(path.read_text("utf-8")[:-200], encoding="utf-8")
    assert page.refusal(messages.StartLive, **LIVE) == "model-unusable"


def test_cords_that_differ_from_the_build_are_listed(page):
    assert not any("new" in change for change in page.refresh().changes)
    sensor = page.session.device.sensors[0]
    page.session.apply(add_cord("new", sensor.plane, sensor.curve, []))
    assert any("new" in change for change in page.refresh().changes)
