"""What a failed build leaves behind: stages that write a file each stand in for the real ones."""

import shutil
from pathlib import Path

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.core.storage.files import write_json
from defsense_fab.pipeline.build import (
    stage_body,
    stage_fabricate,
    stage_mesh,
    stage_optimize,
    stage_report,
    stage_simulate,
)
from defsense_fab.pipeline.build.build import build
from defsense_fab.pipeline.build.stages import STAGES

BAR = Path(__file__).parents[3] / "fixtures" / "devices" / "bar"
MODULES = {
    "body": stage_body,
    "mesh": stage_mesh,
    "simulate": stage_simulate,
    "optimize": stage_optimize,
    "fabricate": stage_fabricate,
    "report": stage_report,
}


@pytest.fixture
def ran(monkeypatch):
    """The stages that have run, in their order."""
    names = []

    def stand_in(stage):
        def run(device, folder, report, **_):
            names.append(stage.name)
            for output in stage.outputs:
                if "." in output:
                    (folder / output).write_text(stage.name)
                else:
                    (folder / output).mkdir()
                    write_json(folder / output / "sources.json", {})

        return run

    for stage in STAGES:
        monkeypatch.setattr(MODULES[stage.name], "run", stand_in(stage))
    return names


@pytest.fixture
def folder(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    return tmp_path


def failing(stage):
    def run(device, folder, report, **_):
        (folder / stage).write_text("half")
        raise LayoutError("no room")

    return run


def change(folder, old, new):
    path = folder / "device.toml"
    path.write_text(path.read_text().replace(old, new))


def hidden(folder):
    return sorted(p.name for p in folder.iterdir() if p.name.startswith(".") and p.is_dir())


def test_nothing_is_left_where_nothing_was_finished(folder, ran, monkeypatch):
    monkeypatch.setattr(stage_body, "run", failing("body"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden(folder) == []
    assert not (folder / "build").exists()


def test_finished_stages_become_the_build_where_there_is_none(folder, ran, monkeypatch):
    with monkeypatch.context() as m:
        m.setattr(stage_optimize, "run", failing("layout.json"))
        with pytest.raises(LayoutError):
            build(load_device(folder))
    assert hidden(folder) == []
    assert (folder / "build" / "mesh.vtu").exists()
    assert not (folder / "build" / "layout.json").exists()
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")
    assert ran.count("simulate") == 1


def test_a_good_build_stays_and_new_stages_are_taken_up_later(folder, ran, monkeypatch):
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    with monkeypatch.context() as m:
        m.setattr(stage_optimize, "run", failing("layout.json"))
        with pytest.raises(LayoutError):
            build(load_device(folder))
    assert (folder / "build" / "layout.json").read_text() == "optimize"
    assert hidden(folder) == [".build-next"]
    del ran[:]
    build(load_device(folder))
    assert ran == ["optimize", "fabricate", "report"]
    assert hidden(folder) == []


def test_a_failure_after_stages_that_the_build_has_leaves_nothing(folder, ran, monkeypatch):
    build(load_device(folder))
    change(folder, "noise = 0.002", "noise = 0.003")
    monkeypatch.setattr(stage_optimize, "run", failing("layout.json"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden(folder) == []
    assert (folder / "build" / "layout.json").read_text() == "optimize"
