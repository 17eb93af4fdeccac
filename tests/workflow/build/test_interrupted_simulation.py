"""A simulation or a search for a mesh density that is interrupted keeps its solved poses."""

import re
import shutil
from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.solver.batch import solve_all
from defsense_fab.store.build import Build
from defsense_fab.workflow.build import stage_mesh, stage_simulate
from defsense_fab.workflow.build.build import build
from tests.support.body_scripts import write_bar
from tests.support.places import BAR


class Solver:
    """`solve_all`, which is interrupted after some poses, and counts those that it solves."""

    def __init__(self, interrupted_after=None):
        self.solved, self.limit = 0, interrupted_after

    def __call__(self, *arguments, on_solved):
        def count(job, equilibria):
            on_solved(job, equilibria)
            self.solved += 1
            if self.solved == self.limit:
                raise KeyboardInterrupt

        return solve_all(*arguments, threads=1, on_solved=count)


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coarse")
    write_bar(folder)
    shutil.copy(BAR / "device.toml", folder)
    path = folder / "device.toml"
    path.write_text(re.sub(r"edge_length = .*", "edge_length = 15", path.read_text("utf-8")))
    device = load_device(folder)
    build(device, until="mesh")
    return device


@pytest.mark.slow
def test_interrupted_simulation_resumes_with_the_same_fields(device, monkeypatch, tmp_path):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    messages = []

    def simulate(solver):
        shutil.rmtree(device.source / "build" / "fields", ignore_errors=True)
        made = Build(device.source / "build")
        stage_simulate.run(device, made, lambda _, message: messages.append(message), solver)
        folder = device.source / "build" / "fields"
        return {path.name: path.read_bytes() for path in folder.iterdir()}

    whole = Solver()
    expected = simulate(whole)
    assert not [m for m in messages if "resuming" in m]
    with pytest.raises(KeyboardInterrupt):
        simulate(Solver(3))
    assert len(list((tmp_path / "solved").iterdir())) == 3
    rest = Solver()
    assert simulate(rest) == expected
    assert rest.solved == whole.solved - 3
    assert [m for m in messages if "resuming" in m]
    assert list((tmp_path / "solved").iterdir()) == []


@pytest.mark.slow
def test_interrupted_search_for_a_density_resumes_with_the_same_mesh(device, monkeypatch, tmp_path):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    text = (device.source / "device.toml").read_text("utf-8")
    text = text.replace("edge_length = 15", "accuracy = 0.2")
    for name in ("device.toml", "bar.py"):
        shutil.copy(device.source / name, tmp_path)
    (tmp_path / "device.toml").write_text(text)
    whole_device = load_device(tmp_path)
    searched = replace(whole_device, poses=whole_device.poses[:2])
    kept, messages = tmp_path / "solved", []

    def search(solver):
        shutil.copytree(device.source / "build", tmp_path / "build", dirs_exist_ok=True)
        made = Build(tmp_path / "build")
        stage_mesh.run(searched, made, lambda _, message: messages.append(message), solver)
        return made.mesh.digest, made.mesh_record

    whole = Solver()
    expected = search(whole)
    assert (
        whole.solved == len(searched.poses) * len(expected[1].accuracy.tried) > len(searched.poses)
    )
    assert list(kept.iterdir()) == []
    after = len(searched.poses) + 1  # in the second mesh
    with pytest.raises(KeyboardInterrupt):
        search(Solver(after))
    assert len(list(kept.iterdir())) == after
    assert not [m for m in messages if "resuming" in m]
    rest = Solver()
    assert search(rest) == expected
    assert rest.solved == whole.solved - after
    assert len([m for m in messages if "resuming" in m]) == 2
    assert list(kept.iterdir()) == []
