"""Test the state after failed builds, with stages that only write a file each."""

import json
import shutil
from pathlib import Path

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.core.storage.files import write_json
from defsense_fab.workflow.build import (
    stage_body,
    stage_fabricate,
    stage_mesh,
    stage_optimize,
    stage_report,
    stage_simulate,
)
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.stages import STAGES

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
    """Return the names of the stages that have run, in their order."""
    names = []

    def stand_in(stage):
        def run(device, build, report, **_):
            folder = build.folder
            names.append(stage.name)
            for output in stage.outputs:
                if "." in output:
                    write_json(folder / output, {"device": device.name, "by": stage.name})
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
    def run(device, build, report, **_):
        (build.folder / stage).write_text("half")
        raise LayoutError("no room", code="no-room")

    return run


def interrupt(*_, **__):
    raise KeyboardInterrupt


def fails(folder, monkeypatch, module, run, error=LayoutError):
    """Run a build that fails with `error`, as the stage of `module` is replaced by `run`."""
    with monkeypatch.context() as m:
        m.setattr(module, "run", run)
        with pytest.raises(error):
            build(load_device(folder))


def change(folder, old, new):
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8").replace(old, new))


def hidden(folder):
    return sorted(p.name for p in folder.iterdir() if p.name.startswith(".") and p.is_dir())


def test_failure_of_the_first_stage_leaves_nothing(folder, ran, monkeypatch):
    monkeypatch.setattr(stage_body, "run", failing("body"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden(folder) == []
    assert not (folder / "build").exists()


def test_completed_stages_become_the_build_if_there_is_none(folder, ran, monkeypatch):
    fails(folder, monkeypatch, stage_optimize, failing("layout.json"))
    assert hidden(folder) == []
    assert (folder / "build" / "mesh.vtu").exists()
    assert not (folder / "build" / "layout.json").exists()
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")
    assert ran.count("simulate") == 1


def test_good_build_stays_and_completed_stages_are_reused_later(folder, ran, monkeypatch):
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    fails(folder, monkeypatch, stage_optimize, failing("layout.json"))
    assert (folder / "build" / "layout.json").exists()
    assert hidden(folder) == [".build-kept"]
    del ran[:]
    build(load_device(folder))
    assert ran == ["optimize", "fabricate", "report"]
    assert hidden(folder) == []


def test_build_of_another_mesh_costs_no_later_stage(folder, ran):
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    build(load_device(folder), "mesh")
    assert not (folder / "build" / "layout.json").exists()
    change(folder, "edge_length = 7.0", "edge_length = 6.0")
    del ran[:]
    result = build(load_device(folder))
    assert (result.made, ran) == ((), [])
    assert len(result.reused) == 6
    assert hidden(folder) == []


def test_later_stages_survive_removed_and_interrupted_builds(folder, ran):
    """One build is removed by the user, another is interrupted while folders are swapped."""
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    build(load_device(folder), "mesh")
    (folder / ".build-kept").replace(folder / ".build-old")
    build(load_device(folder), "mesh")
    assert hidden(folder) == [".build-kept"]
    shutil.rmtree(folder / "build")
    build(load_device(folder), "mesh")
    assert hidden(folder) == [".build-kept"]
    change(folder, "edge_length = 7.0", "edge_length = 6.0")
    del ran[:]
    build(load_device(folder))
    assert ran == []
    assert hidden(folder) == []


def test_failure_after_reused_stages_leaves_nothing(folder, ran, monkeypatch):
    build(load_device(folder))
    change(folder, "noise = 0.002", "noise = 0.003")
    monkeypatch.setattr(stage_optimize, "run", failing("layout.json"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden(folder) == []
    assert (folder / "build" / "layout.json").exists()


def test_solved_poses_survive_builds_that_fail_earlier(folder, ran, monkeypatch):
    """Poses are reused after a failed script and a failed build with another mesh."""
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    for module, output in ((stage_optimize, "layout.json"), (stage_body, "body"),
                           (stage_simulate, "index.json")):  # fmt: skip
        if module is stage_body:
            change(folder, "width = 30", "width = 31")
        if module is stage_simulate:
            change(folder, "width = 31", "width = 30")
            change(folder, "edge_length = 7.0", "edge_length = 8.0")
        fails(folder, monkeypatch, module, failing(output))
    change(folder, "edge_length = 8.0", "edge_length = 7.0")
    del ran[:]
    assert build(load_device(folder)).reused == ("body", "simulate")
    assert ran == ["mesh", "optimize", "fabricate", "report"]
    assert hidden(folder) == []


def test_interrupted_build_is_resumed_after_another_failed(folder, ran, monkeypatch):
    build(load_device(folder))
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    fails(folder, monkeypatch, stage_optimize, interrupt, KeyboardInterrupt)
    change(folder, "width = 30", "width = 31")
    fails(folder, monkeypatch, stage_body, failing("body"))
    change(folder, "width = 31", "width = 30")
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")


def test_needed_stages_are_not_replaced_by_an_interrupted_build(folder, ran, monkeypatch):
    build(load_device(folder))
    for before, after in (("6.0", "7.0"), ("6.0", "8.0")):
        change(folder, f"edge_length = {before}", f"edge_length = {after}")
        fails(folder, monkeypatch, stage_optimize, interrupt, KeyboardInterrupt)
        change(folder, f"edge_length = {after}", f"edge_length = {before}")
        if after == "7.0":  # all is up to date; completed stages are kept
            assert build(load_device(folder)).made == ()
            assert hidden(folder) == [".build-kept"]
    change(folder, "edge_length = 6.0", "edge_length = 7.0")
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")


@pytest.mark.parametrize("damaged", ["{", "{}"])
def test_damaged_layout_is_made_again_for_a_renamed_device(folder, ran, damaged):
    build(load_device(folder))
    layout = folder / "build" / "layout.json"
    whole = layout.read_text("utf-8")
    layout.write_text(damaged.ljust(len(whole)))
    change(folder, 'name = "bar"', 'name = "beam"')
    build(load_device(folder))
    assert json.loads(layout.read_text("utf-8"))["device"] == "beam"


def test_renamed_device_has_no_file_with_its_old_name(folder, ran):
    build(load_device(folder))
    change(folder, 'name = "bar"', 'name = "beam"')
    assert build(load_device(folder)).made == ("fabricate", "report")
    layout = folder / "build" / "layout.json"
    assert json.loads(layout.read_text("utf-8")) == {"device": "beam", "by": "optimize"}
    assert build(load_device(folder)).made == ()
