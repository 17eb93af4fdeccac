"""The Device mode: parameters, materials, the preview of the body, and outdated builds."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError, DefsenseError, StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.studio.device.body_preview import BodyPreview
from defsense_fab.studio.device.device_mode import first_outdated_stage
from defsense_fab.studio.project import project as project_module
from defsense_fab.studio.project.history import History
from tests.conftest import box_surface
from tests.studio.devices import set_by_user

pytestmark = pytest.mark.slow

TIMEOUT_S = 600.0


@pytest.fixture
def mode(studio_page, monkeypatch):
    """Return the mode with a list `previews` of folders, for which no preview is made."""
    previews = []
    monkeypatch.setattr(BodyPreview, "start", lambda _, folder: previews.append(folder))
    mode = studio_page.modes["Device"]
    mode.previews = previews
    return mode


def test_the_first_mode_shows_the_device(mode, studio_page):
    assert next(iter(studio_page.modes)) == "Device"
    device = studio_page.bench.project.device
    controls = mode.parameters.controls
    assert {n: c.value for n, c in controls.items()} == dict(device.body.parameters)
    assert mode.catalogue.name.value == device.name
    assert mode.catalogue.material.value.startswith(device.material.name)
    assert mode.catalogue.edge.value == device.mesh.edge_length
    assert mode.previews == []  # the build has a body


def test_a_dragged_slider_is_one_step_and_the_body_follows(mode, studio_page):
    project = studio_page.bench.project
    length = mode.parameters.controls["length"]
    before = length.value
    for value in (101.0, 102.0, 103.0):
        set_by_user(length, value)
    mode.flush()
    assert project.undo_name == "set length to 103"
    assert project.device.body.parameters["length"] == 103
    assert mode.wait(TIMEOUT_S)
    assert mode.previews == [project.folder]
    assert mode.outdated_stage == "body"
    project.undo()
    assert length.value == before
    assert project.undo_name is None


def test_changes_by_other_programs_are_shown_except_in_a_control_in_use(mode, studio_page):
    project = studio_page.bench.project
    controls = mode.parameters.controls
    length = project.device.body.parameters["length"]
    assert f"length = {length:g}" in project.text
    text = project.text.replace(f"length = {length:g}", "length = 91")
    set_by_user(controls["width"], 44.0)  # written after a pause
    (project.folder / "device.toml").write_text(text)
    studio_page.poll()
    assert controls["length"].value == 91
    assert controls["width"].value == 44
    mode.flush()
    assert project.device.body.parameters["width"] == 44
    assert project.device.body.parameters["length"] == 91


def test_each_value_of_the_catalogue_is_one_step(mode, studio_page):
    project, catalogue = studio_page.bench.project, mode.catalogue
    set_by_user(
        catalogue.material, next(x for x in catalogue.material.options if "ninjaflex-85a" in x)
    )
    assert project.device.material.name == "ninjaflex-85a"
    set_by_user(catalogue.cord, next(x for x in catalogue.cord.options if "1.7mm" in x))
    assert project.device.cord.name == "rubber-1.7mm"
    set_by_user(catalogue.printer, next(x for x in catalogue.printer.options if "polyjet" in x))
    assert project.device.fabrication.process == "polyjet"
    set_by_user(catalogue.decoder, "kernel")
    assert project.device.decoder == "kernel"
    for control, value in ((catalogue.edge, 9.5), (catalogue.cords, 5), (catalogue.name, "grip")):
        set_by_user(control, value)
    mode.flush()
    device = project.device
    assert (device.mesh.edge_length, device.name) == (9.5, "grip")
    assert len(device.sensors) + device.propose == 5
    assert mode.previews == []  # the body has not changed
    for value, searches in ((2, 2), (0, None)):
        set_by_user(catalogue.searches, value)
        mode.flush()
        assert project.device.searches == searches
        catalogue.show(project.device, lambda key: False)
        assert catalogue.searches.value == value
    while project.undo():
        pass
    assert project.device.name == "bar"


def test_controls_are_restored_after_invalid_values(mode, studio_page):
    set_by_user(mode.catalogue.name, "")
    set_by_user(mode.catalogue.edge, 0.0)
    mode.flush()
    assert studio_page.bench.status.error is not None
    assert mode.catalogue.name.value == "bar"
    assert mode.catalogue.edge.value == studio_page.bench.project.device.mesh.edge_length


@pytest.mark.parametrize("code", ["disk-full", "folder-not-writable"])
def test_a_failed_write_changes_nothing(mode, studio_page, monkeypatch, code):
    project = studio_page.bench.project
    before = project.text

    def refuse(path, text):
        raise StorageError("cannot be written", code=code, where=path)

    with monkeypatch.context() as patch:
        patch.setattr(project_module, "write_text", refuse)
        set_by_user(mode.parameters.controls["length"], 111.0)
        mode.flush()
        assert studio_page.bench.status.code == code
        assert project.text == before
        assert mode.parameters.controls["length"].value != 111
    set_by_user(mode.parameters.controls["length"], 111.0)
    mode.flush()
    assert project.device.body.parameters["length"] == 111


def test_file_and_page_agree_if_the_history_cannot_be_written(studio_page, monkeypatch):
    bench = studio_page.bench
    length = studio_page.modes["Device"].parameters.controls["length"]

    def refuse(*_):
        raise StorageError("the disk is full", code="disk-full", where="history.jsonl")

    monkeypatch.setattr(History, "add", refuse)
    set_by_user(length, 77.0)
    studio_page.modes["Device"].flush()
    assert bench.status.code == "disk-full"
    assert "length = 77" in (bench.project.folder / "device.toml").read_text("utf-8")
    assert bench.project.device.body.parameters["length"] == 77


def test_a_preview_is_shown_in_this_mode_only(mode, studio_page):
    bench = studio_page.bench
    other = box_surface([0, 0, 0], [400, 10, 10])
    mode.preview.on_surface(Surface(other.vertices, other.faces))
    assert bench.surface is not None
    assert (
        np.ptp(bench.surface.vertices, axis=0).max() < 400
    )  # other modes show the body of the build
    assert mode.is_preview_visible
    assert not bench.body.visible
    studio_page.enter("Cords")
    assert not mode.is_preview_visible
    assert bench.body.visible
    studio_page.enter("Device")
    assert mode.is_preview_visible
    assert "400 × 10 × 10 mm" in mode.status.text


def test_without_a_build_a_preview_is_the_body_of_all_modes(mode, studio_page):
    bench = studio_page.bench
    bench.is_built, bench.surface = False, None
    mode.preview.on_surface(box_surface([0, 0, 0], [40, 10, 10]))
    assert bench.size == 40
    assert bench.body.visible
    assert not mode.is_preview_visible


def test_controls_follow_a_changed_script(mode, studio_page):
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
    assert mode.wait(TIMEOUT_S)
    assert mode.previews == [project.folder]
    path.write_text("def body(length=100:\n")
    studio_page.poll()
    assert mode.parameters.controls == {}
    assert mode.parameters.error.code == "script-syntax"


def test_the_error_of_a_failed_preview_is_shown(mode):
    mode.make_body()
    assert mode.status.code == "making"
    error = BodyError("no room", code="script-raises")
    mode.preview.on_error(error)
    assert mode.status.code == "script-raises"
    assert mode.status.error is error


class FakeJob:
    """A job that ends when the test sets `is_running`."""

    def __init__(self):
        self.is_running, self.started, self.cancelled = False, 0, 0

    def start(self, job, folder):
        has_started = not self.is_running
        self.is_running, self.started = True, self.started + has_started
        return has_started

    def cancel(self):
        self.cancelled += 1


def test_a_preview_restarts_for_the_latest_device_and_reports_no_cancellation(tmp_path):
    surfaces, errors = [], []
    preview = BodyPreview(lambda *_: None, surfaces.append, errors.append)
    job = preview.job = FakeJob()

    def end(code):
        job.is_running = False
        preview.finish(None if code is None else DefsenseError("failed", code=code))

    preview.start(tmp_path)
    preview.start(tmp_path)  # of a changed device
    assert (job.started, job.cancelled) == (1, 1)
    end("cancelled")
    assert job.started == 2
    preview.cancel()
    end("cancelled")
    assert (surfaces, errors, job.started) == ([], [], 2)
    preview.start(tmp_path)
    end("boom")
    assert [e.code for e in errors] == ["boom"]
    preview.start(tmp_path)
    end(None)  # but there is no file
    assert errors[1].code == "file-unreadable"


def test_the_first_outdated_stage_is_named():
    stages = ("body", "mesh", "simulate", "optimize", "fabricate", "report")
    states = dict.fromkeys(stages, "current")
    assert first_outdated_stage(states) is None
    assert first_outdated_stage({**states, "simulate": "old", "report": "old"}) == "simulate"
    missing = dict.fromkeys(stages, "missing")
    assert first_outdated_stage({**missing, "body": "old"}) is None
