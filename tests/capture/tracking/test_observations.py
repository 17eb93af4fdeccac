"""Views by tag, between frames, and two cameras whose clocks differ."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking.camera_clocks import find_offset
from defsense_fab.capture.tracking.observations import Observations, interpolate
from tests.capture.rigs import collect, flat, rig, spread, tags


def view(*found):
    corners = np.array([[[x, 0.0], [x + 9, 0], [x + 9, 9], [x, 9]] for _, x in found])
    corners = corners.reshape(-1, 4, 2)
    return TagView(
        np.array([i for i, _ in found], int), corners, spread((len(found),), 0.1), corners
    )


def test_the_nearer_of_two_equal_numbers_is_chosen():
    views = [view((3, 300.0), (3, 10.0)), view((3, 12.0), (8, 50.0)), view((3, 290.0), (3, 14.0)),
             view(), view((3, 15.0), (99, 1.0))]  # fmt: skip
    seen = collect(np.arange(5) / 30, views, np.array([3, 8]))
    assert seen.corners[:, 0, 0, 0] == pytest.approx([np.nan, 12, 14, np.nan, 15], nan_ok=True)
    assert np.isnan(seen.corners[[0, 2, 3, 4], 1]).all()
    assert np.isnan(seen.covariance[3]).all()


def test_between_frames_corners_are_interpolated():
    time = np.array([0, 0.1, 0.2, 0.3, 0.7, 0.8])
    corners = np.zeros((6, 1, 4, 2))
    corners += (10 * time)[:, None, None, None]
    corners[2] = np.nan
    seen = Observations(time, np.array([5]), corners, spread((6, 1), 1.0))
    asked = np.array([-0.05, 0.0, 0.025, 0.1004, 0.15, 0.25, 0.3, 0.5, 0.75, 0.9])
    got, covariance = interpolate(seen, asked)
    expected = [np.nan, 0, 0.25, 1.0, np.nan, np.nan, 3, np.nan, 7.5, np.nan]
    assert got[:, 0, 0, 0] == pytest.approx(expected, nan_ok=True)
    assert covariance[2, 0, 0, 0, 0] == pytest.approx(0.75**2 + 0.25**2)
    for few in (0, 1):
        part = Observations(time[:few], seen.ids, corners[:few], seen.covariance[:few])
        assert np.isfinite(interpolate(part, asked)[0]).sum() == few * 8


def watched(cameras, late, speed=1.0, noise=0.03, seconds=3.0):
    rng = np.random.default_rng(0)
    X, out = tags(4, rng), []
    for c, (view_, begin) in enumerate(zip(cameras, (0.0, 0.004), strict=True)):
        true = np.arange(begin, seconds, 1 / 30)
        phase = 2 * np.pi * speed * true[:, None, None, None] + np.arange(4)[:, None, None]
        way = np.concatenate([20 * np.sin(phase), 5 * np.cos(phase), 15 * np.cos(phase)], axis=-1)
        corners = flat(view_, X + way * (speed > 0))
        corners = corners + rng.normal(0, noise, corners.shape)
        said = true + (late if c else 0.0)
        out.append(Observations(said, np.arange(4), corners, spread(corners.shape[:2], noise)))
    return out


@pytest.mark.parametrize("late", [0.015, -0.04, 0.0])
def test_the_offset_is_found_from_moving_tags(late):
    cameras = rig(2)
    found = find_offset(cameras, *watched(cameras, late), 0.1)
    assert found is not None
    assert found.value == pytest.approx(-late, abs=5e-4)
    assert found.sigma < 5e-4
    assert found.after <= found.before + 1e-9


def test_no_offset_without_motion_or_out_of_reach():
    cameras = rig(2)
    assert find_offset(cameras, *watched(cameras, 0.015, speed=0.0), 0.1) is None
    assert find_offset(cameras, *watched(cameras, 0.25), 0.1) is None
    first, second = watched(cameras, 0.0, seconds=0.05)
    assert find_offset(cameras, first, second, 0.1) is None
