"""The edge length chosen by the accuracy of signals, and what a build says of poses."""

import json
import re
import shutil
from dataclasses import replace

import meshio
import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.meshing.region_conforming import conform_to_regions
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.workflow.build import mesh_density
from defsense_fab.workflow.build.mesh_density import Trial, choose, estimate, probing_lines
from tests.support.places import BAR


def test_richardson_finds_the_limit_of_a_known_order():
    """Signals that end at 1 with an error of h^2 each: the estimate is that error."""
    sizes = [9.0, 6.0, 4.0]
    trials = [Trial(h, None, np.full((2, 5), 1 + 1e-3 * h**2), np.nan) for h in sizes]
    found = estimate(trials)
    for h, trial in zip(sizes, found, strict=True):
        assert trial.error == pytest.approx(1e-3 * h**2, rel=0.1)


@pytest.mark.slow
def test_the_accuracy_that_is_promised_is_kept(bar):
    """The signals of the mesh that is chosen against a mesh of a third of its edge length."""
    device = load_device(BAR)
    device = replace(device, poses=(device.poses[0], device.poses[2]))
    regions = list(device.regions.values())

    def make(edge):
        return conform_to_regions(tetrahedralize(bar, edge).mesh, regions)

    choice = choose(device, bar, 0.02, make, lambda fraction, message: None)
    assert 0 < choice.taken.error <= 0.02
    assert choice.taken.edge_length == max(t.edge_length for t in choice.trials if t.error <= 0.02)
    coarse = QuadraticMesh.from_linear(choice.trials[0].mesh)
    lines = probing_lines(PointLocator(coarse), np.random.default_rng(0))
    fine = QuadraticMesh.from_linear(make(choice.taken.edge_length / 2.2))
    true = mesh_density._measure(device, fine, PointLocator(fine), lines)
    assert mesh_density._relative(choice.taken.signals - true, true) < 0.02


def test_probing_lines_run_inside_and_along(mesh_of_bar):
    locator = PointLocator(mesh_of_bar)
    lines = probing_lines(locator, np.random.default_rng(0))
    # The mesher leaves faces uneven by hundredths of a mm, which a line beside one may graze.
    assert locator.find(lines.reshape(-1, 3)).depth.min() > -0.03
    length = np.linalg.norm(lines[:, -1] - lines[:, 0], axis=1)
    assert length.min() > 60  # of a bar of 150


@pytest.fixture(scope="module")
def mesh_of_bar(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


@pytest.fixture
def folder(tmp_path):
    shutil.copy(BAR / "bar.py", tmp_path)
    text = (
        (BAR / "device.toml").read_text("utf-8").replace("edge_length = 6.0", "edge_length = 12.0")
    )
    text = text.replace("0.25, 0.5, 0.75, 1.0", "1.0")
    (tmp_path / "device.toml").write_text(text)
    return tmp_path


def edit(folder, *changes):
    path = folder / "device.toml"
    text = path.read_text("utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)


def test_accuracy_is_told_in_words_and_numbers(folder, capsys):
    edit(folder, ("edge_length = 12.0", "accuracy = 0.1"))
    assert main(["mesh", str(folder)]) == 0
    assert "keeps signals within" in capsys.readouterr().out
    mesh = json.loads((folder / "build" / "mesh.json").read_text("utf-8"))
    assert mesh["accuracy"]["asked"] == 0.1
    assert mesh["accuracy"]["reached"] <= 0.1
    assert len(mesh["accuracy"]["tried"]) >= 2
    assert main(["mesh", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []


def test_a_pose_too_far_leaves_what_was_reached(folder, capsys):
    """Base and tip nearly meet and are pushed into each other: no body takes that."""
    edit(
        folder,
        ("base = { box = [[-1, -16, -16], [10,", "base = { box = [[-1, -16, -16], [70,"),
        ("tip = { box = [[140,", "tip = { box = [[90,"),
        ('translate = "free"', "translate = [-50, 0, 0]"),
    )
    assert main(["simulate", str(folder)]) == 2
    said = capsys.readouterr().err
    assert "'bend_up@1' did not converge beyond" in said
    (left,) = (folder / "not-reached").glob("bend_up@*.vtu")
    assert str(left) in said
    field = meshio.read(left)
    assert np.abs(field.point_data["displacement"]).max() > 0
    assert (folder / "build" / "mesh.json").exists()  # what was done before is kept
    assert not (folder / "build" / "fields").exists()


def test_a_body_through_itself_and_a_small_region_are_notes(folder, capsys):
    twist = 'region = "tip"\nrotate = { axis = [1, 0, 0], degrees = 45 }'
    dot = "dot = { sphere = { center = [150, 0, 0], radius = 9 } }\n"
    edit(
        folder,
        ("height = 30", "height = 8"),
        ("degrees = -30", "degrees = -400"),
        ("tip = {", dot + "tip = {"),
        (twist, twist.replace("tip", "dot").replace("45", "5")),
    )
    assert main(["simulate", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["simulation"]
    status = {s["state"]: s["status"] for s in found["states"]}
    assert status["bend_up@1"] == "unsound"
    assert status["bend_down@1"] == "ok"
    said = "\n".join(found["warnings"])
    assert "bend_up@1: the body passes through itself about" in said
    assert "'dot' is" in said


def test_modes_propose_poses_that_build(folder, capsys):
    text = (folder / "device.toml").read_text("utf-8")
    start, end = text.index("tip ="), text.index("[outputs]")
    text = text[:start] + "\n" + text[end : text.index("[[sensors]]")]
    (folder / "device.toml").write_text(text + "[design]\nsensors = 1\n")
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 0
    said = capsys.readouterr().out
    assert "far_end" in said
    assert "add those" not in said
    assert (folder / "modes.png").read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in load_device(folder).poses] == ["bend", "bend_2", "twist", "stretch"]
    assert main(["simulate", str(folder)]) == 0
    capsys.readouterr()
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 2
    assert "there is a pose 'bend' already" in capsys.readouterr().err
    text = (folder / "device.toml").read_text("utf-8")
    assert "bend = 0.5, bend_2 = 1" in text  # mixtures, which name the poses
    text = re.sub(r"\b(bend|bend_2|twist|stretch)( = |\")", r"my_\1\2", text)
    (folder / "device.toml").write_text(text)
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 0  # the same region
    assert "add those of the new poses" in capsys.readouterr().out
    assert set(load_device(folder).regions) == {"base", "far_end"}
    capsys.readouterr()
    assert main(["modes", str(folder), "--fixed", "bse"]) == 2
    assert "no region 'bse'" in capsys.readouterr().err
