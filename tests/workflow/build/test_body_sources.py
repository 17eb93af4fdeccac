"""Test which files and libraries a body depends on."""

import os
import shutil
from dataclasses import replace
from importlib import metadata

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.workflow.build import body_sources
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.stages import STAGES, installed_versions, stage_keys
from tests.support import body_scripts
from tests.support.places import BAR

HEAD = "import json, os, pathlib, subprocess\n" + body_scripts.HEAD
HERE = "here = pathlib.Path(__file__).parent\n"
PLAIN = "def body(length, width, height): return box(length, width, height)\n"
READING = (
    "def body(length, width, height):\n"
    "    width = json.loads((here / 'size.json').read_text())['width']\n"
    "    return box(length, width, height)\n"
)


@pytest.fixture
def folder(tmp_path):
    """Return a bar whose script reads `size.json`."""
    out = tmp_path / "bar"
    out.mkdir()
    shutil.copy(BAR / "device.toml", out)
    (out / "bar.py").write_text(HEAD + HERE + READING)
    (out / "size.json").write_text('{"width": 30}')
    return out


def made(folder):
    return list(build(load_device(folder), "body").made)


@pytest.mark.slow
def test_content_of_a_data_file_that_the_script_reads_counts(folder):
    assert made(folder) == ["body"]
    assert made(folder) == []
    os.utime(folder / "size.json", (1, 1))
    (folder / "other.json").write_text("{}")
    assert made(folder) == []
    (folder / "size.json").write_text('{"width": 28}')
    assert made(folder) == ["body"]
    assert made(folder) == []
    (folder / "bar.py").write_text(HEAD + HERE + READING + "# a note\n")
    assert made(folder) == ["body"]


@pytest.mark.slow
def test_recordings_in_the_folder_do_not_count(folder):
    assert made(folder) == ["body"]
    session = folder / "session" / "run-1"
    session.mkdir(parents=True)
    (folder / "session" / "session.json").write_text("{}\n")
    for path in (session / "frames.csv", session / "scan.stl", folder / "notes.py"):
        path.write_text("x,y\n1,2\n")
    assert made(folder) == []


@pytest.mark.slow
def test_compiled_modules_count(folder):
    (folder / "bar.py").write_text(HEAD + "from parts.hole import RADIUS\n" + PLAIN)
    (folder / "parts").mkdir()
    (folder / "parts" / "hole.py").write_text("RADIUS = 1\n")
    assert made(folder) == ["body"]
    change = folder / "device.toml"
    change.write_text(change.read_text("utf-8").replace("length = 150", "length = 149"))
    assert made(folder) == ["body"]  # this time from the compiled module
    assert sorted(body_sources.load_sources(folder / "build")) == ["bar.py", "parts/hole.py"]
    (folder / "parts" / "hole.py").write_text("RADIUS = 2\n")
    assert made(folder) == ["body"]


@pytest.mark.slow
def test_outside_files_count_and_a_moved_folder_is_up_to_date(folder):
    shared = folder.parent / "shared.txt"
    shared.write_text("a")
    (folder / "bar.py").write_text(HEAD + f"open({str(shared)!r}).close()\n" + HERE + READING)
    assert made(folder) == ["body"]
    moved = folder.rename(folder.parent / "moved")
    assert made(moved) == []
    shared.write_text("b")
    assert made(moved) == ["body"]


@pytest.mark.slow
def test_file_that_was_missing_before_counts(folder):
    (folder / "size.json").unlink()
    (folder / "bar.py").write_text(
        HEAD + HERE + "try: open(here / 'size.json')\nexcept FileNotFoundError: pass\n" + PLAIN
    )
    assert made(folder) == ["body"]
    assert made(folder) == []
    (folder / "size.json").write_text("{}")
    assert made(folder) == ["body"]


@pytest.mark.slow
def test_files_that_the_script_writes_do_not_count(folder):
    own = (
        "from OCP.BRepTools import BRepTools\n"
        "BRepTools.Write_s(box(1, 1, 1).wrapped, str(here / 'out.brep'))\n"
        "cache = here / 'cache.txt'\n"
        "if not cache.exists(): cache.write_text(str(os.getpid()))\n"
        "cache.read_text()\n"
        "(here / 'log.txt').open('a+').write('run')\n"
    )
    (folder / "bar.py").write_text(HEAD + HERE + own + PLAIN)
    assert made(folder) == ["body"]
    assert made(folder) == []
    (folder / "bar.py").write_text(HEAD + HERE + own + PLAIN + "# a note\n")
    assert made(folder) == ["body"]
    assert made(folder) == []


@pytest.mark.slow
def test_cad_file_that_only_the_kernel_opens_counts(folder):
    import build123d as bd

    step = folder / "core.step"
    bd.export_step(bd.Box(10, 10, 10), str(step))
    core = "import build123d as bd\ncore = bd.import_step(str(here / 'core.step'))\n"
    (folder / "bar.py").write_text(HEAD + HERE + core + PLAIN)
    assert made(folder) == ["body"]
    assert made(folder) == []
    bd.export_step(bd.Box(11, 10, 10), str(step))
    assert made(folder) == ["body"]


@pytest.mark.slow
def test_file_that_changes_while_the_script_runs_is_noticed(folder):
    change = "subprocess.run(['sh', '-c', 'echo 1 > size.json'], cwd=here, check=True)\n"
    text = HEAD + HERE + "(here / 'size.json').read_text()\n" + change + PLAIN
    (folder / "bar.py").write_text(text)
    assert made(folder) == ["body"]
    assert made(folder) == ["body"]
    assert made(folder) == []


@pytest.mark.slow
def test_damaged_record_makes_the_body_again(folder):
    assert made(folder) == ["body"]
    path = folder / "build" / "body" / "sources.json"
    path.write_text("x" * path.stat().st_size)
    assert made(folder) == ["body"]


@pytest.fixture
def change_versions(monkeypatch):
    """Replace the function that returns a library's version."""

    def change(function):
        monkeypatch.setattr(metadata, "version", function)
        installed_versions.cache_clear()

    yield change
    installed_versions.cache_clear()


@pytest.mark.parametrize(
    ("library", "first"),
    [
        ("cadquery-ocp", "body"),
        ("pytetwild", "mesh"),
        ("scipy", "simulate"),
        ("daqp", "optimize"),
        ("matplotlib", "report"),
    ],
)
def test_another_version_of_a_library_outdates_its_stage(folder, change_versions, library, first):
    device, before = load_device(folder), metadata.version
    old = stage_keys(device, folder / "build")
    change_versions(lambda n: "0" if n == library else before(n))
    new = stage_keys(device, folder / "build")
    names = [s.name for s in STAGES]
    assert [n for n in names if old[n] != new[n]] == names[names.index(first) :]


@pytest.mark.parametrize(("kind", "first"), [("print", "fabricate"), ("cast", "optimize")])
def test_cords_depend_on_moulds_of_cast_parts(folder, kind, first):
    """Layouts whose moulds cannot be opened are not chosen."""
    device = load_device(folder)
    before = replace(device, fabrication=replace(device.fabrication, kind=kind))
    after = replace(before, fabrication=replace(before.fabrication, mould_wall=9.0))
    old, new = stage_keys(before, folder / "build"), stage_keys(after, folder / "build")
    names = [s.name for s in STAGES]
    assert [n for n in names if old[n] != new[n]] == names[names.index(first) :]


def test_library_that_is_not_installed_has_no_version(folder, change_versions):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    old = stage_keys(load_device(folder), folder)
    change_versions(missing)
    assert stage_keys(load_device(folder), folder)["body"] != old["body"]
