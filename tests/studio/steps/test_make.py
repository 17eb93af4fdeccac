"""The step Make, asked as browsers do."""

from __future__ import annotations

import io
import shutil
import zipfile

import numpy as np
import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.studio.messages import make as messages
from defsense_fab.studio.steps.make.assembly_ticks import AssemblyTicks
from defsense_fab.studio.steps.make.build_state import BuildState
from defsense_fab.studio.steps.make.state_texts import make_state
from defsense_fab.studio.steps.make.step import MakeStep
from defsense_fab.workflow.view import Problem
from tests.studio.devices import write_device
from tests.studio.steps.conftest import open_app
from tests.support.errors import raises

TIMEOUT_S = 1200.0


def make_step(app):
    (step,) = (step for step in app.steps if isinstance(step, MakeStep))
    assert app.session.wait(TIMEOUT_S)
    assert step.wait(TIMEOUT_S)
    return step


@pytest.fixture
def empty_app(tmp_path):
    """Open a device without a build."""
    app = open_app(write_device(tmp_path / "grip"))
    yield app
    app.close()


def test_a_device_without_parts_has_nothing_to_export(empty_app):
    app = empty_app
    step, server = make_step(app), app.server
    state = server.events[messages.MakeState]
    assert state.code == "not-built"
    assert state.export_obstacle
    assert not state.build_obstacle
    assert not server.events[messages.Parts].parts
    assert not server.events[messages.Guide].stages
    with raises(StorageError, "not-built"):
        app.browser.ask("part-meshes")
    with pytest.raises(StorageError):
        app.browser.ask("export-device")
    assert not list(step.session.project.folder.glob("*.zip"))


@pytest.mark.parametrize(
    ("state", "can_export"),
    [
        (BuildState(is_built=False), False),
        (BuildState(is_built=True, outdated_stage="make the parts"), False),
        (BuildState(is_built=True, options="--copies 3"), True),
        (BuildState(is_built=True), True),
    ],
)
def test_the_export_needs_parts_of_the_current_device(state, can_export):
    problem = Problem(code="disk-full", text="the disk is full", message="The disk is full.")
    shown = make_state(state, "", problem)
    assert shown.code == state.code
    assert (shown.export_obstacle == "") == can_export
    assert shown.problem is problem
    assert (state.options or state.outdated_stage or "") in shown.detail


def test_done_steps_outlive_the_program(empty_app):
    app = empty_app
    step, server = make_step(app), app.server
    folder = step.session.project.folder
    for stage, is_done in (("a", True), ("b", True), ("a", False), ("b", True)):
        app.browser.ask("tick-stage", stage=stage, isDone=is_done)
    assert server.events[messages.AssemblyProgress].done == ["b"]
    assert AssemblyTicks(folder).done == ["b"]
    (folder / ".studio" / "assembly.json").write_text("[", encoding="utf-8")
    assert AssemblyTicks(folder).done == []


def test_done_steps_are_not_written_through_a_link(empty_app, tmp_path):
    app = empty_app
    step = make_step(app)
    other = tmp_path / "other.json"
    other.write_text("{}", encoding="utf-8")
    (step.session.project.folder / ".studio" / "assembly.json").symlink_to(other)
    with raises(StorageError, "path-is-link"):
        app.browser.ask("tick-stage", stage="a", isDone=True)
    assert other.read_text(encoding="utf-8") == "{}"


def test_only_files_of_the_build_are_sent(empty_app):
    app = empty_app
    step = make_step(app)
    for path in (
        "make/device.toml",
        "make/../device.toml",
        "make/",
        "make/guide.html",
        "device.toml",
    ):
        assert step.download(path) is None


@pytest.mark.slow
def test_the_parts_state_that_their_cords_are_those_of_a_layout(made_app):
    app = made_app
    step, server = make_step(app), app.server
    assert server.events[messages.MakeState].cords.startswith("The parts contain the drawn cords")
    app.session.taken_layouts.append(app.session.device.sensors)
    step.on_device_changed()
    make_step(app)
    state = server.events[messages.MakeState]
    assert state.cords.startswith("The parts contain the optimized layout of 2 parts")
    assert state.are_cords_drawn
    low, high = state.in_use[1:]
    assert low < state.in_use[0] < high
    app.browser.ask("delete-cords", cords=["A"])
    make_step(app)
    assert not server.events[messages.MakeState].are_cords_drawn


@pytest.mark.slow
def test_parts_and_steps_are_those_of_the_guide(made_app):
    app = made_app
    step, server = make_step(app), app.server
    assert server.events[messages.MakeState].code == "up-to-date"
    parts, guide = server.events[messages.Parts], server.events[messages.Guide]
    assert parts.id == guide.id
    sent = app.browser.ask("part-meshes")
    assert sent.facts["names"] == [part.name for part in parts.parts] == list(step.guide.parts)
    for k, part in enumerate(parts.parts):
        vertices = sent.arrays[f"{k}/vertices"]
        np.testing.assert_allclose(np.ptp(vertices, axis=0), part.size, atol=1e-3)
        assert part.plate == "plate.3mf"
    assert [stage.title for stage in guide.stages] == [s.title for s in step.guide.steps]
    (joint,) = (stage.joint for stage in guide.stages if stage.view == "joint")
    assert {*joint.lower, *joint.upper} == {part.name for part in parts.parts}
    assert np.linalg.norm(joint.lift) > 1
    assert guide.stages[0].view == "plates"
    assert guide.stages[-1].view == "assembled"
    assert {table.title for table in guide.lists} >= {"Print", "Cut list", "Bill of materials"}
    assert len({stage.id for stage in guide.stages}) == len(guide.stages)


@pytest.mark.slow
def test_files_of_the_build_are_saved(made_app):
    app = made_app
    step, server = make_step(app), app.server
    build = step.session.project.folder / "build"
    files = {file.name: file for file in server.events[messages.Guide].files}
    assert {"plate.3mf", "guide.html", "report.html"} <= set(files)
    for file in files.values():
        sent = step.download(file.path.removeprefix("files/"))
        assert len(sent.content) == file.size
    report = step.download(files["report.html"].path.removeprefix("files/"))
    assert report.content == (build / "report.html").read_bytes()
    assert step.download("make/layout.json") is None  # it is only in the zip


@pytest.mark.slow
def test_an_older_device_is_not_exported(made_app):
    app = made_app
    step, server = make_step(app), app.server
    project = step.session.project
    text = project.text.replace("[75, 0]", "[75, 1]").replace("[62, 0]", "[62, 1]")
    (project.folder / "device.toml").write_text(text, encoding="utf-8")
    project.refresh()
    make_step(app)
    state = server.events[messages.MakeState]
    assert state.code == "outdated"
    assert "optimize the layout" in state.detail
    assert server.events[messages.Parts].parts  # they stay until the next build
    with raises(StorageError, "build-outdated", stage="optimize"):
        app.browser.ask("export-device")
    project.undo()
    make_step(app)
    assert server.events[messages.MakeState].code == "up-to-date"


@pytest.mark.slow
def test_a_build_of_the_page_exports_the_bytes_of_the_command(made_app, made_bar):
    app = made_app
    step, server = make_step(app), app.server
    folder = step.session.project.folder
    shutil.rmtree(folder / "build")
    step.session.load()
    make_step(app)
    assert server.events[messages.MakeState].code == "not-built"
    step.session.build("report")
    assert step.session.jobs.wait(TIMEOUT_S)
    make_step(app)
    assert step.session.build_error is None
    answer = app.browser.ask("export-device")
    sent = step.download(answer.file.path.removeprefix("files/"))
    assert len(sent.content) == answer.file.size
    with zipfile.ZipFile(io.BytesIO(sent.content)) as file:
        names = file.namelist()
        assert len(names) == answer.count
        parts = {name: file.read(name) for name in names if name.startswith("parts/")}
    expected = {
        f"parts/{path.relative_to(made_bar / 'build' / 'parts').as_posix()}": path.read_bytes()
        for path in (made_bar / "build" / "parts").rglob("*")
        if path.is_file()
    }
    assert parts == expected
