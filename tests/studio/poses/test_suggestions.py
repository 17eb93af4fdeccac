"""Poses that are proposed from the body's vibration modes."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.solver.linear_response import propose_poses, vibration_modes
from defsense_fab.store.mesh import load_mesh
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.workflow.study.propose_poses import PoseSearch, Proposal, append_poses, as_toml

TIMEOUT_S = 600.0


@pytest.fixture
def mode(studio_page):
    mode = studio_page.modes["Poses"]
    studio_page.enter("Poses")
    assert mode.work.wait(TIMEOUT_S)
    return mode


def propose(mode):
    """Show the modes of the build's mesh, without a search in another process."""
    device = mode.bench.project.device
    mesh = QuadraticMesh.from_linear(load_mesh(device.source / "build"))
    held = np.flatnonzero(device.regions["base"].contains(mesh.nodes))
    material = Material.from_spec(device.material)
    modes = vibration_modes(mesh, material, held, device.material.density, 5)
    poses = tuple(propose_poses(mesh, held, modes))
    mode.suggestions.show(PoseSearch(mesh, tuple(modes), poses, "far_end"), "base")
    return mode.suggestions


def test_proposed_poses_are_listed_and_shown_on_the_body(mode):
    part = propose(mode)
    assert part.names[:2] == ("bend", "bend_2")
    first = mode.scene.body.vertices
    assert 5 < np.abs(first - mode.scene.points).max() < 25  # an eighth of the body
    part.choose("bend_2")
    assert np.abs(mode.scene.body.vertices - first).max() > 5


def test_a_pose_is_added_with_its_region_and_undone(mode):
    before = mode.bench.project.text
    part = propose(mode)
    part.chosen = "bend_2"
    assert part.add() == "bend_2"
    device = load_device(mode.bench.project.folder)
    assert [p.name for p in device.poses] == ["bend_up", "twist", "bend_2"]
    assert device.poses[-1].handles[0].region == "far_end"
    assert mode.bench.project.undo_name == "add the poses `bend_2`"
    part.chosen = "bend"
    assert part.add() == "bend"
    assert list(load_device(mode.bench.project.folder).regions) == ["base", "tip", "far_end"]
    mode.bench.project.undo()
    mode.bench.project.undo()
    assert mode.bench.project.text == before


def test_all_poses_are_added_as_the_command_writes_them(mode, tmp_path):
    project = mode.bench.project
    text = project.text
    bare = text[: text.index("[[poses]]")] + text[text.index("[states]") :]
    bare = bare.replace(bare[bare.index("[states]") : bare.index("[outputs]")], "")
    (project.folder / "device.toml").write_text(bare, encoding="utf-8", newline="")
    project.refresh()
    mode.work.wait(TIMEOUT_S)
    part = propose(mode)
    assert part.add_all() == "bend"
    search = part.result
    text = as_toml(list(search.poses), "base")
    proposal = Proposal(search.modes, search.poses, text, tmp_path)
    path = tmp_path / "device.toml"
    path.write_text(bare, encoding="utf-8", newline="")
    append_poses(path, proposal, ())
    assert project.text == path.read_text(encoding="utf-8")
    assert "held_out" in project.text
    assert mode.poses.chosen == "bend"


def test_used_names_are_numbered(mode):
    part = propose(mode)
    part.chosen = "twist"
    assert part.add() == "twist_2"


@pytest.mark.slow
def test_poses_are_searched_for_in_another_process(made_page):
    made_page.enter("Poses")
    part = made_page.modes["Poses"].suggestions
    part.search()
    assert part.job.is_running
    assert part.job.wait(TIMEOUT_S)
    assert part.names[0] == "bend"
    before = part.result
    part.search("gone")
    assert part.job.wait(TIMEOUT_S)
    assert part.status.error is not None
    assert part.result is before


def test_the_user_is_asked_before_a_script_runs(mode, monkeypatch):
    monkeypatch.setattr(mode.bench, "agreement", Agreement())
    mode.suggestions.search()
    assert mode.bench.question.is_open
    assert not mode.suggestions.job.is_running
    mode.bench.question.close()
    assert mode.suggestions.add() is None
    assert mode.bench.status.code == "no-pose-chosen"
