"""A built device is looked at, put together and taken along, by the page's own buttons."""

from __future__ import annotations

import errno
import html
import io
import zipfile

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.report.guide.assembly.steps import guide_steps
from defsense_fab.studio.make.built_device import Note
from defsense_fab.workflow.build import export as export_module
from defsense_fab.workflow.build.export import export
from defsense_fab.workflow.build.build import first_outdated
from tests.studio.conftest import defsense

LONG = 280.0


def make_mode(page):
    mode = page.modes["Make"]
    page.enter("Make")
    assert mode.loading.wait(LONG)
    assert mode.checking.wait(LONG)
    return mode


class Browser:
    def __init__(self):
        self.got = []

    def send_file_download(self, name, content, save_immediately=False):
        self.got.append((name, content))


def test_nothing_is_built_yet(studio_page):
    mode = make_mode(studio_page)
    assert mode.device is None
    assert mode._state.content.startswith("**Nothing is built yet.**")
    mode.go(1)
    assert mode._words.content == ""
    browser = Browser()
    mode.export(browser)
    assert mode.exporting.wait(LONG)
    assert "build everything first" in studio_page.bench._message.content
    assert not browser.got
    assert not list(studio_page.bench.project.folder.glob("*.zip"))


@pytest.mark.slow
def test_parts_are_apart_and_go_together_as_the_guide_says(made_page):
    mode, bench = make_mode(made_page), made_page.bench
    assert mode._state.content == "The parts are those of the device as it is now."
    assert not bench.body.visible
    manifest, scene = mode.device.manifest, mode._scene
    assert set(scene._parts) == {p.name for p in manifest.parts}
    apart = {n: h.position.tolist() for n, h in scene._parts.items()}
    assert apart == {n: pytest.approx(w.tolist()) for n, w in mode.device.apart.items()}
    mode._apart.value = 0.0
    mode._slid()
    assert all(h.position.tolist() == [0, 0, 0] for h in scene._parts.values())
    steps = guide_steps(bench.project.device, manifest, mode.device.parts)
    guide = html.unescape((bench.project.folder / "build/guide.html").read_text(encoding="utf-8"))
    for k, step in enumerate(steps, start=1):
        mode.go(1)
        assert mode._steps.value == f"{k}. {step.title}"
        for line in step.lines:
            assert f"<li>{line}</li>" in guide
            assert f"- {line}" in html.unescape(mode._words.content)
    mode.go(1)  # there is none beyond the last
    assert mode._step == len(steps)
    (joined,) = (k for k, s in enumerate(steps, start=1) if s.joint is not None)
    joint = steps[joined - 1].joint
    mode.choose(joined)
    mode._apart.value = 1.0
    mode._slid()
    (lifted,) = joint.upper
    assert scene._parts[lifted].position == pytest.approx(joint.lift * joint.opens, abs=1e-4)
    names = {h.name for h in scene._extras}
    assert {f"/step/cord/{c}" for c in joint.cords} <= names
    assert len([n for n in names if "/pin/" in n]) == len(joint.pins)
    assert "| cut to |" in mode._tables["Cut list"].content
    assert "flexible glue" in mode._tables["Bill of materials"].content
    mode.show_place(Note("here", joint.pins[0].center))
    assert mode.flying.wait(LONG)
    assert mode._mark.position == pytest.approx(joint.pins[0].center, abs=1e-4)
    assert all(h.opacity < 0.5 for h in scene._parts.values())  # it lies inside
    made_page.enter("Cords")
    assert mode._mark is None
    assert not any(h.visible for h in scene._parts.values())
    assert bench.body.visible


@pytest.mark.slow
def test_parts_of_an_older_device_stay_and_are_told(made_page):
    mode, bench = make_mode(made_page), made_page.bench
    bench.build_error = "the disk is full"
    path = bench.project.folder / "device.toml"
    path.write_text(bench.project.text.replace("[75, 0]", "[75, 1]").replace("[62, 0]", "[62, 1]"))
    made_page.look()
    assert mode.checking.wait(LONG)
    assert "older device" in mode._state.content
    assert "'optimize the cords' has still to be done" in mode._state.content
    assert "the disk is full" in mode._state.content
    assert mode.device is not None
    mode.export(None)
    assert mode.exporting.wait(LONG)
    assert "'optimize the cords' has still to be done; build everything" in bench._message.content
    bench.project.undo()
    assert mode.checking.wait(LONG)
    assert mode._state.content == "The parts are those of the device as it is now."


@pytest.mark.slow
def test_what_is_exported_is_what_the_command_builds_of_it(made_page, tmp_path):
    mode, bench = make_mode(made_page), made_page.bench
    browsers = Browser(), Browser()
    for browser in browsers:
        mode.export(browser)
        assert mode.exporting.wait(LONG)
    (name, content), (_, again) = browsers[0].got[0], browsers[1].got[0]
    assert content == again  # the same build, the same bytes
    assert (bench.project.folder / name).read_bytes() == content
    there = tmp_path / "there"
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        names = file.namelist()
        file.extractall(there)
    assert names == sorted(names)
    assert {"device.toml", "bar.py", "layout.json", "guide.pdf", "cut-list.csv"} <= set(names)
    defsense("fabricate", there)
    built = there / "build" / "parts"
    theirs = {p.relative_to(built): p.read_bytes() for p in built.rglob("*") if p.is_file()}
    ours = {p.relative_to(there / "parts"): p.read_bytes()
            for p in (there / "parts").rglob("*") if p.is_file()}  # fmt: skip
    assert ours == theirs
    assert (there / "layout.json").read_bytes() == (built.parent / "layout.json").read_bytes()


@pytest.mark.slow
def test_a_full_disk_and_a_read_only_folder_are_told(made_page, monkeypatch):
    mode, bench = make_mode(made_page), made_page.bench
    device = bench.project.device
    assert first_outdated(device) is None
    path = device.source / "bar.zip"
    path.write_bytes(b"before")

    class Full(zipfile.ZipFile):
        def writestr(self, *_, **__):
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(export_module.zipfile, "ZipFile", Full)
        mode.export(None)
        assert mode.exporting.wait(LONG)
        assert "the disk is full; free some space" in bench._message.content
    assert path.read_bytes() == b"before"
    assert not list(device.source.glob(".bar*"))

    def refused(*_):
        raise OSError(errno.EROFS, "Read-only file system", str(device.source / ".build-lock"))

    with monkeypatch.context() as patch:
        patch.setattr("defsense_fab.core.storage.files.os.open", refused)
        with pytest.raises(StorageError, match="Read-only file system; check the path"):
            export(device, path)
