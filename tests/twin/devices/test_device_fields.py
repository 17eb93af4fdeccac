"""Displacement fields of a device, solved again for its twin."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.loading.boundary_conditions import State
from defsense_fab.mechanics.loading.pose import mix_poses
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.load_stepping import Equilibrium, Status
from defsense_fab.store.build import Build
from defsense_fab.store.layout import load_prediction
from defsense_fab.store.mesh import load_mesh
from defsense_fab.twin.devices.device_fields import MechanicsTraits, choose_material, solve_fields
from defsense_fab.twin.devices.pose_samples import (
    add_grips,
    find_mixable_poses,
    pose_axes,
)
from defsense_fab.twin.scenes.assumptions import disable_traits
from tests.support.errors import raises
from tests.support.places import DEVICES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def device(small_bar):
    return load_device(small_bar)


@pytest.fixture(scope="module")
def solved(device):
    return solve_fields(device)


def test_second_call_loads_the_same_fields(device, solved):
    reports = []
    loaded = solve_fields(device, progress=lambda *report: reports.append(report))
    assert reports == []
    assert np.array_equal(loaded.fields, solved.fields)
    assert np.array_equal(loaded.mesh.cells, solved.mesh.cells)
    assert (loaded.poses, loaded.error) == (("bend_up", "twist"), solved.error)


@pytest.mark.parametrize("after", [1, 7])
def test_interrupted_solve_resumes_with_the_same_fields(
    device, solved, tmp_path, monkeypatch, after
):
    """The files of the fields are moved away meanwhile, so that they are solved again."""
    from defsense_fab.twin.devices import device_fields as module

    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path))
    folder = device.source / "build" / "twin"
    folder.replace(tmp_path / "twin")
    counts = []

    def interrupt_after(limit):
        counts.append(0)

        def solve(*arguments, on_solved):
            def count(job, equilibria):
                on_solved(job, equilibria)
                counts[-1] += 1
                if counts[-1] == limit:
                    raise KeyboardInterrupt

            return solve_all(*arguments, on_solved=count)

        return solve

    try:
        monkeypatch.setattr(module, "solve_all", interrupt_after(after))
        with pytest.raises(KeyboardInterrupt):
            solve_fields(device)
        kept = len(list((tmp_path / "solved").iterdir()))
        assert kept >= after
        monkeypatch.setattr(module, "solve_all", interrupt_after(None))
        resumed = solve_fields(device)
        assert counts[1] > 0
        assert list((tmp_path / "solved").iterdir()) == []
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        (tmp_path / "twin").replace(folder)
    for name in ("fields", "mixable", "error", "signal_error", "warnings"):
        assert np.array_equal(getattr(resumed, name), getattr(solved, name))
    assert np.array_equal(resumed.space.states, solved.space.states)


def test_damaged_file_is_solved_again(device, solved, monkeypatch):
    from defsense_fab.twin.devices import device_fields as module

    path = next((device.source / "build" / "twin").glob("*.npz"))
    with np.load(path) as data:
        groups = data["groups"]
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    monkeypatch.setattr(module, "_solve", lambda *_: (solved, groups))
    assert np.array_equal(solve_fields(device).fields, solved.fields)
    assert path.stat().st_size == len(whole)


def test_interpolated_states_agree_with_the_solver(device, solved):
    assert solved.error < 0.1
    assert solved.signal_error < 5e-4
    weights = [{"bend_up": 0.63, "twist": 0.41}, {"bend_up": 0.3, "twist": 0.95}]
    jobs = [
        Job(
            mix_poses(device.poses, w, device.regions, solved.mesh, device.material.density), (1.0,)
        )
        for w in weights
    ]
    results = solve_all(solved.mesh, choose_material(device, MechanicsTraits()), jobs)
    true = np.array([r[0].u for r in results])
    levels = np.array([[w["bend_up"], w["twist"]] for w in weights])
    interpolated = np.tensordot(solved.space(levels), solved.fields, 1)
    error = np.linalg.norm(interpolated - true, axis=2)
    assert error.max() < 0.25
    assert np.sqrt((error**2).mean()) < 3 * solved.error + 0.02


def test_mesh_and_material_law_differ_from_the_design(device, solved):
    designed = load_mesh(device.source / "build")
    assert len(solved.mesh.cells) > 1.2 * len(designed.tets)
    own, other = Material.from_spec(device.material), choose_material(device, MechanicsTraits())
    assert other.model == "yeoh" != own.model
    assert (other.shear, other.bulk) == pytest.approx((own.shear, own.bulk))
    same = choose_material(device, disable_traits(MechanicsTraits(), {"mechanics"}))
    assert np.array_equal(same.parameters, own.parameters)
    assert disable_traits(MechanicsTraits(), {"mechanics"}).edge == 1.0
    yeoh = replace(device.material, model="yeoh", constants={"c10": 0.1, "c20": 0.0, "c30": 0.0})
    assert (
        choose_material(replace(device, material=yeoh), MechanicsTraits()).model == "mooney-rivlin"
    )


def test_displacements_are_zero_at_the_base_and_large_at_the_tip(device, solved):
    markers = load_prediction(device.source / "build").markers
    moved = solved.displacements(markers)
    is_base = device.regions["base"].contains(markers)
    is_tip = markers[:, 0] > 100
    assert np.abs(moved[:, is_base]).max(initial=0) < 0.05
    assert np.abs(moved[:, is_tip]).max() > 10


def test_opposite_poses_share_an_axis_and_are_not_mixed():
    poses = load_device(DEVICES / "bar").poses
    axes = pose_axes(poses)
    assert axes.shape == (2, 3)
    assert np.abs(axes[:, 0] + axes[:, 1]).max() < 1e-9
    assert find_mixable_poses(poses).tolist() == [
        [False, False, True],
        [False, False, True],
        [True, True, False],
    ]


def test_grips_pull_outside_of_the_regions_of_poses(device):
    build = Build(device.source / "build")
    poses = add_grips(device, build, 2)
    assert [p.name for p in poses] == ["bend_up", "twist", "grip_1", "grip_2"]
    assert find_mixable_poses(poses)[0, 2:].all()
    assert pose_axes(poses).shape == (4, 4)
    for p in poses[2:]:
        assert p.fixed == poses[0].fixed
        assert np.linalg.norm(p.drags[0].by) == pytest.approx(8.0)
        assert 10 < p.drags[0].at[0] < 140
    assert add_grips(device, build, 0) == device.poses


def test_search_for_states_ends_when_no_more_can_be_solved(device, monkeypatch):
    from defsense_fab.twin.devices import device_fields as module

    job_counts = []
    solve = module.solve_all

    def solve_twice(mesh, material, jobs, show, on_solved):
        job_counts.append(len(jobs))
        if len(job_counts) > 2:
            return [[Equilibrium(Status.NOT_REACHED, None, 0.0, None)] for _ in jobs]
        return solve(mesh, material, jobs, show, on_solved=on_solved)

    monkeypatch.setattr(module, "solve_all", solve_twice)
    coarse = MechanicsTraits(edge=1.0, states=1, accuracy=1e-6)
    fields = solve_fields(device, coarse)
    assert job_counts == [3, 6, 12]
    assert 1e-6 < fields.error < 0.2
    assert f"{fields.error:.2g} mm" in fields.warnings[-1]
    assert len(fields.warnings) == 1 + job_counts[-1]


def test_pose_that_is_not_reached_is_rejected(device, monkeypatch):
    from defsense_fab.twin.devices import device_fields as module

    def fail_second_job(mesh, material, jobs, show, on_solved):
        none = np.zeros((0, 3))
        state = State(np.zeros_like(mesh.nodes), none, none, jobs[0].conditions)
        solved = Equilibrium(Status.OK, state, 1.0, None)
        failed = Equilibrium(Status.NOT_REACHED, None, 0.0, None)
        return [[failed if k == 1 else solved for _ in job.fractions] for k, job in enumerate(jobs)]

    monkeypatch.setattr(module, "solve_all", fail_second_job)
    with raises(CaptureError, "pose-not-reached", pose="twist", reached=0.0):
        solve_fields(device, MechanicsTraits(edge=1.0, states=2))


def test_device_without_a_build_is_rejected(device, tmp_path):
    with pytest.raises(CaptureError):
        solve_fields(replace(device, source=tmp_path))
