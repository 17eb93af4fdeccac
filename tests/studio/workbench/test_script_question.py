"""No script of a folder runs before the user has agreed."""

from __future__ import annotations

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.workbench.background_job import BackgroundJob
from defsense_fab.studio.workbench.script_question import script_html
from defsense_fab.workflow.starts.body_scripts import read_script
from tests.studio.devices import set_by_user, write_device

HOSTILE = """\
import pathlib
pathlib.Path(__file__).with_name("ran").touch()  # </pre><script>alert(1)</script>
def body(length=150, width=30):
    pass
"""
B_TEXT = "import a\n" + "y = 1\n" * 20_000
TIMEOUT_S = 600.0


@pytest.fixture
def hostile(studio_server, tmp_path):
    """Return the page of a folder from an unknown sender."""
    folder = write_device(tmp_path / "grip")
    (folder / "grip.py").write_text(HOSTILE)
    studio_server.gui.reset()
    studio_server.scene.reset()
    page = StudioPage(studio_server, Project(folder))
    yield page
    page.close()


@pytest.fixture
def stages(monkeypatch):
    """Return the stages of the builds that were requested; none is run."""
    started = []
    monkeypatch.setattr(
        BackgroundJob, "start", lambda *arguments: started.append(arguments[-1]) or True
    )
    return started


def test_the_page_starts_no_build_before_the_user_agrees(hostile, stages):
    bench, mode = hostile.bench, hostile.modes["Device"]
    hostile.enter("Make")
    hostile.enter("Device")
    for stage in ("body", "mesh", "simulate", "report"):
        assert not bench.build(stage)
    mode.make_body()
    set_by_user(mode.parameters.controls["length"], 120.0)
    mode.flush()
    assert mode.wait(TIMEOUT_S)
    assert mode.status.code == "not-agreed"
    hostile.poll()
    assert bench.project.device.body.parameters["length"] == 120
    assert stages == []
    assert bench.question.is_open
    bench.question.answer(run=False)
    assert not bench.question.is_open
    assert bench.status.code == "script-refused"
    assert stages == []
    bench.build("simulate")
    bench.question.answer(run=True)
    assert stages == ["simulate"]
    assert bench.build("mesh")
    assert not bench.question.is_open
    assert not (bench.project.folder / "ran").exists()


def test_the_user_is_asked_again_if_the_script_changes_while_it_is_shown(hostile, stages):
    hostile.bench.build("mesh")
    path = hostile.bench.project.folder / "grip.py"
    path.write_text(HOSTILE + "# and more\n")
    hostile.bench.question.answer(run=True)
    assert stages == []
    assert hostile.bench.question.is_open


def test_trusted_folders_and_meshes_are_not_asked_for(studio_page):
    assert studio_page.bench.may_run_script(pytest.fail)


def test_the_whole_text_is_shown_and_escaped(tmp_path):
    (tmp_path / "a.py").write_text(HOSTILE + 'x = "\u202e\u2066 reversed"\n', encoding="utf-8")
    (tmp_path / "b.py").write_text(B_TEXT)
    (tmp_path / "c.so").write_bytes(b"\x7fELF<script>")
    text = script_html(read_script(tmp_path / "a.py"))
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)" in text
    assert "\u202e" not in text
    assert "<mark>\\u202e</mark>" in text
    assert "12 bytes" in text
    assert f"{len(B_TEXT) - 100_000:,}" in text
    assert all(f"<b>{name}</b>" in text for name in ("a.py", "b.py", "c.so"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("raise ValueError('no room')\n", "script-raises"),
        ("while True: pass\n", "time-limit-exceeded"),
        ("import os; os._exit(3)\n", "process-ended-early"),
    ],
)
def test_scripts_that_raise_or_never_end_leave_the_page_usable(studio_server, tmp_path, text, code):
    folder = write_device(tmp_path / "grip")
    (folder / "grip.py").write_text(text + "def body(length=150, width=30): pass\n")
    toml = (folder / "device.toml").read_text("utf-8")
    (folder / "device.toml").write_text(toml.replace("[body]\n", "[body]\ntime_limit = 2\n"))
    studio_server.gui.reset()
    page = StudioPage(studio_server, Project(folder), Agreement(trusted=True))
    mode = page.modes["Device"]
    mode.make_body()
    assert mode.preview.wait(TIMEOUT_S)
    assert mode.status.code == code
    assert not mode.preview.is_running
    assert load_device(folder).name == "grip"
    page.close()
