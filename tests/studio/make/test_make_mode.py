"""The Make mode, used through its buttons without a browser."""

from __future__ import annotations

import errno
import html
import io
import zipfile

import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.errors import StorageError
from defsense_fab.workflow.build import export as export_module
from defsense_fab.workflow.build.build import first_outdated
from defsense_fab.workflow.build.export import export
from defsense_fab.workflow.fabrication.assembly_guide import Note
from tests.support.errors import raises

TIMEOUT_S = 600.0


def make_mode(page):
    mode = page.modes["Make"]
    page.enter("Make")
    assert mode.loading.wait(TIMEOUT_S)
    assert mode.checking.wait(TIMEOUT_S)
    return mode


def export_to(mode, browser):
    mode.export(browser)
    assert mode.exporting.wait(TIMEOUT_S)


class Browser:
    """A browser that receives files."""

    def __init__(self):
        self.files = []

    def send_file_download(self, name, content, save_immediately=False):
        self.files.append((name, content))


def test_a_device_without_parts_has_no_steps_and_no_export(studio_page):
    mode = make_mode(studio_page)
    assert mode.guide is None
    assert mode.state.code == "not-built"
    mode.go(1)
    assert mode.step == 0
    browser = Browser()
    export_to(mode, browser)
    assert studio_page.bench.status.code == "build-outdated"
    assert not browser.files
    assert not list(studio_page.bench.project.folder.glob("*.zip"))


@pytest.mark.slow
def test_parts_are_exploded_and_assembled(made_page):
    mode, bench = make_mode(made_page), made_page.bench
    assert mode.state.code == "up-to-date"
    assert not bench.body.visible
    scene = mode.scene
    assert set(scene.positions) == {p.name for p in mode.guide.manifest.parts}
    for name, shift in mode.guide.shifts.items():
        assert scene.positions[name] == pytest.approx(shift)
    mode.set_explosion(0.0)
    assert not np.any(list(scene.positions.values()))
    made_page.enter("Cords")
    assert not scene.visible_parts
    assert bench.body.visible


@pytest.mark.slow
def test_steps_are_those_of_the_guide(made_page):
    mode, bench = make_mode(made_page), made_page.bench
    steps = mode.guide.steps
    guide = html.unescape((bench.project.folder / "build/guide.html").read_text(encoding="utf-8"))
    for number, step in enumerate(steps, start=1):
        mode.go(1)
        assert mode.step == number
        for line in step.lines:
            assert f"<li>{line}</li>" in guide
    mode.go(1)  # there is no step after the last one
    assert mode.step == len(steps)
    tables = {table.title: table for table in mode.guide.tables}
    assert "cut to" in " ".join(tables["Cut list"].header)
    assert "flexible glue" in {row[0] for row in tables["Bill of materials"].rows}


@pytest.mark.slow
def test_a_joint_is_shown_with_its_cords_and_pins(made_page):
    mode = make_mode(made_page)
    (number,) = (k for k, s in enumerate(mode.guide.steps, start=1) if s.joint is not None)
    joint = mode.guide.steps[number - 1].joint
    mode.choose(number)
    mode.set_explosion(1.0)
    (lifted,) = joint.upper
    expected = joint.lift * joint.opens
    assert mode.scene.positions[lifted] == pytest.approx(expected, abs=1e-4)
    extras = mode.scene.extras
    assert {f"/step/cord/{cord}" for cord in joint.cords} <= extras
    assert len([name for name in extras if "/pin/" in name]) == len(joint.pins)


@pytest.mark.slow
def test_the_point_of_a_note_is_marked_until_the_mode_is_left(made_page):
    mode = make_mode(made_page)
    (joint,) = (s.joint for s in mode.guide.steps if s.joint is not None)
    note = Note("here", joint.pins[0].center)
    mode.show_note(note)
    assert mode.flying.wait(TIMEOUT_S)
    assert mode.marked_note is note
    assert mode.scene.faint_parts == set(mode.guide.parts)  # the point is inside
    made_page.enter("Cords")
    assert mode.marked_note is None


@pytest.mark.slow
def test_parts_of_an_older_device_stay_and_are_marked_as_outdated(made_page):
    mode, bench = make_mode(made_page), made_page.bench
    bench.build_error = StorageError("the disk is full", code="disk-full")
    path = bench.project.folder / "device.toml"
    path.write_text(bench.project.text.replace("[75, 0]", "[75, 1]").replace("[62, 0]", "[62, 1]"))
    made_page.poll()
    assert mode.checking.wait(TIMEOUT_S)
    assert mode.state.code == "outdated"
    assert mode.state.outdated_stage == "optimize the layout"
    assert mode.state.error == "the disk is full"
    assert mode.guide is not None
    export_to(mode, None)
    assert bench.status.code == "build-outdated"
    assert bench.status.error.data["stage"] == "optimize"
    bench.project.undo()
    assert mode.checking.wait(TIMEOUT_S)
    assert mode.state.code == "up-to-date"


@pytest.mark.slow
def test_the_command_builds_the_same_parts_from_an_export(made_page, tmp_path):
    mode, bench = make_mode(made_page), made_page.bench
    browsers = Browser(), Browser()
    for browser in browsers:
        export_to(mode, browser)
    (name, content), (_, content_again) = browsers[0].files[0], browsers[1].files[0]
    assert content == content_again  # the same build gives the same bytes
    assert (bench.project.folder / name).read_bytes() == content
    folder = tmp_path / "exported"
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        names = file.namelist()
        file.extractall(folder)
    assert names == sorted(names)
    assert {"device.toml", "bar.py", "layout.json", "templates.pdf", "cut-list.csv"} <= set(names)
    assert main(["fabricate", str(folder)]) == 0
    assert files_in(folder / "parts") == files_in(folder / "build" / "parts")
    layout = (folder / "build" / "layout.json").read_bytes()
    assert (folder / "layout.json").read_bytes() == layout


def files_in(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.slow
def test_a_full_disk_leaves_the_previous_export(made_page, monkeypatch):
    mode, bench = make_mode(made_page), made_page.bench
    device = bench.project.device
    assert first_outdated(device) is None
    path = device.source / "bar.zip"
    path.write_bytes(b"before")

    class FullDisk(zipfile.ZipFile):
        def writestr(self, *_, **__):
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(export_module.zipfile, "ZipFile", FullDisk)
        export_to(mode, None)
        assert bench.status.code == "disk-full"
    assert path.read_bytes() == b"before"
    assert not list(device.source.glob(".bar*"))


@pytest.mark.slow
def test_a_read_only_folder_is_reported(made_page, monkeypatch):
    device = made_page.bench.project.device

    def refuse(*_):
        raise OSError(errno.EROFS, "Read-only file system", str(device.source / ".build-lock"))

    monkeypatch.setattr("defsense_fab.core.storage.files.os.open", refuse)
    with raises(StorageError, "file-unusable"):
        export(device, device.source / "bar.zip")
