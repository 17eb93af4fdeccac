"""Devices of the examples: their files, their poses, and a device from a user's mesh."""

import subprocess
import sys

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.body import read_body_file
from tests.support.places import ROOT

EXAMPLES = ROOT / "examples"


@pytest.mark.parametrize(("name", "body"), [("bar", "bar.py"), ("twist-bar", "bar.py")])
def test_copies_of_examples_in_fixtures_are_equal(name, body):
    for file in (body, "device.toml"):
        fixture = ROOT / "fixtures" / "devices" / name / file
        assert (EXAMPLES / name / file).read_bytes() == fixture.read_bytes()


@pytest.mark.parametrize(("name", "degrees"), [("sheet", 45), ("character", 30)])
def test_poses_are_as_large_as_in_the_paper(name, degrees):
    for pose in load_device(EXAMPLES / name).poses:
        turns = [np.degrees(np.linalg.norm(h.rotation)) for h in pose.handles]
        assert max(turns) >= degrees, pose.name


def test_each_limb_of_the_character_moves_in_and_out_of_its_plane():
    poses = load_device(EXAMPLES / "character").poses
    limbs = {"left_hand", "right_hand", "left_foot", "right_foot"}
    turns = {h.region: [] for p in poses for h in p.handles}
    for handle in (h for p in poses for h in p.handles):
        turns[handle.region].append(handle.rotation)
    assert set(turns) == limbs
    for axes in turns.values():  # the figure stands in the plane of x and z
        inside, out = sorted(np.abs(axes), key=lambda a: -a[1])
        assert inside.argmax() == 1
        assert out.argmax() != 1


@pytest.mark.slow
def test_device_from_a_mesh_has_regions_of_hands_feet_and_trunk(tmp_path):
    body = ROOT / "fixtures" / "devices" / "character" / "character.stl"
    folder = tmp_path / "my-figure"
    program = EXAMPLES / "character" / "armadillo.py"
    subprocess.run([sys.executable, program, body, folder], check=True, capture_output=True)
    device = load_device(folder)
    points = device.body.scale * read_body_file(folder / body.name).surface.vertices
    assert np.ptp(points[:, 2]) == pytest.approx(150, abs=0.1)
    by_region = {name: points[region.contains(points)] for name, region in device.regions.items()}
    assert set(by_region) == {"trunk", "left_hand", "right_hand", "left_foot", "right_foot"}
    for name, inside in by_region.items():
        assert len(inside), name
    assert by_region["left_hand"][:, 0].min() > 40
    assert by_region["right_foot"][:, 2].max() < 15
