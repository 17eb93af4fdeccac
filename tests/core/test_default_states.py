"""States that cover what poses span."""

import numpy as np

from defsense_fab.core.default_states import RAMP, default_states
from defsense_fab.core.device import Handle, Pose

FREE = np.full(3, np.nan)


def turn(name, x=0.0, y=0.0, z=0.0, region="tip", translation=FREE, fixed=("base",)):
    return Pose(name, fixed, (Handle(region, np.deg2rad([x, y, z]), np.asarray(translation)),))


UP, DOWN, TWIST = turn("up", y=-30), turn("down", y=30), turn("twist", x=45)


def test_pairs_that_are_not_opposite_are_mixed_whole_and_half():
    found = default_states([UP, DOWN, TWIST])
    assert not found.given
    assert found.ramp == RAMP
    assert {tuple(sorted(m.items())) for m in found.mixtures} == {
        (("twist", w), (pose, w)) if pose > "twist" else ((pose, w), ("twist", w))
        for pose in ("up", "down")
        for w in (0.5, 1.0)
    }
    assert len(found.held_out) == 4
    assert not [m for m in found.held_out if m in found.mixtures]


def test_three_poses_that_go_together_are_held_out_at_once():
    found = default_states([UP, TWIST, turn("sway", z=30)])
    assert {"up": 0.7, "twist": 0.7, "sway": 0.7} in found.held_out
    assert len(found.held_out) == 2 * 3 + 1


def test_where_nothing_goes_together_amplitudes_are_held_out():
    assert default_states([UP, DOWN]).held_out == ({"up": 0.875}, {"down": 0.875})
    assert default_states([UP], (1.0,)).held_out == ({"up": 0.5},)
    assert default_states([UP, DOWN]).mixtures == ()


def test_poses_that_do_not_agree_are_not_mixed():
    pulled = turn("pull", translation=[10, 0, 0])
    other = turn("other", x=20, region="base", fixed=("tip",))
    assert default_states([UP, pulled]).mixtures == ()
    assert default_states([UP, other]).mixtures == ()
    assert default_states([pulled, turn("push", translation=[-10, 0, 0])]).mixtures == ()
    assert default_states([pulled, turn("lift", translation=[0, 0, 10])]).mixtures


def test_many_poses_stay_few_states_that_have_each_pose():
    poses = [turn(f"p{k}", x=np.cos(k) * 30, y=np.sin(k) * 30, region=f"r{k}") for k in range(12)]
    found = default_states(poses)
    assert len(found.mixtures) == 30
    assert {name for m in found.mixtures for name in m} == {p.name for p in poses}
