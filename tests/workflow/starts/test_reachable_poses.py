"""New poses are no larger than one hand reaches."""

import numpy as np
import pytest

from defsense_fab.core.device.device import MaterialSpec
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.store.hand_strength import HAND
from defsense_fab.workflow.starts.body_ends import END_FRACTION, find_ends
from defsense_fab.workflow.starts.body_file import BodyFile
from defsense_fab.workflow.starts.first_device import create_first_device, fill_options
from defsense_fab.workflow.starts.options import END_POSES, NewOptions
from defsense_fab.workflow.starts.reachable_poses import describe_reach, reachable_share
from tests.conftest import box_surface
from tests.support.errors import raises

LENGTH, WIDTH, THICKNESS = 150.0, 40.0, 30.0
FREE = LENGTH * (1 - 2 / END_FRACTION)
STIFF, SOFT = 26.0, 0.1  # MPa


@pytest.fixture
def ends():
    return find_ends(box_surface([0, -20, -15], [LENGTH, 20, 15]))


def material(young):
    return MaterialSpec("x", young, 0.48)


def test_moments_of_a_box_are_exact(ends):
    assert ends.volume == pytest.approx(LENGTH * WIDTH * THICKNESS)
    sides = np.array([LENGTH, WIDTH, THICKNESS])
    assert ends.spread == pytest.approx(ends.volume * sides**2 / 12)


def test_soft_bodies_move_as_far_as_their_shape_suggests(ends):
    for pose in END_POSES:
        assert reachable_share(ends, pose, material(SOFT)) == 1
        assert ends.move(pose, 1.0) == ends.move(pose)


def test_a_bend_ends_where_one_hand_pushes_its_force(ends):
    """The moment of a bar in an arc is E I angle / L, the push at its end twice that over L."""
    share = reachable_share(ends, "bend", material(STIFF))
    angle = np.deg2rad(share * ends.turn("bend"))
    moment = STIFF * WIDTH * THICKNESS**3 / 12 * angle / FREE
    assert min(2 * moment / FREE / HAND.force, moment / HAND.torque) == pytest.approx(1)
    assert reachable_share(ends, "bend_side", material(STIFF)) < share


def test_a_twist_ends_where_one_hand_turns_its_torque(ends):
    """The torsion constant of a rectangle of 40 x 30 is 0.178 b h^3 (Timoshenko & Goodier).

    The estimate for any section is up to a tenth above it.
    """
    share = reachable_share(ends, "twist", material(STIFF))
    torsion = 0.178 * WIDTH * THICKNESS**3
    moment = STIFF / 2.96 * torsion * np.deg2rad(share * ends.turn("twist")) / FREE
    assert moment == pytest.approx(HAND.torque, rel=0.1)


def test_a_pull_ends_at_the_force_of_one_hand(ends):
    share = reachable_share(ends, "pull", material(STIFF))
    assert STIFF * WIDTH * THICKNESS * share * ends.pull / FREE == pytest.approx(HAND.force)


def test_a_process_that_does_not_make_the_material_is_refused():
    with raises(DeviceError, "material-not-for-process", material="tango-plus"):
        NewOptions(material="tango-plus", process="fdm-tpu")


def test_the_process_of_a_new_device_makes_its_material():
    surface = box_surface([0, -20, -15], [LENGTH, 20, 15])
    body = BodyFile(b"content", "bar", ".stl", surface, "mm", False, ())
    assert fill_options(body, NewOptions(material="tango-plus")).process == "polyjet"
    assert fill_options(body, NewOptions(material="tpu-95a")).process == "fdm-tpu"


def test_a_new_device_has_poses_that_a_hand_reaches(tmp_path):
    surface = box_surface([0, -20, -15], [LENGTH, 20, 15])
    body = BodyFile(b"content", "bar", ".stl", surface, "mm", False, ())
    degrees = {}
    for name in ("tpu-95a", "ecoflex-00-30"):
        options = NewOptions(material=name, poses=("bend", "twist"))
        device = create_first_device(body, tmp_path / name, options)
        turns = [np.linalg.norm(pose.handles[0].rotation) for pose in device.poses]
        degrees[name] = np.rad2deg(turns)
        note = describe_reach(find_ends(surface), load_device(tmp_path / name))
        assert ("bend" in note) == (name == "tpu-95a")
    assert (degrees["tpu-95a"] < 0.8 * degrees["ecoflex-00-30"]).all()
    assert degrees["tpu-95a"].min() > 0.5
