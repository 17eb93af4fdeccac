"""What the device is: its parameters, its material, and what of the build they make old."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError, DefsenseError, StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.studio.device.body_preview import BodyPreview
from defsense_fab.studio.device.device_mode import first_outdated_stage
from defsense_fab.studio.project import project as project_module
from tests.conftest import box_surface

LONG = 60.0


@pytest.fixture
def mode(studio_page, monkeypatch):
    """The mode, whose previews are counted and not made."""
    begun = []
    monkeypatch.setattr(BodyPreview, "start", lambda _, folder: begun.append(folder))
    made = studio_page.modes["Device"]
    made.begun = begun
    return made


def by_hand(control, value):
    """What a browser does."""
    control.value = value
    for told in control._impl.update_cb:
        told(SimpleNamespace(client=object(), target=control))


def test_it_is_the_first_mode_and_shows_the_device(mode, studio_page):
    assert next(iter(studio_page.modes)) == "Device"
    device = studio_page.bench.project.device
    controls = mode.parameters.controls
    assert {n: c.value for n, c in controls.items()} == dict(device.body.parameters)
    assert mode.catalogue.name.value == device.name
    assert mode.catalogue.material.value.startswith(device.material.name)
    assert mode.catalogue.edge.value == device.mesh.edge_length
    assert mode.begun == []  # nothing runs unasked where there is a build


def test_a_drag_of_a_slider_is_one_step_and_the_body_follows(mode, studio_page):
    project = studio_page.bench.project
    length = mode.parameters.controls["length"]
    was = length.value
    for value in (101.0, 102.0, 103.0):
        by_hand(length, value)
    mode.flush()
    assert project.undo_name == "set length to 103"
    assert project.device.body.parameters["length"] == 103
    assert mode.wait(LONG)
    assert mode.begun == [project.folder]
    assert mode.outdated_stage == "body"
    project.undo()
    assert length.value == was
    assert project.undo_name is None


def test_what_another_program_writes_is_shown_but_not_what_a_hand_holds(mode, studio_page):
    project = studio_page.bench.project
    controls = mode.parameters.controls
    by_hand(controls["width"], 44.0)
    path = project.folder / "device.toml"
    text = project.text
    length = project.device.body.parameters["length"]
    assert f"length = {length:g}" in text
    path.write_text(text.replace(f"length = {length:g}", "length = 91"))
    studio_page.poll()
    assert controls["length"].value == 91
    assert controls["width"].value == 44
    mode.flush()
    assert project.device.body.parameters["width"] == 44
    assert project.device.body.parameters["length"] == 91


def test_values_of_the_catalogue_are_steps_of_their_own(mode, studio_page):
    project, catalogue = studio_page.bench.project, mode.catalogue
    by_hand(catalogue.material, next(w for w in catalogue.material.options if "ninjaflex-85a" in w))
    assert project.device.material.name == "ninjaflex-85a"
    by_hand(catalogue.cord, next(w for w in catalogue.cord.options if "1.7mm" in w))
    assert project.device.cord.name == "rubber-1.7mm"
    by_hand(catalogue.printer, next(w for w in catalogue.printer.options if "polyjet" in w))
    assert project.device.fabrication.process == "polyjet"
    by_hand(catalogue.decoder, "kernel")
    assert project.device.decoder == "kernel"
    for control, value in ((catalogue.edge, 9.5), (catalogue.cords, 5), (catalogue.name, "grip")):
        by_hand(control, value)
    mode.flush()
    device = project.device
    assert (device.mesh.edge_length, len(device.sensors) + device.propose, device.name) == (
        9.5, 5, "grip",
    )  # fmt: skip
    assert mode.begun == []  # the body is as it was
    for typed, searches in ((2, 2), (0, None)):
        by_hand(catalogue.searches, typed)
        mode.flush()
        assert project.device.searches == searches
        catalogue.show(project.device, lambda key: False)
        assert catalogue.searches.value == typed
    while project.undo():
        pass
    assert project.device.name == "bar"


def test_what_cannot_be_is_told_and_the_control_goes_back(mode, studio_page):
    by_hand(mode.catalogue.name, "")
    by_hand(mode.catalogue.edge, 0.0)
    mode.flush()
    assert studio_page.bench.error is not None
    assert mode.catalogue.name.value == "bar"
    assert mode.catalogue.edge.value == studio_page.bench.project.device.mesh.edge_length


@pytest.mark.parametrize("why", ["disk-full", "folder-not-writable"])
def test_a_full_disk_or_a_read_only_folder_is_told_and_nothing_is_lost(
    mode, studio_page, monkeypatch, why
):
    project = studio_page.bench.project
    before = project.text

    def refuse(path, text):
        raise StorageError("cannot be written", code=why, where=path)

    with monkeypatch.context() as patch:
        patch.setattr(project_module, "write_text", refuse)
        by_hand(mode.parameters.controls["length"], 111.0)
        mode.flush()
        assert studio_page.bench.message_code == why
        assert project.text == before
        assert mode.parameters.controls["length"].value != 111
    by_hand(mode.parameters.controls["length"], 111.0)
    mode.flush()
    assert project.device.body.parameters["length"] == 111


def test_a_history_that_cannot_be_written_leaves_file_and_page_agreeing(studio_page, monkeypatch):
    bench = studio_page.bench
    length = studio_page.modes["Device"].parameters.controls["length"]

    def refuse(*given):
        raise StorageError("the disk is full", code="disk-full", where="history.jsonl")

    monkeypatch.setattr(type(bench.project._history), "_append", refuse)
    monkeypatch.setattr(type(bench.project._history), "_rewrite", refuse)
    by_hand(length, 77.0)
    studio_page.modes["Device"].flush()
    assert bench.message_code == "disk-full"
    assert "length = 77" in (bench.project.folder / "device.toml").read_text("utf-8")
    assert bench.project.device.body.parameters["length"] == 77


def test_a_body_that_is_not_built_is_shown_apart_in_this_mode(mode, studio_page):
    bench = studio_page.bench
    other = box_surface([0, 0, 0], [400, 10, 10])
    mode.preview.on_surface(Surface(other.vertices, other.faces))
    assert bench.surface is not None
    assert np.ptp(bench.surface.vertices, axis=0).max() < 400  # other modes have that of the build
    assert mode.is_preview_visible
    assert not bench.body.visible
    studio_page.enter("Cords")
    assert not mode.is_preview_visible
    assert bench.body.visible
    studio_page.enter("Device")
    assert mode.is_preview_visible
    assert "400 × 10 × 10 mm" in mode.body_text


def test_without_a_build_the_body_is_that_of_all_modes(mode, studio_page):
    bench = studio_page.bench
    bench.built, bench.surface = False, None
    mode.preview.on_surface(box_surface([0, 0, 0], [40, 10, 10]))
    assert bench.size == 40
    assert bench.body.visible
    assert not mode.is_preview_visible


def test_a_script_that_is_written_anew_has_other_controls(mode, studio_page):
    studio_page.poll()
    project = studio_page.bench.project
    path = project.device.body.path
    path.write_text(
        "from typing import Annotated\n"
        "def body(length: Annotated[float, (50, 200)] = 100, hollow=True, width=1, height=1):\n"
        "    pass\n"
    )
    studio_page.poll()
    controls = mode.parameters.controls
    assert list(controls) == ["length", "hollow", "width", "height"]
    assert (controls["length"].min, controls["length"].max) == (50, 200)
    assert mode.wait(LONG)
    assert mode.begun == [project.folder]
    path.write_text("def body(length=100:\n")
    studio_page.poll()
    assert mode.parameters.controls == {}
    assert mode.parameters.error.code == "script-syntax"


def test_a_preview_that_fails_says_why_where_the_body_is(mode):
    mode.make_body()
    assert mode.state == "making"
    error = BodyError("no room", code="script-raises")
    mode.preview.on_error(error)
    assert mode.state == "failed"
    assert mode.error is error


class FakeWork:
    """A build that ends when the test says so."""

    def __init__(self):
        self.running, self.started, self.cancelled = False, 0, 0

    def start(self, job, folder):
        began = not self.running
        self.running, self.started = True, self.started + began
        return began

    def cancel(self):
        self.cancelled += 1


def test_previews_are_of_the_newest_and_one_that_is_stopped_says_nothing(tmp_path):
    made, failed = [], []
    preview = BodyPreview(lambda *told: None, made.append, failed.append)
    work = preview.job = FakeWork()

    def end(problem):
        work.running = False
        preview.finish(None if problem is None else DefsenseError("failed", code=problem))

    preview.start(tmp_path)
    preview.start(tmp_path)  # of another body
    assert (work.started, work.cancelled) == (1, 1)
    end("cancelled")
    assert work.started == 2
    preview.cancel()
    end("cancelled")
    assert (made, failed, work.started) == ([], [], 2)
    preview.start(tmp_path)
    end("boom")
    assert [e.code for e in failed] == ["boom"]
    preview.start(tmp_path)
    end(None)  # and yet there is no file
    assert failed[1].code == "file-unreadable"


def test_the_first_outdated_stage_is_named():
    stages = ("body", "mesh", "simulate", "optimize", "fabricate", "report")
    states = dict.fromkeys(stages, "current")
    assert first_outdated_stage(states) is None
    assert first_outdated_stage({**states, "simulate": "old", "report": "old"}) == "simulate"
    missing = dict.fromkeys(stages, "missing")
    assert first_outdated_stage({**missing, "body": "old"}) is None
