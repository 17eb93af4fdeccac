"""Test the state after failed builds, with stages that only write a file each."""

import json
import shutil

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
from tests.support.places import BAR

MODULES = {
    "body": stage_body,
    "mesh": stage_mesh,
    "simulate": stage_simulate,
    "optimize": stage_optimize,
    "fabricate": stage_fabricate,
    "report": stage_report,
}


@pytest.fixture
def stage_runs(monkeypatch):
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


def write_half_and_fail(stage):
    def run(device, build, report, **_):
        (build.folder / stage).write_text("half")
        raise LayoutError("no room", code="no-room")

    return run


def interrupt(*_, **__):
    raise KeyboardInterrupt


def fail_build(folder, monkeypatch, module, run, error=LayoutError):
    """Run a build that fails with `error`, as the stage of `module` is replaced by `run`."""
    with monkeypatch.context() as m:
        m.setattr(module, "run", run)
        with pytest.raises(error):
            build(load_device(folder))


def replace_text(folder, old, new):
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8").replace(old, new))


def hidden_folders(folder):
    return sorted(p.name for p in folder.iterdir() if p.name.startswith(".") and p.is_dir())


def test_failure_of_the_first_stage_leaves_nothing(folder, stage_runs, monkeypatch):
    monkeypatch.setattr(stage_body, "run", write_half_and_fail("body"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden_folders(folder) == []
    assert not (folder / "build").exists()


def test_completed_stages_become_the_build_if_there_is_none(folder, stage_runs, monkeypatch):
    fail_build(folder, monkeypatch, stage_optimize, write_half_and_fail("layout.json"))
    assert hidden_folders(folder) == []
    assert (folder / "build" / "mesh.vtu").exists()
    assert not (folder / "build" / "layout.json").exists()
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")
    assert stage_runs.count("simulate") == 1


def test_a_layout_stays_if_its_parts_cannot_be_made(folder, stage_runs, monkeypatch):
    fail_build(folder, monkeypatch, stage_fabricate, write_half_and_fail("parts"))
    assert (folder / "build" / "layout.json").exists()
    assert not (folder / "build" / "parts").exists()
    assert build(load_device(folder)).made == ("fabricate", "report")


def test_good_build_stays_and_completed_stages_are_reused_later(folder, stage_runs, monkeypatch):
    build(load_device(folder))
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    fail_build(folder, monkeypatch, stage_optimize, write_half_and_fail("layout.json"))
    assert (folder / "build" / "layout.json").exists()
    assert hidden_folders(folder) == [".build-kept"]
    del stage_runs[:]
    build(load_device(folder))
    assert stage_runs == ["optimize", "fabricate", "report"]
    assert hidden_folders(folder) == []


def test_build_of_another_mesh_costs_no_later_stage(folder, stage_runs):
    build(load_device(folder))
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    build(load_device(folder), "mesh")
    assert not (folder / "build" / "layout.json").exists()
    replace_text(folder, "edge_length = 7.0", "edge_length = 8.0")
    del stage_runs[:]
    result = build(load_device(folder))
    assert (result.made, stage_runs) == ((), [])
    assert len(result.reused) == 6
    assert hidden_folders(folder) == []


def test_later_stages_survive_removed_and_interrupted_builds(folder, stage_runs):
    """One build is removed by the user, another is interrupted while folders are swapped."""
    build(load_device(folder))
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    build(load_device(folder), "mesh")
    (folder / ".build-kept").replace(folder / ".build-old")
    build(load_device(folder), "mesh")
    assert hidden_folders(folder) == [".build-kept"]
    shutil.rmtree(folder / "build")
    build(load_device(folder), "mesh")
    assert hidden_folders(folder) == [".build-kept"]
    replace_text(folder, "edge_length = 7.0", "edge_length = 8.0")
    del stage_runs[:]
    build(load_device(folder))
    assert stage_runs == []
    assert hidden_folders(folder) == []


def test_failure_after_reused_stages_leaves_nothing(folder, stage_runs, monkeypatch):
    build(load_device(folder))
    replace_text(folder, "noise = 0.002", "noise = 0.003")
    monkeypatch.setattr(stage_optimize, "run", write_half_and_fail("layout.json"))
    with pytest.raises(LayoutError):
        build(load_device(folder))
    assert hidden_folders(folder) == []
    assert (folder / "build" / "layout.json").exists()


def test_solved_poses_survive_builds_that_fail_earlier(folder, stage_runs, monkeypatch):
    """Poses are reused after a failed script and a failed build with another mesh."""
    build(load_device(folder))
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    for module, output in ((stage_optimize, "layout.json"), (stage_body, "body"),
                           (stage_simulate, "index.json")):  # fmt: skip
        if module is stage_body:
            replace_text(folder, "width = 30", "width = 31")
        if module is stage_simulate:
            replace_text(folder, "width = 31", "width = 30")
            replace_text(folder, "edge_length = 7.0", "edge_length = 9.0")
        fail_build(folder, monkeypatch, module, write_half_and_fail(output))
    replace_text(folder, "edge_length = 9.0", "edge_length = 7.0")
    del stage_runs[:]
    assert build(load_device(folder)).reused == ("body", "simulate")
    assert stage_runs == ["mesh", "optimize", "fabricate", "report"]
    assert hidden_folders(folder) == []


def test_interrupted_build_is_resumed_after_another_failed(folder, stage_runs, monkeypatch):
    build(load_device(folder))
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    fail_build(folder, monkeypatch, stage_optimize, interrupt, KeyboardInterrupt)
    replace_text(folder, "width = 30", "width = 31")
    fail_build(folder, monkeypatch, stage_body, write_half_and_fail("body"))
    replace_text(folder, "width = 31", "width = 30")
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")


def test_needed_stages_are_not_replaced_by_an_interrupted_build(folder, stage_runs, monkeypatch):
    build(load_device(folder))
    for before, after in (("8.0", "7.0"), ("8.0", "9.0")):
        replace_text(folder, f"edge_length = {before}", f"edge_length = {after}")
        fail_build(folder, monkeypatch, stage_optimize, interrupt, KeyboardInterrupt)
        replace_text(folder, f"edge_length = {after}", f"edge_length = {before}")
        if after == "7.0":  # all is up to date; completed stages are kept
            assert build(load_device(folder)).made == ()
            assert hidden_folders(folder) == [".build-kept"]
    replace_text(folder, "edge_length = 8.0", "edge_length = 7.0")
    assert build(load_device(folder)).made == ("optimize", "fabricate", "report")


@pytest.mark.parametrize("damaged", ["{", "{}"])
def test_damaged_layout_is_made_again_for_a_renamed_device(folder, stage_runs, damaged):
    build(load_device(folder))
    layout = folder / "build" / "layout.json"
    whole = layout.read_text("utf-8")
    layout.write_text(damaged.ljust(len(whole)))
    replace_text(folder, 'name = "bar"', 'name = "beam"')
    build(load_device(folder))
    assert json.loads(layout.read_text("utf-8"))["device"] == "beam"


def test_renamed_device_has_no_file_with_its_old_name(folder, stage_runs):
    build(load_device(folder))
    replace_text(folder, 'name = "bar"', 'name = "beam"')
    assert build(load_device(folder)).made == ("fabricate", "report")
    layout = folder / "build" / "layout.json"
    assert json.loads(layout.read_text("utf-8")) == {"device": "beam", "by": "optimize"}
    assert build(load_device(folder)).made == ()
