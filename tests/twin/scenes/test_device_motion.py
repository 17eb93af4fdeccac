"""Motions of a device: ramps through simulated states, random paths, poses on demand, sway."""

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.scenes.device_motion import (
    PosePlayer,
    Ramp,
    draw_keys,
    draw_sway,
    interpolate_keys,
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


def test_random_path_is_smooth_and_shows_every_pose():
    times, keys = draw_keys(2, 20.0, np.random.default_rng(2))
    levels = interpolate_keys(times, keys, np.arange(0, times[-1], 1e-3))
    assert times[-1] >= 20
    assert (levels[0] == 0).all()
    assert (levels >= 0).all()
    assert (levels.sum(1) <= 1 + 1e-9).all()
    assert (levels.max(0) > 0.5).all()
    for ramp, level in zip(RAMPS, levels.T, strict=True):
        weights = ramp.weights(level)
        assert np.abs(np.diff(weights, n=2, axis=0)).max() < 6e-4  # a kink would be 4e-3
    assert (draw_keys(2, 20.0, np.random.default_rng(2))[1] == keys).all()


def test_path_passes_through_its_keys_and_stands_still_before_and_after():
    times, keys = np.arange(3.0), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    for time, k in ((1.0, 1), (5.0, 2), (-1.0, 0)):
        assert interpolate_keys(times, keys, time) == pytest.approx(keys[k])


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
    ("code", "levels"), [("levels-not-increasing", [0.5, 0.25]), ("ramp-sizes-differ", [0.5])]
)
def test_invalid_ramps_are_rejected(code, levels):
    with raises(CaptureError, code):
        Ramp("bend", np.array(levels), np.arange(2))
