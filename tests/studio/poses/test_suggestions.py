"""Poses of the body's modes are shown, and written as the command writes them."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.solver.modes import modes, propose
from defsense_fab.pipeline.artifacts.mesh import load_mesh
from defsense_fab.pipeline.study.propose_poses import Found, Proposal, append, as_toml
from defsense_fab.studio.poses import suggestion_part

LONG = 120.0


@pytest.fixture
def mode(studio_page, monkeypatch):
    """The mode, with modes of the build's mesh, which is not made anew."""

    def find(device, fixed):
        if fixed not in device.regions:
            raise DeviceError("device.toml: regions: gone")
        mesh = QuadraticMesh.from_linear(load_mesh(device.source / "build"))
        held = np.flatnonzero(device.regions[fixed].contains(mesh.nodes))
        material = Material.from_spec(device.material)
        found = modes(mesh, material, held, device.material.density, 5)
        return Found(mesh, tuple(found), tuple(propose(mesh, held, found)), "far_end")

    monkeypatch.setattr(suggestion_part, "find_poses", find)
    made = studio_page.modes["Poses"]
    studio_page.enter("Poses")
    assert made.work.wait(LONG)
    return made


def looked(mode):
    mode.suggestions.look()
    assert mode.suggestions.wait(LONG)
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
    assert mode.bench.project.undoes == "take `bend_2`"
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
    found = part._found
    proposal = Proposal(found.modes, found.poses, as_toml(list(found.poses), "base"), tmp_path)
    path = tmp_path / "device.toml"
    path.write_text(bare, encoding="utf-8", newline="")
    append(path, proposal, ())
    assert project.text == path.read_text(encoding="utf-8")
    assert "held_out" in project.text
    assert mode.poses.chosen == "bend"


def test_names_that_are_taken_are_numbered(mode):
    part = looked(mode)
    part._list.value = "twist"
    assert part.take() == "twist_2"


def test_what_cannot_be_found_is_told(mode):
    part = mode.suggestions
    assert part.take() is None
    assert "Look for poses" in mode.bench._message.content
    part._looking.give("gone")
    assert part.wait(LONG)
    assert part.words.content == "**device.toml: regions: gone**"
