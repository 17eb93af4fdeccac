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
from defsense_fab.studio.steps.make.state_texts import make_state
from defsense_fab.studio.steps.make.step import MakeStep
from defsense_fab.studio.workbench.build_state import BuildState
from defsense_fab.workflow.view import Problem
from tests.studio.devices import write_device
from tests.studio.steps.recording_server import ask, open_step, settle
from tests.support.errors import raises

TIMEOUT_S = 1200.0


@pytest.fixture
def empty(tmp_path):
    """Open a device without a build."""
    with open_step(MakeStep, write_device(tmp_path / "grip")) as (step, server):
        settle(step)
        yield step, server


@pytest.fixture
def made(made_bar, tmp_path):
    """Open a copy of a bar that the command line has built."""
    with open_step(MakeStep, shutil.copytree(made_bar, tmp_path / "bar")) as (step, server):
        settle(step)
        yield step, server


def test_a_device_without_parts_has_nothing_to_export(empty):
    step, server = empty
    state = server.last(messages.MakeState)
    assert state.code == "not-built"
    assert state.export_obstacle
    assert not state.build_obstacle
    assert not server.last(messages.Parts).parts
    assert not server.last(messages.Guide).stages
    with raises(StorageError, "not-built"):
        ask(step, messages.PartMeshes(id=1))
    with pytest.raises(StorageError):
        ask(step, messages.ExportDevice(id=2))
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


def test_done_steps_outlive_the_program(empty):
    step, server = empty
    folder = step.session.project.folder
    for stage, is_done in (("a", True), ("b", True), ("a", False), ("b", True)):
        ask(step, messages.TickStage(id=1, stage=stage, is_done=is_done))
    assert server.last(messages.AssemblyProgress).done == ["b"]
    assert AssemblyTicks(folder).done == ["b"]
    (folder / ".studio" / "assembly.json").write_text("[", encoding="utf-8")
    assert AssemblyTicks(folder).done == []


def test_done_steps_are_not_written_through_a_link(empty, tmp_path):
    step, _ = empty
    other = tmp_path / "other.json"
    other.write_text("{}", encoding="utf-8")
    (step.session.project.folder / ".studio" / "assembly.json").symlink_to(other)
    with raises(StorageError, "path-is-link"):
        ask(step, messages.TickStage(id=1, stage="a", is_done=True))
    assert other.read_text(encoding="utf-8") == "{}"


def test_only_files_of_the_build_are_sent(empty):
    step, _ = empty
    for path in (
        "make/device.toml",
        "make/../device.toml",
        "make/",
        "make/guide.html",
        "device.toml",
    ):
        assert step.download(path) is None


@pytest.mark.slow
def test_parts_and_steps_are_those_of_the_guide(made):
    step, server = made
    assert server.last(messages.MakeState).code == "up-to-date"
    parts, guide = server.last(messages.Parts), server.last(messages.Guide)
    assert parts.id == guide.id
    sent = ask(step, messages.PartMeshes(id=1))
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
def test_files_of_the_build_are_saved(made):
    step, server = made
    build = step.session.project.folder / "build"
    files = {file.name: file for file in server.last(messages.Guide).files}
    assert {"plate.3mf", "guide.html", "report.html"} <= set(files)
    for file in files.values():
        sent = step.download(file.path.removeprefix("files/"))
        assert len(sent.content) == file.size
    report = step.download(files["report.html"].path.removeprefix("files/"))
    assert report.content == (build / "report.html").read_bytes()
    assert step.download("make/layout.json") is None  # it is only in the zip


@pytest.mark.slow
def test_an_older_device_is_not_exported(made):
    step, server = made
    project = step.session.project
    text = project.text.replace("[75, 0]", "[75, 1]").replace("[62, 0]", "[62, 1]")
    (project.folder / "device.toml").write_text(text, encoding="utf-8")
    project.refresh()
    settle(step)
    state = server.last(messages.MakeState)
    assert state.code == "outdated"
    assert "optimize the layout" in state.detail
    assert server.last(messages.Parts).parts  # they stay until the next build
    with raises(StorageError, "build-outdated", stage="optimize"):
        ask(step, messages.ExportDevice(id=1))
    project.undo()
    settle(step)
    assert server.last(messages.MakeState).code == "up-to-date"


@pytest.mark.slow
def test_a_build_of_the_page_exports_the_bytes_of_the_command(made, made_bar):
    step, server = made
    folder = step.session.project.folder
    shutil.rmtree(folder / "build")
    step.session.load()
    settle(step)
    assert server.last(messages.MakeState).code == "not-built"
    step.session.build("report")
    assert step.session.jobs.wait(TIMEOUT_S)
    settle(step)
    assert step.session.build_error is None
    answer = ask(step, messages.ExportDevice(id=1))
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
