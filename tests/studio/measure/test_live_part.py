"""The device runs live on the studio's page, read from a board that plays it."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.runtime.live import live_run as live_run_module
from defsense_fab.studio.edits.cords import add_cord
from defsense_fab.training.models.model_file import load_model, write_model
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.replayed_cords import ReplayedCords
from tests.runtime.live.conftest import NAMES
from tests.runtime.live_frames import wait_for

LONG = 60.0


@pytest.fixture
def board(live_bar, monkeypatch):
    """A read-out board at every port, which says what the bar's cords would."""
    run, _ = live_bar.run(40.0, 3)
    cords = ReplayedCords(NAMES, run.sample_time, run.ohm)
    made = partial(ReadoutTwin, cords, np.array([1500.0, 1000.0]), speed=4.0, converter="ads1115")
    monkeypatch.setattr(live_run_module, "open_port", lambda url: made())
    return made


@pytest.fixture
def live(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].live
    assert part.looked(LONG)
    part._other.value, part._keep.value = "COM3", False
    return part


def runs(part):
    part.start()
    assert wait_for(lambda: part.session.run is not None or not part.session.busy)
    assert part.session.run is not None, part._told.content
    return part.session.run


def test_models_are_listed_with_how_they_were_trained(live):
    assert live._model.options == ("model.json",)
    assert live._known.content.startswith("quadratic, 20")
    assert live._port.options[0] == "twin (simulated)"


def test_the_device_moves_in_place_of_the_body_and_leaves_nothing(live, board, studio_page):
    bench, before = live._bench, set(live._folder._children)
    frames = bench.server.scene._handle_from_node_name
    run = runs(live)
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert wait_for(lambda: not bench.body.visible)
    assert (live._start.visible, live._stop.visible) == (False, True)
    assert "/live/surface" in frames
    assert run.outputs == []
    assert "bar live" in [h.label for h in live._folder._children.values() if hasattr(h, "label")]
    live.start()
    assert "stop it first" in live._told.content
    studio_page.enter("Cords")
    assert bench.body.visible
    assert not run.view.scene.visible
    assert "goes on" in bench._message.content
    assert run.loop.wait(0)
    studio_page.enter("Measure")
    assert not bench.body.visible
    assert run.view.scene.visible
    live.stop()
    assert live.session.wait(LONG)
    assert bench.body.visible
    assert set(live._folder._children) == before
    assert not [name for name in frames if name.startswith("/live")]
    assert (live._start.visible, live._stop.visible) == (True, False)
    assert live._told.content == "The live loop has ended."


def test_it_begins_again_and_the_studio_s_end_ends_it(live, board):
    run = runs(live)
    live.stop()
    assert live.session.wait(LONG)
    assert runs(live) is not run
    live.close()
    assert not live.session.busy
    assert live.session.run is None


def test_outputs_are_off_unless_chosen(live, board, studio_page):
    path = studio_page.bench.project.folder / "live.toml"
    path.write_text('[outputs.osc]\nport = 9123\n[controls]\nup = "bend_up"\n', encoding="utf-8")
    run = runs(live)
    assert run.outputs == []
    assert wait_for(lambda: run.loop.status.frame is not None)
    assert wait_for(lambda: "up" in run.loop.status.frame.controls)
    live.stop()
    assert live.session.wait(LONG)
    live._file.value, live._outputs.value = True, "osc,port=9124"
    assert [o.name for o in runs(live).outputs] == ["osc", "osc 2"]
    live.stop()
    assert live.session.wait(LONG)
    live._outputs.value = "horn"
    live.start()
    assert "no output 'horn'" in live._told.content
    assert not live.session.busy


def test_a_port_that_is_not_there_is_told_and_the_body_stays(live):
    live._other.value = "/dev/nowhere"
    live.start()
    assert live.session.wait(LONG)
    assert "/dev/nowhere: there is no such port" in live._told.content
    assert live._bench.body.visible
    assert live._start.visible


def test_a_port_that_is_unplugged_is_told_while_it_runs(live, board, monkeypatch):
    pulled = threading.Event()

    class Pulled(ReadoutTwin):
        def read(self, size):
            if pulled.is_set():
                raise OSError("unplugged")
            return super().read(size)

    def opened(url):
        if pulled.is_set():
            raise CaptureError(f"{url}: there is no such port")
        return Pulled(*board.args, **board.keywords)

    monkeypatch.setattr(live_run_module, "open_port", opened)
    run = runs(live)
    assert wait_for(lambda: run.loop.status.frame is not None)
    pulled.set()
    assert wait_for(lambda: "the read-out board is gone" in run.view.panel._notes.content)
    pulled.clear()
    seen = run.loop.status.samples
    assert wait_for(lambda: run.loop.status.samples > seen + 20)


def test_without_a_model_it_is_told_what_to_do(live, studio_page):
    (studio_page.bench.project.folder / "model.json").unlink()
    live.refresh()
    assert live.looked(LONG)
    assert "There is no model in this folder yet" in live._known.content
    assert "not built" not in live._known.content
    (studio_page.bench.project.folder / "build" / "layout.json").unlink()
    live._about()
    assert "The device is not built: build it under *Make*" in live._known.content
    live.start()
    assert not live.session.busy
    assert "record a session and train on it" in live._told.content


def test_a_model_of_other_cords_is_refused_with_what_to_do(live, studio_page):
    path = studio_page.bench.project.folder / "model.json"
    model = load_model(path)
    for change, said in (
        ({"layout": "0" * 16}, "trained with other cords"),
        ({"channels": ("a", "b")}, "were they renamed?"),
        ({"device": "cube"}, "a model of another device, cube"),
    ):
        write_model(path, replace(model, **change))
        live.refresh()
        assert live.looked(LONG)
        assert said in live._known.content
        live.start()
        assert said in live._told.content
        assert not live.session.busy
    path.write_text(path.read_text("utf-8")[:-200], encoding="utf-8")
    live.refresh()
    assert live.looked(LONG)
    assert "model.json: not valid JSON" in live._known.content


def test_cords_that_were_changed_since_the_build_are_told(live, studio_page):
    bench = studio_page.bench
    sensor = bench.project.device.sensors[0]
    assert bench.apply(add_cord("new", sensor.plane, sensor.curve, []))
    live.refresh()
    assert live.looked(LONG)
    assert "- left, middle, new: a cord of device.toml, and not built" in live._known.content
