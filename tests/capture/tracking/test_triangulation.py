"""Triangulation of tags: exact, honest, and without the camera that is wrong."""

import numpy as np
import pytest

from defsense_fab.capture.tracking.reconstruction import reconstruct, triangulate
from tests.capture.rigs import flat, rig, spread, tags


@pytest.mark.parametrize("count", [2, 3])
def test_tags_without_noise_are_located_exactly(count):
    cameras, X = rig(count), tags(20, np.random.default_rng(0))
    seen = np.stack([flat(c, X) for c in cameras], axis=1)
    found = triangulate(cameras, seen, spread(seen.shape[:2], 0.05))
    assert np.allclose(found.corners, X, atol=1e-8)
    assert np.allclose(found.points, X.mean(axis=1), atol=1e-8)
    assert found.used.all()
    assert found.miss.max() < 1e-8


def test_the_covariance_matches_many_trials():
    rng, sigma = np.random.default_rng(1), 0.05
    cameras, X = rig(3), np.repeat(tags(1, np.random.default_rng(3)), 1500, axis=0)
    seen = np.stack([flat(c, X) for c in cameras], axis=1)
    # One camera is three times worse, and says so.
    scale = np.array([1, 1, 3.0])[:, None, None]
    found = triangulate(
        cameras, seen + rng.normal(0, sigma, seen.shape) * scale,
        spread(seen.shape[:2], sigma) * scale[..., None] ** 2,
    )  # fmt: skip
    error = found.points - X.mean(axis=1)
    assert np.abs(error.mean(axis=0) / error.std(axis=0)).max() < 0.1
    ratio = np.linalg.solve(found.covariance.mean(axis=0), np.cov(error.T))
    assert np.abs(np.linalg.eigvals(ratio) - 1).max() < 0.25


def test_a_camera_that_disagrees_is_left_out_of_three_and_two_locate_nothing():
    X = tags(5, np.random.default_rng(2))
    for wrong in range(3):
        cameras = rig(3)
        seen = np.stack([flat(c, X) for c in cameras], axis=1)
        seen[1, wrong] += 30.0
        found = triangulate(cameras, seen, spread(seen.shape[:2], 0.05))
        assert np.allclose(found.points, X.mean(axis=1), atol=1e-6)
        assert found.used[1].tolist() == [k != wrong for k in range(3)]
        assert found.used[[0, 2, 3, 4]].all()
    two = triangulate(cameras[:2], seen[:, :2] + np.array([[[0]], [[25.0]]]), spread((5, 2), 0.05))
    assert np.isnan(two.points).all()
    assert np.isnan(two.covariance).all()
    assert not two.used.any()


def test_points_behind_a_camera_are_not_located():
    cameras, X = rig(2), tags(1, np.random.default_rng(2))
    eye = np.mean([c.center for c in cameras], axis=0)
    behind = 2 * eye - X  # the rays' lines meet there
    seen = np.stack([flat(c, behind) for c in cameras], axis=1)
    found = triangulate(cameras, seen, spread((1, 2), 0.05))
    assert np.isnan(found.points).all()


def test_several_cameras_one_camera_and_none_together():
    rng = np.random.default_rng(4)
    cameras, X = rig(2), tags(6, rng).reshape(2, 3, 4, 3)
    seen = np.stack([flat(c, X) for c in cameras], axis=2)
    seen[0, 0, 1], seen[1, 2] = np.nan, np.nan
    covariance = spread(seen.shape[:3], 0.05)
    covariance[~np.isfinite(seen[..., 0, 0])] = np.nan
    found = reconstruct(cameras, seen, covariance, 15.0)
    assert found.seen.tolist() == [[1, 2, 2], [2, 2, 0]]
    assert found.cameras.tolist() == [[1, 2, 2], [2, 2, 0]]
    there = found.seen > 0
    assert np.allclose(found.points[there], X.mean(axis=2)[there], atol=1e-4)
    assert np.isnan(found.points[1, 2]).all()
    assert np.allclose(found.sides[found.seen == 2], 15.0, atol=1e-6)
    deep = np.trace(found.covariance, axis1=-2, axis2=-1)
    assert deep[0, 0] > 4 * deep[0, 1]
