"""A simulation or a search for a mesh density that is interrupted keeps its solved poses."""

import re
import shutil
import time
from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import SolveError
from defsense_fab.mechanics.solver.batch import solve_all
from defsense_fab.mechanics.solver.load_stepping import Status
from defsense_fab.store.build import Build
from defsense_fab.workflow.build import stage_mesh, stage_simulate
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.load_cases import Loading
from tests.support.body_scripts import write_bar
from tests.support.errors import raises
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
    messages = []

    def simulate(solver, cache="cache"):
        monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / cache))
        shutil.rmtree(device.source / "build" / "fields", ignore_errors=True)
        made = Build(device.source / "build")
        stage_simulate.run(device, made, lambda _, message: messages.append(message), solver)
        folder = device.source / "build" / "fields"
        return {path.name: path.read_bytes() for path in folder.iterdir()}

    whole = Solver()
    expected = simulate(whole, "other-cache")
    assert not [m for m in messages if "solved before" in m]
    with pytest.raises(KeyboardInterrupt):
        simulate(Solver(3))
    kept = tmp_path / "cache" / "solved"
    assert len(list(kept.iterdir())) == 3
    rest = Solver()
    assert simulate(rest) == expected
    assert rest.solved == whole.solved - 3
    assert [m for m in messages if "solved before" in m]
    assert len(list(kept.iterdir())) == whole.solved
    again = Solver()
    assert simulate(again) == expected
    assert again.solved == 0


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
    assert not [m for m in messages if "solved before" in m]
    rest = Solver()
    assert search(rest) == expected
    assert rest.solved == whole.solved - after
    assert len([m for m in messages if "solved before" in m]) == 2
    assert list(kept.iterdir()) == []


def test_pose_over_its_budget_is_named_with_a_region_and_the_others_are_kept(
    device, monkeypatch, tmp_path
):
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    solver = Solver()

    def solve(*arguments, **options):
        results = solver(*arguments, **options)
        (*_, last) = results[0]
        given_up = replace(last, status=Status.OVER_BUDGET, state=None, last_state=last.state)
        return [[replace(given_up, amplitude=0.75)], *results[1:]]

    shutil.rmtree(device.source / "build" / "fields", ignore_errors=True)
    made, silent = Build(device.source / "build"), lambda *_: None
    with raises(SolveError, "pose-over-budget", amplitude=0.75) as caught:
        stage_simulate.run(device, made, silent, solve)
    assert caught.value.data["state"].startswith(device.poses[0].name)
    assert caught.value.data["region"] in {"base", "tip"}
    assert caught.value.data["strain"] > 0
    shutil.rmtree(device.source / "build" / "fields", ignore_errors=True)
    again = Solver()
    stage_simulate.run(device, made, silent, again)
    assert (again.solved, solver.solved > 1) == (0, True)


def test_progress_estimates_the_time_left(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    messages = []
    plan = [Loading({name: 1.0}, (0.5, 1.0), False) for name in ("a", "b", "c", "d")]
    show = stage_simulate.track_jobs(plan, lambda fraction, message: messages.append(message))
    show(0, 1.0)  # solved before
    now[0] = 20.0
    show(1, 0.5)
    assert "100 s" not in messages[0]
    now[0] = 40.0
    show(1, 1.0)
    assert "80 s" in messages[-1]  # two of three are left
    show(2, 1.0)
    show(3, 1.0)
    assert "left" not in messages[-1]
