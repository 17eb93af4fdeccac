"""Test the choice of the edge length, and what a build reports about poses."""

import json
import re
from dataclasses import replace

import meshio
import numpy as np
import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import SolveError
from defsense_fab.geometry.bodies.meshing.region_conforming import conform_to_regions
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.mesh_density import (
    Trial,
    choose_mesh,
    estimate_errors,
    measure_signals,
    probing_lines,
    relative_difference,
)
from tests.support.body_scripts import write_bar
from tests.support.errors import raises
from tests.support.places import BAR


def test_error_of_a_known_order_is_estimated():
    """Signals converge to 1 with an error of h^2; the estimate is that error."""
    sizes = [9.0, 6.0, 4.0]
    trials = [Trial(h, None, np.full((2, 5), 1 + 1e-3 * h**2), np.nan) for h in sizes]
    estimated = estimate_errors(trials)
    for h, trial in zip(sizes, estimated, strict=True):
        assert trial.error == pytest.approx(1e-3 * h**2, rel=0.1)


@pytest.mark.slow
def test_requested_accuracy_is_reached(bar):
    """Compare the signals of the chosen mesh with those of a mesh 2.2 times as fine."""
    device = load_device(BAR)
    device = replace(device, poses=(device.poses[0], device.poses[2]))
    regions = list(device.regions.values())

    def make(edge):
        return conform_to_regions(tetrahedralize(bar, edge).mesh, regions)

    choice = choose_mesh(device, bar, 0.05, make, lambda fraction, message: None)
    assert 0 < choice.chosen.error <= 0.05
    assert choice.chosen.edge_length == max(t.edge_length for t in choice.trials if t.error <= 0.05)
    coarse = QuadraticMesh.from_linear(choice.trials[0].mesh)
    lines = probing_lines(PointLocator(coarse), np.random.default_rng(0))
    fine = QuadraticMesh.from_linear(make(choice.chosen.edge_length / 2.2))
    true = measure_signals(device, fine, PointLocator(fine), lines)
    assert relative_difference(choice.chosen.signals - true, true) < 0.05


def test_probing_lines_run_inside_and_along(mesh_of_bar):
    locator = PointLocator(mesh_of_bar)
    lines = probing_lines(locator, np.random.default_rng(0))
    # Faces of the mesh are uneven by hundredths of a mm; a line next to one may graze it.
    assert locator.find(lines.reshape(-1, 3)).depth.min() > -0.03
    length = np.linalg.norm(lines[:, -1] - lines[:, 0], axis=1)
    assert length.min() > 60  # of a bar of 150


@pytest.fixture(scope="module")
def mesh_of_bar(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


@pytest.fixture
def folder(tmp_path):
    write_bar(tmp_path)
    text = (
        (BAR / "device.toml").read_text("utf-8").replace("edge_length = 8.0", "edge_length = 16.0")
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


@pytest.mark.slow
def test_reached_accuracy_is_recorded(folder, capsys):
    edit(folder, ("edge_length = 16.0", "accuracy = 0.1"))
    assert main(["mesh", str(folder)]) == 0
    capsys.readouterr()
    mesh = json.loads((folder / "build" / "mesh.json").read_text("utf-8"))
    assert mesh["accuracy"]["asked"] == 0.1
    assert mesh["accuracy"]["reached"] <= 0.1
    assert len(mesh["accuracy"]["tried"]) >= 2
    assert main(["mesh", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []


@pytest.mark.slow
def test_pose_that_does_not_converge_leaves_its_last_field(folder):
    """Base and tip nearly meet and are pushed into each other, which no body can endure."""
    edit(
        folder,
        ("base = { box = [[-1, -16, -16], [10,", "base = { box = [[-1, -16, -16], [70,"),
        ("tip = { box = [[140,", "tip = { box = [[90,"),
        ('translate = "free"', "translate = [-50, 0, 0]"),
    )
    with raises(SolveError, "pose-not-reached", state="bend_up@1") as caught:
        build(load_device(folder), "simulate")
    (unreached,) = (folder / "not-reached").glob("bend_up@*.vtu")
    assert caught.value.data["path"] == unreached
    assert 0 < caught.value.data["amplitude"] < 1
    field = meshio.read(unreached)
    assert np.abs(field.point_data["displacement"]).max() > 0
    assert (folder / "build" / "mesh.json").exists()  # earlier stages are kept
    assert not (folder / "build" / "fields").exists()


@pytest.mark.slow
def test_self_penetration_and_a_small_region_are_warnings(folder, capsys):
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
    warnings = "\n".join(found["warnings"])
    assert "bend_up@1: " in warnings
    assert "'dot'" in warnings


@pytest.mark.slow
def test_modes_propose_poses_that_can_be_built(folder, capsys):
    text = (folder / "device.toml").read_text("utf-8")
    start, end = text.index("tip ="), text.index("[outputs]")
    text = text[:start] + "\n" + text[end : text.index("[[sensors]]")]
    (folder / "device.toml").write_text(text + "[design]\nsensors = 1\n")
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 0
    output = capsys.readouterr().out
    assert "far_end" in output
    assert "\nnote: " not in output
    assert (folder / "modes.png").read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in load_device(folder).poses] == ["bend", "bend_2", "twist", "stretch"]
    assert main(["simulate", str(folder)]) == 0
    capsys.readouterr()
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 2
    assert "'bend'" in capsys.readouterr().err
    text = (folder / "device.toml").read_text("utf-8")
    assert "bend = 0.5, bend_2 = 1" in text  # mixtures, which name the poses
    text = re.sub(r"\b(bend|bend_2|twist|stretch)( = |\")", r"my_\1\2", text)
    (folder / "device.toml").write_text(text)
    assert main(["modes", str(folder), "--fixed", "base", "--write"]) == 0  # the same region
    assert "\nnote: " in capsys.readouterr().out  # mixtures lack the new poses
    assert set(load_device(folder).regions) == {"base", "far_end"}
    capsys.readouterr()
    assert main(["modes", str(folder), "--fixed", "bse"]) == 2
    assert "'bse'" in capsys.readouterr().err
