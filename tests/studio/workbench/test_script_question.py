"""Nothing of a folder runs before a person has agreed."""

from __future__ import annotations

import re
import threading

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.script_source import read_script
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.workbench.build_work import BuildWork
from defsense_fab.studio.workbench.script_question import question
from tests.studio.devices import write_device

HOSTILE = """\
import pathlib
pathlib.Path(__file__).with_name("ran").touch()  # </pre><script>alert(1)</script>
def body(length=150, width=30):
    pass
"""
LONG = 60.0


@pytest.fixture
def hostile(studio_server, tmp_path):
    """The page of a folder that came from anybody."""
    folder = write_device(tmp_path / "grip")
    (folder / "grip.py").write_text(HOSTILE)
    studio_server.gui.reset()
    studio_server.scene.reset()
    made = StudioPage(studio_server, Project(folder))
    yield made
    made.close()


def click(page, label):
    """A button of the question."""
    handles = page.bench.server.gui._gui_input_handle_from_uuid.values()
    found = [h for h in handles if getattr(h, "label", "") == label]
    assert len(found) == 1
    for told in found[0]._impl.update_cb:
        told(None)


def test_no_way_of_the_page_builds_before_a_person_agrees(hostile, monkeypatch):
    begun = []
    monkeypatch.setattr(BuildWork, "start", lambda *given: begun.append(given[2:]) or True)
    bench, mode = hostile.bench, hostile.modes["Device"]
    hostile.enter("Make")
    hostile.enter("Device")
    for stage in ("body", "mesh", "simulate", "report"):
        assert not bench.build(stage)
    mode.make_body()
    mode._settled.give("parameter:length", 120.0)
    mode.flush()
    assert mode._states.wait(LONG)
    assert "is not agreed to" in mode._body.content
    hostile.look()
    assert bench.project.device.body.parameters["length"] == 120
    assert begun == []
    assert bench.question.open
    click(hostile, "Do not run it")
    assert not bench.question.open
    assert "was not run" in bench._message.content
    assert begun == []
    bench.build("simulate")
    click(hostile, "Run it: I know where it comes from")
    assert begun == [("simulate",)]
    assert bench.build("mesh")
    assert not bench.question.open
    assert not (bench.project.folder / "ran").exists()


def test_a_script_that_changes_after_it_was_shown_is_asked_for_again(hostile, monkeypatch):
    begun = []
    monkeypatch.setattr(BuildWork, "start", lambda *given: begun.append(given[2:]) or True)
    hostile.bench.build("mesh")
    path = hostile.bench.project.folder / "grip.py"
    path.write_text(HOSTILE + "# and more\n")
    click(hostile, "Run it: I know where it comes from")
    assert begun == []
    assert hostile.bench.question.open


def test_trusted_folders_and_meshes_are_not_asked_for(studio_page):
    assert studio_page.bench.may_run(pytest.fail)


def test_the_whole_text_is_shown_and_none_of_it_is_html(tmp_path):
    (tmp_path / "a.py").write_text(HOSTILE + 'x = "\u202e\u2066 reversed"\n', encoding="utf-8")
    (tmp_path / "b.py").write_text("import a\n" + "y = 1\n" * 20_000)
    (tmp_path / "c.so").write_bytes(b"\x7fELF<script>")
    text = question(read_script(tmp_path / "a.py"))
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert "\u202e" not in text
    assert "<mark>\\u202e</mark>" in text
    assert "12 bytes of machine code" in text
    assert "characters more" in text
    assert all(f"<b>{name}</b>" in text for name in ("a.py", "b.py", "c.so"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise ValueError('no room')\n", r"grip\.py:1: the script raised ValueError: no room"),
        ("while True: pass\n", "did not end within 2 s"),
        ("import os; os._exit(3)\n", "ended early"),
    ],
)
def test_scripts_that_raise_or_never_end_are_told_and_the_page_lives(
    studio_server, tmp_path, text, said
):
    folder = write_device(tmp_path / "grip")
    (folder / "grip.py").write_text(text + "def body(length=150, width=30): pass\n")
    toml = (folder / "device.toml").read_text("utf-8")
    (folder / "device.toml").write_text(toml.replace("[body]\n", "[body]\ntime_limit = 2\n"))
    studio_server.gui.reset()
    page = StudioPage(studio_server, Project(folder), Agreement(trusted=True))
    over = threading.Event()
    mode = page.modes["Device"]
    mode.preview._failed = lambda problem: (mode._failed(problem), over.set())
    mode.make_body()
    assert over.wait(LONG)
    assert re.search(said, mode._body.content)
    assert not mode.preview.running
    assert load_device(folder).name == "grip"
    page.close()


def test_a_look_for_poses_asks_too(hostile):
    poses = hostile.modes["Poses"]
    part = next(p for p in vars(poses).values() if hasattr(p, "take_all"))
    part._held.options = ("none", "base")
    part._held.value = "base"
    part._scene.body = object()
    part.look()
    assert hostile.bench.question.open
    part._scene.body = None
