"""Poses of the body's modes are shown, and written as the command writes them."""

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

LONG = 120.0


@pytest.fixture
def mode(studio_page):
    made = studio_page.modes["Poses"]
    studio_page.enter("Poses")
    assert made.work.wait(LONG)
    return made


def looked(mode):
    """With modes of the build's mesh, which is not made anew."""
    device = mode.bench.project.device
    mesh = QuadraticMesh.from_linear(load_mesh(device.source / "build"))
    held = np.flatnonzero(device.regions["base"].contains(mesh.nodes))
    material = Material.from_spec(device.material)
    found = vibration_modes(mesh, material, held, device.material.density, 5)
    poses = tuple(propose_poses(mesh, held, found))
    mode.suggestions.show(PoseSearch(mesh, tuple(found), poses, "far_end"), "base")
    return mode.suggestions


def test_proposed_poses_are_listed_and_shown_on_the_body(mode):
    part = looked(mode)
    assert part._list.options[:2] == ("bend", "bend_2")
    assert "| bend |" in part.words.content
    first = mode.scene.body.vertices
    assert 5 < np.abs(first - mode.scene.points).max() < 25  # an eighth of the body
    part.choose("bend_2")
    assert np.abs(mode.scene.body.vertices - first).max() > 5


def test_one_is_taken_with_its_region_and_undone(mode):
    before = mode.bench.project.text
    part = looked(mode)
    part._list.value = "bend_2"
    assert part.take() == "bend_2"
    device = load_device(mode.bench.project.folder)
    assert [p.name for p in device.poses] == ["bend_up", "twist", "bend_2"]
    assert device.poses[-1].handles[0].region == "far_end"
    assert mode.bench.project.undo_name == "take `bend_2`"
    part._list.value = "bend"
    assert part.take() == "bend"
    assert list(load_device(mode.bench.project.folder).regions) == ["base", "tip", "far_end"]
    mode.bench.project.undo()
    mode.bench.project.undo()
    assert mode.bench.project.text == before


def test_all_are_written_as_the_command_writes_them(mode, tmp_path):
    project = mode.bench.project
    text = project.text
    bare = text[: text.index("[[poses]]")] + text[text.index("[states]") :]
    bare = bare.replace(bare[bare.index("[states]") : bare.index("[outputs]")], "")
    (project.folder / "device.toml").write_text(bare, encoding="utf-8", newline="")
    project.refresh()
    mode.work.wait(LONG)
    part = looked(mode)
    assert part.take_all() == "bend"
    found = part.search_result
    proposal = Proposal(found.modes, found.poses, as_toml(list(found.poses), "base"), tmp_path)
    path = tmp_path / "device.toml"
    path.write_text(bare, encoding="utf-8", newline="")
    append_poses(path, proposal, ())
    assert project.text == path.read_text(encoding="utf-8")
    assert "held_out" in project.text
    assert mode.poses.chosen == "bend"


def test_names_that_are_taken_are_numbered(mode):
    part = looked(mode)
    part._list.value = "twist"
    assert part.take() == "twist_2"


def test_poses_are_sought_in_another_process(made_page):
    made_page.enter("Poses")
    part = made_page.modes["Poses"].suggestions
    part.search()
    assert part.job.running
    assert part.job.wait(LONG)
    assert part._list.options[0] == "bend"
    assert "| bend |" in part.words.content
    before = part.search_result
    part.search("gone")
    assert part.job.wait(LONG)
    assert part.error is not None
    assert part.search_result is before


def test_a_script_is_asked_about_before_it_is_run(mode, monkeypatch):
    monkeypatch.setattr(mode.bench, "agreement", Agreement())
    mode.suggestions.search()
    assert mode.bench.question.open
    assert not mode.suggestions.job.running
    mode.bench.question.close()
    assert mode.suggestions.take() is None
    assert mode.bench.message_code == "no-pose-chosen"
