"""The examples' devices as they are: read, posed far enough, and begun from a file of one's own."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.body_file import read_body_file

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


@pytest.mark.parametrize(("name", "body"), [("bar", "bar.py"), ("twist-bar", "bar.py")])
def test_examples_that_are_fixtures_too_are_the_same(name, body):
    for file in (body, "device.toml"):
        fixture = ROOT / "fixtures" / "devices" / name / file
        assert (EXAMPLES / name / file).read_bytes() == fixture.read_bytes()


@pytest.mark.parametrize(("name", "degrees"), [("sheet", 45), ("character", 30)])
def test_poses_go_as_far_as_the_paper_shows(name, degrees):
    for pose in load_device(EXAMPLES / name).poses:
        turns = [np.degrees(np.linalg.norm(h.rotation)) for h in pose.handles]
        assert max(turns) >= degrees, pose.name


def test_each_limb_of_the_character_moves_in_its_plane_and_out_of_it():
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


def test_a_character_of_one_s_own_begins_with_its_hands_feet_and_trunk(tmp_path):
    body = ROOT / "fixtures" / "devices" / "character" / "character.stl"
    made = tmp_path / "my-figure"
    program = EXAMPLES / "character" / "armadillo.py"
    subprocess.run([sys.executable, program, body, made], check=True, capture_output=True)
    device = load_device(made)
    points = device.body.scale * read_body_file(made / body.name).surface.vertices
    assert np.ptp(points[:, 2]) == pytest.approx(150, abs=0.1)
    held = {name: points[region.contains(points)] for name, region in device.regions.items()}
    assert set(held) == {"trunk", "left_hand", "right_hand", "left_foot", "right_foot"}
    for name, found in held.items():
        assert len(found), name
    assert held["left_hand"][:, 0].min() > 40
    assert held["right_foot"][:, 2].max() < 15
