"""The offset between two cameras' clocks is determined from moving tags."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking.observations import observe, store_views
from defsense_fab.capture.videos.camera_sync import find_offset
from tests.capture.rigs import flat, rig, spread, tags


def observed(cameras, delay, speed=1.0, noise=0.03, seconds=3.0):
    """Return observations of moving tags by two cameras; the second one's stamps are late."""
    rng = np.random.default_rng(0)
    X, result = tags(4, rng), []
    for c, (camera, start) in enumerate(zip(cameras, (0.0, 0.004), strict=True)):
        time = np.arange(start, seconds, 1 / 30)
        phase = 2 * np.pi * speed * time[:, None, None, None] + np.arange(4)[:, None, None]
        move = np.concatenate([20 * np.sin(phase), 5 * np.cos(phase), 15 * np.cos(phase)], axis=-1)
        corners = flat(camera, X + move * (speed > 0))
        corners = corners + rng.normal(0, noise, corners.shape)
        views = [TagView(np.arange(4), px, spread((4,), noise), px) for px in corners]
        result.append(observe(time + (delay if c else 0.0), store_views(views), np.arange(4)))
    return result


@pytest.mark.parametrize("delay", [0.015, -0.04, 0.0])
def test_offset_is_determined_from_moving_tags(delay):
    cameras = rig(2)
    offset = find_offset(cameras, *observed(cameras, delay), 0.1)
    assert offset is not None
    assert offset.value == pytest.approx(-delay, abs=5e-4)
    assert offset.sigma < 5e-4
    assert offset.after <= offset.before + 1e-9


def test_offset_is_unknown_without_motion_or_out_of_reach():
    cameras = rig(2)
    assert find_offset(cameras, *observed(cameras, 0.015, speed=0.0), 0.1) is None
    assert find_offset(cameras, *observed(cameras, 0.25), 0.1) is None
    first, second = observed(cameras, 0.0, seconds=0.05)
    assert find_offset(cameras, first, second, 0.1) is None
