"""The step Body: parameters, fields, catalogues, and the body that follows them."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import BodyError, DefsenseError, DeviceError, MeshingError
from defsense_fab.studio.background.background_job import CANCELLED
from defsense_fab.studio.messages.body import (
    BodyParameters,
    BodyStatus,
    Catalogues,
    DeviceFields,
)
from defsense_fab.studio.messages.shell import Question
from defsense_fab.studio.session.job_strip import JobStrip
from defsense_fab.workflow.build.results import Build
from defsense_fab.workflow.view import Problem
from tests.conftest import box_surface
from tests.studio.devices import TEXT, write_device
from tests.studio.steps.conftest import open_app
from tests.support.errors import raises

TIMEOUT_S = 60.0
SCRIPT = """
from typing import Annotated, Literal

def body(
    length: Annotated[float, (50, 200), "mm"] = 150,
    width=30,
    count: int = 3,
    hollow=True,
    shape: Literal["round", "square"] = "round",
    corners=((0, 0), (1, 1)),
):
    return None
"""


class HeldJobs:
    """Jobs that run until a test ends them."""

    def __init__(self, monkeypatch):
        self.started = []
        monkeypatch.setattr(JobStrip, "start", lambda strip, work: self._start(strip, work))
        monkeypatch.setattr(JobStrip, "cancel", lambda _: self.end(CANCELLED))
        monkeypatch.setattr(JobStrip, "is_running", property(lambda _: bool(self._work)))
        self._work = None

    def _start(self, strip, work):
        assert self._work is None
        self.started.append(work.name)
        self._work = work
        strip.job = strip.job.__class__(name=work.name, title=work.title, state="running")

    def end(self, code=None):
        work, self._work = self._work, None
        if work is not None:
            error = None if code is None else DefsenseError("failed", code=code)
            work.on_end(error, None)


@pytest.fixture
def jobs(monkeypatch):
    return HeldJobs(monkeypatch)


@pytest.fixture
def surfaces(monkeypatch):
    """Return a list whose last surface is that of every build."""
    shown = [box_surface([0, -15, -15], [150, 15, 15])]
    monkeypatch.setattr(Build, "surface", property(lambda _: shown[-1]))
    return shown


@pytest.fixture
def grip(tmp_path, jobs, own_settings):
    """Open a device whose body has not been made; the job that makes it is held."""
    folder = write_device(tmp_path / "grip")
    (folder / "grip.py").write_text(SCRIPT, encoding="utf-8")
    app = open_app(folder)
    app.step = app.steps[1]
    yield app
    app.close()


def status(app):
    return app.server.events[BodyStatus]


def fields(app):
    groups = app.server.events[DeviceFields].groups
    return {field.key: field for group in groups for field in (*group.fields, *group.more)}


def parameters(app):
    return {p.name: p for p in app.server.events[BodyParameters].parameters}


def choices(app):
    return {choice.catalogue: choice for choice in app.server.events[DeviceFields].choices}


def follow(app):
    """Wait until the freshness is known, which lets the body follow."""
    assert app.session.wait(TIMEOUT_S)


def test_the_first_browser_lets_the_body_be_made(grip, jobs, surfaces):
    assert jobs.started == ["body"]
    assert status(grip).state == "making"
    assert status(grip).size is None
    jobs.end()
    assert status(grip).state == "idle"
    assert status(grip).size == [150, 30, 30]
    assert status(grip).volume == pytest.approx(135_000)
    assert not grip.server.arrays["body"].facts["isBuilt"]
    grip.connect(grip.browser)
    assert jobs.started == ["body"]


def test_the_script_declares_the_fields_of_its_parameters(grip):
    event, shown = grip.server.events[BodyParameters], parameters(grip)
    assert (event.file, event.source, event.problem) == ("grip.py", "script", None)
    assert {name: p.kind for name, p in shown.items()} == {
        "length": "number", "width": "whole", "count": "whole", "hollow": "switch",
        "shape": "choice",
    }  # fmt: skip
    assert event.other == ["corners"]
    length, width = shown["length"], shown["width"]
    assert (length.value, length.low, length.high, length.min, length.max, length.unit) == (
        150, 50, 200, 50, 200, "mm",
    )  # fmt: skip
    assert (width.is_set, width.low, width.high, width.min) == (True, 6, 90, None)
    assert (shown["count"].is_set, shown["count"].value) == (False, 3)
    assert shown["shape"].choices == ["round", "square"]


def test_a_parameter_is_one_step_and_the_body_follows(grip, jobs, surfaces):
    jobs.end()
    project = grip.session.project
    grip.browser.ask("set-parameter", name="length", value=103)
    assert project.undo_name == "set length to 103"
    assert project.device.body.parameters["length"] == 103
    follow(grip)
    assert jobs.started == ["body", "body"]
    grip.browser.ask("set-parameter", name="hollow", value=False)
    grip.browser.ask("set-parameter", name="shape", value="square")
    assert project.device.body.parameters["shape"] == "square"
    grip.browser.ask("reset-parameter", name="shape")
    assert "shape" not in project.device.body.parameters
    assert project.device.body.parameters["hollow"] is False


@pytest.mark.parametrize(
    ("name", "value", "code", "typed"),
    [
        ("length", 49.9999, "out-of-range", "49.9999"),
        ("length", 1e9, "out-of-range", "1000000000"),
        ("count", 2.5, "value-type", "2.5"),
        ("shape", "oval", "value-type", "oval"),
        ("hollow", 1, "value-type", "1"),
        ("width", "wide", "value-type", "wide"),
        ("corners", "x", "unknown-parameter", ""),
    ],
)
def test_a_value_that_the_script_does_not_accept_is_named(grip, name, value, code, typed):
    before = grip.session.project.text
    with raises(DeviceError, code, parameter=name) as caught:
        grip.browser.ask("set-parameter", name=name, value=value)
    assert typed in caught.value.problem
    assert grip.session.project.text == before


def test_a_script_that_cannot_be_read_is_a_problem(grip):
    grip.session.device.body.path.write_text("def body(length=100:\n")
    grip.poll()
    event = grip.server.events[BodyParameters]
    assert (event.parameters, event.problem.code) == ([], "script-syntax")
    with raises(BodyError, "script-syntax"):
        grip.browser.ask("set-parameter", name="length", value=100)


def test_the_body_follows_a_changed_script(grip, jobs, surfaces):
    jobs.end()
    grip.session.device.body.path.write_text("def body(radius=4):\n    pass\n")
    grip.poll()
    assert list(parameters(grip)) == ["radius"]
    assert grip.server.events[BodyParameters].unknown == ["length", "width"]
    follow(grip)
    assert jobs.started == ["body", "body"]


def test_a_body_is_made_again_for_the_latest_device(grip, jobs):
    grip.browser.ask("make-body")
    assert jobs.started == ["body"]  # that body is up to date
    grip.browser.ask("set-parameter", name="length", value=101)
    follow(grip)
    assert jobs.started == ["body", "body"]
    assert status(grip).state == "making"


def test_a_body_is_stopped_and_its_failure_is_shown(grip, jobs):
    grip.browser.ask("stop-body")
    assert status(grip).state == "stopped"
    grip.browser.ask("make-body")
    assert status(grip).state == "making"
    jobs.end("script-raises")
    assert (status(grip).state, status(grip).problem.code) == ("failed", "script-raises")
    grip.browser.ask("make-body")
    jobs.end()  # but there is no file
    assert status(grip).problem.code == "file-unreadable"


def test_a_preview_differs_from_the_built_body(grip, jobs, surfaces):
    jobs.end()
    built, grip.session.is_built = grip.session.surface, True
    surfaces.append(box_surface([0, 0, 0], [400, 10, 10]))
    grip.browser.ask("make-body")
    jobs.end()
    assert grip.session.surface is built  # which other steps use
    preview = grip.server.arrays["body-preview"]
    assert np.ptp(preview.arrays["vertices"], axis=0).max() == 400
    assert not preview.facts["isBuilt"]
    assert (status(grip).is_preview, status(grip).size) == (True, [400, 10, 10])
    follow(grip)
    grip.session.freshness = {"body": "current"}
    grip.step.on_freshness()
    assert grip.server.arrays["body-preview"].arrays == {}
    assert (status(grip).is_preview, status(grip).size) == (False, [150, 30, 30])


def test_the_body_waits_for_another_job(grip, jobs, surfaces):
    jobs.end()
    grip.browser.ask("start-build", stage="mesh")
    grip.browser.ask("make-body")
    assert (status(grip).state, jobs.started) == ("waiting", ["body", "build"])
    grip.poll()
    assert jobs.started == ["body", "build"]
    jobs.end()
    grip.poll()
    assert jobs.started == ["body", "build", "body"]


def test_a_body_that_a_build_has_interrupted_is_made_after_it(grip, jobs, surfaces):
    grip.session.jobs.is_replacing = True
    jobs.end(CANCELLED)
    grip.session.jobs.is_replacing = False
    grip.browser.ask("start-build", stage="simulate")
    assert status(grip).state == "waiting"
    jobs.end("region-outside-body")
    grip.poll()
    assert jobs.started == ["body", "build", "body"]
    jobs.end(CANCELLED)  # by the user
    grip.poll()
    assert (status(grip).state, len(jobs.started)) == ("stopped", 3)


def test_a_script_from_elsewhere_does_not_run_before_the_user_agrees(tmp_path, jobs, own_settings):
    app = open_app(write_device(tmp_path / "grip"), trusted=False)
    assert jobs.started == []
    app.browser.ask("set-parameter", name="length", value=140)
    follow(app)
    assert (status(app).state, jobs.started) == ("not-agreed", [])
    app.browser.ask("make-body")
    assert app.server.events[Question].files[0].name == "grip.py"
    app.browser.ask("answer", run=False)
    assert (status(app).state, jobs.started) == ("not-agreed", [])
    app.browser.ask("make-body")
    app.browser.ask("answer", run=True)
    assert (status(app).state, jobs.started) == ("making", ["body"])
    app.close()


# Fields and catalogues


def test_fields_are_those_that_the_schema_declares(grip):
    edge = fields(grip)["mesh.edge_length"]
    assert (edge.label, edge.unit, edge.kind, edge.value) == ("Edge length", "mm", "number", 6)
    assert (edge.low, edge.is_low_open, edge.can_reset) == (0, True, False)
    wall = fields(grip)["fabrication.wall"]
    assert (wall.value, wall.default) == (None, 1.2)
    decoder = fields(grip)["design.decoder"]
    assert (decoder.kind, decoder.default) == ("choice", "auto")
    assert "kernel" in decoder.choices
    assert fields(grip)["design.sensors"].value == 2
    assert fields(grip)["fabrication.pockets"].kind == "switch"
    assert all(f.description for f in fields(grip).values())


@pytest.mark.parametrize(
    ("key", "value", "read"),
    [
        ("mesh.edge_length", 9.5, lambda d: d.mesh.edge_length),
        ("mesh.accuracy", 0.01, lambda d: d.mesh.accuracy),
        ("design.sensors", 5, lambda d: len(d.sensors) + d.propose),
        ("design.searches", 2, lambda d: d.searches),
        ("design.decoder", "kernel", lambda d: d.decoder),
        ("fabrication.wall", 0.0123, lambda d: d.fabrication.wall),
        ("fabrication.pockets", False, lambda d: d.fabrication.pockets),
        ("material.poisson_ratio", 0.4, lambda d: d.material.poisson_ratio),
    ],
)
def test_each_field_is_one_step(grip, key, value, read):
    grip.browser.ask("set-field", key=key, value=value)
    assert read(grip.session.device) == value
    assert fields(grip)[key].value == value
    assert load_device(grip.session.project.folder, complete=False).name == "grip"
    grip.browser.ask("undo")
    assert grip.session.project.text == TEXT


def test_a_field_is_reset_to_its_default(grip):
    grip.browser.ask("set-field", key="fabrication.wall", value=2.5)
    assert fields(grip)["fabrication.wall"].can_reset
    grip.browser.ask("reset-field", key="fabrication.wall")
    assert grip.session.device.fabrication.wall == 1.2
    assert not fields(grip)["fabrication.wall"].can_reset


def test_an_edge_length_and_an_accuracy_replace_each_other(grip):
    grip.browser.ask("set-field", key="mesh.accuracy", value=0.02)
    edge = fields(grip)["mesh.edge_length"]
    assert (edge.value, edge.default_text) == (None, "from the accuracy of 0.02")
    grip.browser.ask("set-field", key="mesh.edge_length", value=7)
    assert grip.session.device.mesh.accuracy is None


@pytest.mark.parametrize(
    ("key", "value", "code", "typed"),
    [
        ("mesh.edge_length", -5, "out-of-range", "-5"),
        ("mesh.edge_length", -0.00012345, "out-of-range", "-0.00012345"),
        ("mesh.edge_length", "x", "value-type", "x"),
        ("design.searches", 2.5, "value-type", "2.5"),
        ("design.searches", 0, "out-of-range", "0"),
        ("design.sensors", 1, "too-few-sensors", "1"),
        ("design.decoder", "magic", "value-choice", "magic"),
        ("fabrication.wall", 1234567.25, "out-of-range", "1234567.25"),
    ],
)
def test_a_value_that_is_not_accepted_belongs_to_its_field(grip, key, value, code, typed):
    with raises(DeviceError, code, key=key) as caught:
        grip.browser.ask("set-field", key=key, value=value)
    problem = Problem.of(caught.value)
    assert problem.field == key
    assert typed in problem.message
    assert grip.session.project.text == TEXT


def test_an_edge_length_has_to_fit_the_body(grip, jobs, surfaces):
    grip.browser.ask("set-field", key="mesh.edge_length", value=99_999)  # no body to compare with
    grip.browser.ask("undo")
    jobs.end()
    with raises(MeshingError, "edge-too-long", size=(150, 30, 30), key="mesh.edge_length") as long:
        grip.browser.ask("set-field", key="mesh.edge_length", value=99_999)
    message = Problem.of(long.value).message
    assert "99999 mm" in message
    assert "150 × 30 × 30 mm" in message
    with raises(MeshingError, "edge-too-short", key="mesh.edge_length") as short:
        grip.browser.ask("set-field", key="mesh.edge_length", value=0.0001)
    assert "0.0001 mm" in Problem.of(short.value).message
    assert grip.session.device.mesh.edge_length == 6


def test_keys_without_a_field_are_refused(grip):
    for key in ("name", "body.script", "sensors.1.name", "mesh", ""):
        with raises(DeviceError, "unknown-field"):
            grip.browser.ask("set-field", key=key, value="x")
        with raises(DeviceError, "unknown-field"):
            grip.browser.ask("reset-field", key=key)


@pytest.mark.parametrize(
    ("catalogue", "name", "read"),
    [
        ("material", "ninjaflex-85a", lambda d: d.material.name),
        ("cord", "rubber-1.7mm", lambda d: d.cord.name),
        ("printer", "polyjet", lambda d: d.fabrication.process),
    ],
)
def test_a_row_of_a_catalogue_is_one_step(grip, catalogue, name, read):
    grip.browser.ask("choose-row", catalogue=catalogue, name=name)
    assert read(grip.session.device) == name
    chosen = choices(grip)[catalogue]
    listed = next(c for c in grip.server.events[Catalogues].catalogues if c.name == catalogue)
    row = next(row for row in listed.rows if row.name == name)
    assert (chosen.name, chosen.values, chosen.changed) == (name, row.values, [])
    assert row.source
    assert len(row.values) == len(listed.columns)
    grip.browser.ask("undo")
    assert grip.session.project.text == TEXT


def test_values_that_replace_those_of_a_row_are_named(grip):
    grip.browser.ask("set-field", key="cord.diameter", value=1.9)
    chosen = choices(grip)["cord"]
    assert (chosen.values[0], chosen.changed, chosen.is_custom) == (1.9, ["Diameter"], False)
    grip.browser.ask("choose-row", catalogue="cord", name="rubber-2mm")
    assert choices(grip)["cord"].changed == []


def test_unknown_rows_are_refused(grip):
    with raises(DeviceError, "unknown-row", name="steel"):
        grip.browser.ask("choose-row", catalogue="material", name="steel")
