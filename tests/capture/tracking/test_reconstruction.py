"""Tags are located by several cameras or by one, with covariances that match the errors."""

import numpy as np
import pytest

from defsense_fab.capture.tracking.reconstruction import (
    locate_single,
    reconstruct,
    tag_corners,
    triangulate,
)
from tests.capture.rigs import flat, rig, spread, tags
from tests.twin.views import turn


@pytest.mark.parametrize("count", [2, 3])
def test_tags_without_noise_are_located_exactly(count):
    cameras, X = rig(count), tags(20, np.random.default_rng(0))
    pixels = np.stack([flat(c, X) for c in cameras], axis=1)
    result = triangulate(cameras, pixels, spread(pixels.shape[:2], 0.05))
    assert np.allclose(result.corners, X, atol=1e-8)
    assert np.allclose(result.points, X.mean(axis=1), atol=1e-8)
    assert result.used.all()
    assert result.miss.max() < 1e-8


def test_covariance_by_several_cameras_matches_many_trials():
    rng, sigma = np.random.default_rng(1), 0.05
    cameras, X = rig(3), np.repeat(tags(1, np.random.default_rng(3)), 1500, axis=0)
    pixels = np.stack([flat(c, X) for c in cameras], axis=1)
    # One camera is three times worse, as its covariance states.
    scale = np.array([1, 1, 3.0])[:, None, None]
    result = triangulate(
        cameras, pixels + rng.normal(0, sigma, pixels.shape) * scale,
        spread(pixels.shape[:2], sigma) * scale[..., None] ** 2,
    )  # fmt: skip
    error = result.points - X.mean(axis=1)
    assert np.abs(error.mean(axis=0) / error.std(axis=0)).max() < 0.1
    ratio = np.linalg.solve(result.covariance.mean(axis=0), np.cov(error.T))
    assert np.abs(np.linalg.eigvals(ratio) - 1).max() < 0.25


def test_disagreeing_camera_is_left_out_of_three_and_two_locate_nothing():
    X = tags(5, np.random.default_rng(2))
    for wrong in range(3):
        cameras = rig(3)
        pixels = np.stack([flat(c, X) for c in cameras], axis=1)
        pixels[1, wrong] += 30.0
        result = triangulate(cameras, pixels, spread(pixels.shape[:2], 0.05))
        assert np.allclose(result.points, X.mean(axis=1), atol=1e-6)
        assert result.used[1].tolist() == [k != wrong for k in range(3)]
        assert result.used[[0, 2, 3, 4]].all()
    two = triangulate(
        cameras[:2], pixels[:, :2] + np.array([[[0]], [[25.0]]]), spread((5, 2), 0.05)
    )
    assert np.isnan(two.points).all()
    assert np.isnan(two.covariance).all()
    assert not two.used.any()


def test_points_behind_a_camera_are_not_located():
    cameras, X = rig(2), tags(1, np.random.default_rng(2))
    eye = np.mean([c.center for c in cameras], axis=0)
    behind = 2 * eye - X  # where the extended rays meet
    pixels = np.stack([flat(c, behind) for c in cameras], axis=1)
    result = triangulate(cameras, pixels, spread((1, 2), 0.05))
    assert np.isnan(result.points).all()


def test_tags_are_located_by_several_cameras_one_or_none():
    rng = np.random.default_rng(4)
    cameras, X = rig(2), tags(6, rng).reshape(2, 3, 4, 3)
    pixels = np.stack([flat(c, X) for c in cameras], axis=2)
    pixels[0, 0, 1], pixels[1, 2] = np.nan, np.nan
    covariance = spread(pixels.shape[:3], 0.05)
    covariance[~np.isfinite(pixels[..., 0, 0])] = np.nan
    result = reconstruct(cameras, pixels, covariance, 15.0)
    assert result.views.tolist() == [[1, 2, 2], [2, 2, 0]]
    assert result.cameras.tolist() == [[1, 2, 2], [2, 2, 0]]
    there = result.views > 0
    assert np.allclose(result.points[there], X.mean(axis=2)[there], atol=1e-4)
    assert np.isnan(result.points[1, 2]).all()
    assert np.allclose(result.sides[result.views == 2], 15.0, atol=1e-6)
    deep = np.trace(result.covariance, axis1=-2, axis2=-1)
    assert deep[0, 0] > 4 * deep[0, 1]


SIZE = 15.0


def trial(X, sigma, seed):
    """Locate tags (n, 4, 3) by one camera; return them, errors, and covariances in its axes."""
    view = rig(1)[0]
    pixels = flat(view, X)
    pixels = pixels + np.random.default_rng(seed).normal(0, sigma, pixels.shape)
    result = locate_single(view, pixels, spread((len(X),), sigma), SIZE)
    error = (result.points - X.mean(axis=1)) @ view.rotation.T
    return result, error, view.rotation @ result.covariance @ view.rotation.T


def test_tag_of_one_camera_is_located_exactly_without_noise():
    X = tags(30, np.random.default_rng(0), SIZE, 0.8)
    result, error, _ = trial(X, 1e-6, 0)
    assert np.abs(error).max() < 1e-3
    assert np.abs(result.corners - X).max() < 0.05
    assert result.miss.max() < 1e-4


@pytest.mark.parametrize("tilt", [0.0, 0.5, 0.9])
def test_covariance_by_one_camera_matches_many_trials(tilt):
    view = rig(1)[0]
    axes = view.rotation.T @ np.diag([1, -1, -1.0]) @ turn(tilt)
    X = np.repeat((tag_corners(SIZE) @ axes.T)[None], 600, axis=0)
    result, error, covariance = trial(X, 0.04, 1)
    assert result.used.all()
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = np.sqrt(((error / sigma) ** 2).mean(axis=0))
    assert (ratio > 0.65).all()
    assert (ratio < 1.3).all()


def test_errors_by_one_camera_match_the_covariance_at_all_tilts():
    X = tags(600, np.random.default_rng(2), SIZE, 0.9)
    _, error, covariance = trial(X, 0.05, 2)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = np.sqrt(((error / sigma) ** 2).mean(axis=0))
    assert (ratio > 0.7).all()
    assert (ratio < 1.3).all()
    assert sigma[:, 2].mean() > 5 * sigma[:, :2].mean()


def test_only_squares_are_located_by_one_camera():
    view = rig(1)[0]
    pixels = flat(view, tags(3, np.random.default_rng(4), SIZE))
    pixels[0, 2] += 25.0
    pixels[1] = np.nan
    covariance = spread((3,), 0.05)
    result = locate_single(view, pixels, covariance, SIZE)
    assert np.isnan(result.points[:2]).all()
    assert np.isnan(result.covariance[:2]).all()
    assert result.used[:, 0].tolist() == [False, False, True]
    assert np.isfinite(result.points[2]).all()
