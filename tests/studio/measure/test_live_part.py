"""The device runs live on the studio's page, read from a simulated board."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.studio.edits.cords import add_cord
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.twin.electronics.cords import ReplayedCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.workflow.run import sources
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for

pytestmark = pytest.mark.slow

TIMEOUT_S = 600.0


@pytest.fixture
def board(live_bar, monkeypatch):
    """A read-out board at every port, which replays the bar's cords."""
    run, _ = live_bar.run(40.0, 3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm)
    twin = partial(ReadoutTwin, cords, np.array([1500.0, 1000.0]), speed=4.0, converter="ads1115")
    monkeypatch.setattr(sources, "open_port", lambda url: twin())
    return twin


@pytest.fixture
def live(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].live
    assert part.wait_for_choices(TIMEOUT_S)
    part.set_source("COM3", keeps_readings=False)
    return part


def refresh(part):
    part.refresh()
    assert part.wait_for_choices(TIMEOUT_S)


def run_live(part):
    part.start()
    assert wait_for(lambda: part.session.run is not None or not part.session.is_busy)
    assert part.session.run is not None, part.status.text
    return part.session.run


def stop(part):
    part.stop()
    assert part.session.wait(TIMEOUT_S)


def note_codes(run):
    return {note.code for note in run.loop.status.notes}


def test_models_and_sources_are_offered(live):
    assert live.model_names == ("model.json",)
    assert live.model.problem is None
    assert live.model.about.startswith("quadratic")
    assert live.source_names[0].startswith("twin")
    assert live.is_built


def test_the_device_replaces_the_body_and_is_removed_at_the_end(live, board, studio_page):
    bench = studio_page.bench
    scene = bench.server.scene
    run = run_live(live)
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert wait_for(lambda: not bench.body.visible)
    assert not live.can_start
    assert scene.get_handle_by_name("/live/surface") is not None
    assert run.outputs == []
    live.start()
    assert live.status.code == "busy"
    studio_page.enter("Cords")
    assert bench.body.visible
    assert not run.view.scene.visible
    assert bench.status.code == "live-continues"
    assert run.loop.wait(0)
    studio_page.enter("Measure")
    assert not bench.body.visible
    assert run.view.scene.visible
    stop(live)
    assert bench.body.visible
    assert scene.get_handle_by_name("/live/surface") is None
    assert live.can_start
    assert live.status.error is None


def test_a_run_can_be_repeated_and_ends_with_the_studio(live, board):
    run = run_live(live)
    stop(live)
    assert run_live(live) is not run
    live.close()
    assert not live.session.is_busy
    assert live.session.run is None


def test_outputs_are_sent_only_if_they_are_chosen(live, board, studio_page):
    path = studio_page.bench.project.folder / "live.toml"
    path.write_text('[outputs.osc]\nport = 9123\n[controls]\nup = "bend_up"\n', encoding="utf-8")
    run = run_live(live)
    assert run.outputs == []
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert wait_for(lambda: "up" in run.loop.status.frame.controls)
    stop(live)
    live.set_outputs("osc,port=9124", uses_file=True)
    assert [o.name for o in run_live(live).outputs] == ["osc", "osc 2"]
    stop(live)
    live.set_outputs("horn", uses_file=True)
    live.start()
    assert live.status.code == "unknown-output"
    assert not live.session.is_busy


def test_a_missing_port_is_reported_and_the_body_stays(live, studio_page):
    live.set_source("/dev/nowhere", keeps_readings=False)
    live.start()
    assert live.session.wait(TIMEOUT_S)
    assert live.status.code == "port-not-found"
    assert studio_page.bench.body.visible
    assert live.can_start


def test_a_disconnected_board_is_reported_until_it_is_back(live, board, monkeypatch):
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
    run = run_live(live)
    assert wait_for(lambda: run.loop.status.frame is not None)
    unplugged.set()
    assert wait_for(lambda: "board-disconnected" in note_codes(run))
    assert wait_for(lambda: run.view.panel.notes != "")
    unplugged.clear()
    samples = run.loop.status.samples
    assert wait_for(lambda: run.loop.status.samples > samples + 20)


def test_a_device_without_a_model_cannot_run(live, studio_page):
    folder = studio_page.bench.project.folder
    (folder / "model.json").unlink()
    refresh(live)
    assert live.model is None
    assert live.is_built
    (folder / "build" / "layout.json").unlink()
    refresh(live)
    assert not live.is_built
    live.start()
    assert not live.session.is_busy
    assert live.status.code == "no-model"


@pytest.mark.parametrize(
    "change", [{"layout": "0" * 16}, {"channels": ("a", "b")}, {"device": "cube"}]
)
def test_a_model_that_does_not_fit_the_device_cannot_run(live, studio_page, change):
    path = studio_page.bench.project.folder / "model.json"
    write_model(path, replace(load_model(path), **change))
    refresh(live)
    assert live.model.problem
    live.start()
    assert live.status.code == "model-unusable"
    assert live.model.problem in live.status.text
    assert not live.session.is_busy


def test_a_damaged_model_cannot_run(live, studio_page):
    path = studio_page.bench.project.folder / "model.json"
    path.write_text(path.read_text("utf-8")[:-200], encoding="utf-8")
    refresh(live)
    assert live.model.problem
    live.start()
    assert live.status.code == "model-unusable"


def test_cords_that_differ_from_the_build_are_listed(live, studio_page):
    bench = studio_page.bench
    assert not any("new" in change for change in live.changes)
    sensor = bench.project.device.sensors[0]
    assert bench.apply(add_cord("new", sensor.plane, sensor.curve, []))
    refresh(live)
    assert any("new" in change for change in live.changes)
