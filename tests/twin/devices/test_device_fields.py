"""A device's shapes, solved afresh for its twin."""

from dataclasses import replace

import numpy as np
import pytest
from defsense_fab.store.layout import load_prediction
from defsense_fab.store.mesh import load_mesh
from defsense_fab.twin.devices.device_fields import solve_fields, choose_material, MechanicsTraits
from defsense_fab.twin.devices.pose_samples import find_mixable_poses, pose_axes, add_grips, place_grips

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.loading.boundary_conditions import State
from defsense_fab.mechanics.loading.pose import mix_poses
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.load_stepping import Equilibrium, Status
from defsense_fab.twin.scenes.assumptions import disable_traits
from tests.places import DEVICES


@pytest.fixture(scope="module")
def device(small_bar):
    return load_device(small_bar)


@pytest.fixture(scope="module")
def solved(device):
    return solve_fields(device)


def test_a_second_call_is_immediate_and_the_same(device, solved):
    told = []
    again = solve_fields(device, progress=lambda *what: told.append(what))
    assert told == []
    assert np.array_equal(again.fields, solved.fields)
    assert np.array_equal(again.mesh.cells, solved.mesh.cells)
    assert (again.poses, again.error) == (("bend_up", "twist"), solved.error)


def test_a_damaged_file_is_made_anew(device, solved, monkeypatch):
    from defsense_fab.twin.devices import solve_fields as module

    path = next((device.source / "build" / "twin").glob("*.npz"))
    with np.load(path) as kept:
        groups = kept["groups"]
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    monkeypatch.setattr(module, "_solve", lambda *_: (solved, groups))
    assert np.array_equal(solve_fields(device).fields, solved.fields)
    assert path.stat().st_size == len(whole)


def test_states_that_were_not_solved_are_found_between_those_that_were(device, solved):
    """Against the solver itself, and as it says of itself."""
    assert solved.error < 0.1
    assert solved.signal_error < 5e-4
    weights = [{"bend_up": 0.63, "twist": 0.41}, {"bend_up": 0.3, "twist": 0.95}]
    jobs = [
        Job(mix_poses(device.poses, w, device.regions, solved.mesh, device.material.density), (1.0,))
        for w in weights
    ]
    found = solve_all(solved.mesh, choose_material(device, MechanicsTraits()), jobs)
    true = np.array([r[0].u for r in found])
    levels = np.array([[w["bend_up"], w["twist"]] for w in weights])
    ours = np.tensordot(solved.space(levels), solved.fields, 1)
    off = np.linalg.norm(ours - true, axis=2)
    assert off.max() < 0.25
    assert np.sqrt((off**2).mean()) < 3 * solved.error + 0.02


def test_neither_mesh_nor_law_is_that_of_the_design(device, solved):
    designed = load_mesh(device.source / "build")
    assert len(solved.mesh.cells) > 1.2 * len(designed.tets)
    own, other = Material.from_spec(device.material), choose_material(device, MechanicsTraits())
    assert other.model == "yeoh" != own.model
    assert (other.shear, other.bulk) == pytest.approx((own.shear, own.bulk))
    same = choose_material(device, disable_traits(MechanicsTraits(), {"mechanics"}))
    assert np.array_equal(same.parameters, own.parameters)
    assert disable_traits(MechanicsTraits(), {"mechanics"}).edge == 1.0
    yeoh = replace(device.material, model="yeoh", constants={"c10": 0.1, "c20": 0.0, "c30": 0.0})
    assert choose_material(replace(device, material=yeoh), MechanicsTraits()).model == "mooney-rivlin"


def test_displacements_are_those_of_the_poses(device, solved):
    markers = load_prediction(device.source / "build").markers
    moved = solved.displacements(markers)
    held = device.regions["base"].contains(markers)
    tip = markers[:, 0] > 100
    assert np.abs(moved[:, held]).max(initial=0) < 0.05
    assert np.abs(moved[:, tip]).max() > 10


def test_opposite_poses_share_an_axis_and_are_not_mixed():
    poses = load_device(DEVICES / "bar").poses
    axes = pose_axes(poses)
    assert axes.shape == (2, 3)
    assert np.abs(axes[:, 0] + axes[:, 1]).max() < 1e-9
    assert find_mixable_poses(poses).tolist() == [
        [False, False, True], [False, False, True], [True, True, False]
    ]  # fmt: skip


def test_grips_pull_where_no_pose_holds(device):
    made = place_grips(device, device.source / "build", 2)
    poses = add_grips(device.poses, made)
    assert [p.name for p in poses] == ["bend_up", "twist", "grip_1", "grip_2"]
    assert find_mixable_poses(poses)[0, 2:].all()
    assert pose_axes(poses).shape == (4, 4)
    for p in poses[2:]:
        assert p.fixed == poses[0].fixed
        assert np.linalg.norm(p.drags[0].by) == pytest.approx(8.0)
        assert 10 < p.drags[0].at[0] < 140
    assert place_grips(device, device.source / "build", 0) == ()


def test_shapes_that_are_not_known_well_enough_are_told(device, monkeypatch):
    """What the solver no longer reaches ends the search for more states."""
    from defsense_fab.twin.devices import solve_fields as module

    asked = []
    solve = module.solve_all

    def until_later(mesh, material, jobs, show):
        asked.append(len(jobs))
        if len(asked) > 2:
            return [[Equilibrium(Status.NOT_REACHED, None, 0.0, None)] for _ in jobs]
        return solve(mesh, material, jobs, show)

    monkeypatch.setattr(module, "solve_all", until_later)
    coarse = MechanicsTraits(edge=1.0, states=1, accuracy=1e-6)
    found = solve_fields(device, coarse)
    assert asked == [3, 6, 12]
    assert any("known within" in w for w in found.warnings)
    assert any("it did not converge" in w for w in found.warnings)
    assert 1e-6 < found.error < 0.2


def test_a_pose_that_is_not_reached_is_refused(device, monkeypatch):
    """By its name: between other states there is no such shape."""
    from defsense_fab.twin.devices import solve_fields as module

    def but_the_second(mesh, material, jobs, show):
        none = np.zeros((0, 3))
        state = State(np.zeros_like(mesh.nodes), none, none, jobs[0].conditions)
        there = Equilibrium(Status.OK, state, 1.0, None)
        gone = Equilibrium(Status.NOT_REACHED, None, 0.0, None)
        return [[gone if k == 1 else there for _ in job.fractions] for k, job in enumerate(jobs)]

    monkeypatch.setattr(module, "solve_all", but_the_second)
    with pytest.raises(CaptureError, match="reaches 0% of the pose twist; give --off mechanics"):
        solve_fields(device, MechanicsTraits(edge=1.0, states=2))


def test_a_device_without_a_build_is_refused(device, tmp_path):
    with pytest.raises(CaptureError, match="is not built; run 'defsense build"):
        solve_fields(replace(device, source=tmp_path))
