"""Motions of a device: ramps through simulated states, random motions, poses on demand, sway."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.scenes.device_motion import (
    Motion,
    PosePlayer,
    Ramp,
    draw_motion,
    draw_sway,
)
from tests.support.errors import raises

LEVELS = np.array([0.25, 0.5, 0.75, 1.0])
RAMPS = (
    Ramp("bend", LEVELS, np.array([0, 1, 2, 3])),
    Ramp("twist", LEVELS[1::2], np.array([4, 5])),
)


def test_ramp_passes_through_its_states():
    for level, unit in zip(LEVELS, np.eye(4), strict=True):
        assert RAMPS[0].weights(np.array(level)) == pytest.approx(unit)
    assert RAMPS[0].weights(np.array(0.0)) == pytest.approx(np.zeros(4))


def test_random_motion_is_smooth_and_shows_every_pose():
    motion = draw_motion(RAMPS, 20.0, np.random.default_rng(2))
    t = np.arange(0, motion.times[-1], 1e-3)
    weights, levels = motion.weights(t), motion.levels(t)
    assert motion.times[-1] >= 20
    assert weights.shape == (len(t), 6)
    assert (weights[0] == 0).all()
    assert (levels >= 0).all()
    assert (levels.sum(1) <= 1 + 1e-9).all()
    assert (levels.max(0) > 0.5).all()
    assert np.abs(np.diff(weights, n=2, axis=0)).max() < 4e-4  # a kink would be 3e-3
    assert weights[1234] == pytest.approx(motion.weights(float(t[1234])))
    repeated = draw_motion(RAMPS, 20.0, np.random.default_rng(2))
    assert (repeated.keys == motion.keys).all()


def test_motion_passes_through_its_keys_and_rests_before_and_after():
    keys = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    motion = Motion(RAMPS, np.array([0.0, 1.0, 2.0]), keys)
    assert motion.weights(1.0) == pytest.approx(np.eye(6)[3])
    assert motion.weights(5.0) == pytest.approx(np.eye(6)[4])
    assert motion.weights(-1.0) == pytest.approx(np.zeros(6))


def test_sway_is_a_small_smooth_rigid_motion():
    sway = draw_sway(np.random.default_rng(0), np.array([50, 0, 0.0]), shift=4.0, degrees=6.0)
    motions = [sway.pose_at(t) for t in np.arange(0, 20, 0.1)]
    center = np.array([50.0, 0, 0])
    offsets = np.array([m.rotation @ center + m.translation - center for m in motions])
    assert 1 < np.linalg.norm(offsets, axis=1).max() < 4 * 3
    assert np.abs(np.diff(offsets, axis=0)).max() < 2
    for m in motions[::50]:
        assert m.rotation @ m.rotation.T == pytest.approx(np.eye(3), abs=1e-12)


def test_performances_start_and_end_at_rest():
    player = PosePlayer(
        [
            Ramp("bend", np.array([0.5, 1.0]), np.array([0, 1])),
            Ramp("twist", np.array([1.0]), np.array([2])),
        ]
    )
    player.perform("bend", 10.0, 8.0)
    player.perform("free", 20.0, 6.0)
    times = np.arange(9.0, 27.0, 0.02)
    bend = np.array([player.levels(t)["bend"] for t in times])
    twist = np.array([player.levels(t)["twist"] for t in times])
    during = (times > 10) & (times < 18)
    assert bend[during].max() > 0.85
    assert not twist[during].any()
    assert not bend[(times < 10.3) | ((times > 18) & (times < 20.3))].any()
    assert np.maximum(bend, twist)[times > 20].max() > 0.3
    assert np.abs(np.diff(bend)).max() < 0.05
    assert player.weights(9.0).tolist() == [0, 0, 0]
    assert player.weights(12.0).any()


@pytest.mark.parametrize(
    ("code", "make"),
    [
        ("levels-not-increasing", lambda: Ramp("bend", np.array([0.5, 0.25]), np.arange(2))),
        ("ramp-sizes-differ", lambda: Ramp("bend", np.array([0.5]), np.arange(2))),
        ("motion-sizes-differ", lambda: Motion(RAMPS, np.array([0.0, 1.0]), np.zeros((2, 3)))),
        ("motion-not-increasing", lambda: Motion(RAMPS, np.array([1.0, 1.0]), np.zeros((2, 2)))),
    ],
)
def test_invalid_motions_are_rejected(code, make):
    with raises(CaptureError, code):
        make()
