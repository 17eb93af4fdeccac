"""Tags by one camera: what it says, and how sure it is of that."""

import numpy as np
import pytest

from defsense_fab.capture.tracking.reconstruction import locate_single, tag_corners
from tests.capture.rigs import flat, rig, spread, tags
from tests.twin.views import turn

SIZE = 15.0


def trial(X, sigma, seed, **more):
    view = rig(1)[0]
    seen = flat(view, X)
    seen = seen + np.random.default_rng(seed).normal(0, sigma, seen.shape)
    found = locate_single(view, seen, spread((len(X),), sigma), SIZE, **more)
    error = (found.points - X.mean(axis=1)) @ view.rotation.T
    return found, error, view.rotation @ found.covariance @ view.rotation.T


def test_a_tag_without_noise_is_located_exactly():
    X = tags(30, np.random.default_rng(0), SIZE, 0.8)
    found, error, _ = trial(X, 1e-6, 0)
    assert np.abs(error).max() < 1e-3
    assert np.abs(found.corners - X).max() < 0.05
    assert found.miss.max() < 1e-4


@pytest.mark.parametrize("tilt", [0.0, 0.5, 0.9])
def test_the_covariance_matches_many_trials(tilt):
    view = rig(1)[0]
    axes = view.rotation.T @ np.diag([1, -1, -1.0]) @ turn(tilt)
    X = np.repeat((tag_corners(SIZE) @ axes.T)[None], 600, axis=0)
    found, error, covariance = trial(X, 0.04, 1)
    assert found.used.all()
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = np.sqrt(((error / sigma) ** 2).mean(axis=0))
    assert (ratio > 0.65).all()
    assert (ratio < 1.3).all()


def test_errors_at_all_tilts_match_the_stated_covariance():
    X = tags(600, np.random.default_rng(2), SIZE, 0.9)
    _, error, covariance = trial(X, 0.05, 2)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = np.sqrt(((error / sigma) ** 2).mean(axis=0))
    assert (ratio > 0.7).all()
    assert (ratio < 1.3).all()
    assert sigma[:, 2].mean() > 5 * sigma[:, :2].mean()


def test_the_size_uncertainty_is_part_of_the_covariance():
    X = tags(4, np.random.default_rng(3), SIZE)
    plain, _, _ = trial(X, 0.05, 3)
    loose, _, _ = trial(X, 0.05, 3, size_sigma=0.01)
    ray = plain.points - rig(1)[0].center
    extra = loose.covariance - plain.covariance
    assert np.allclose(extra, 1e-4 * ray[:, :, None] * ray[:, None], rtol=1e-9, atol=1e-12)


def test_only_squares_are_located():
    view = rig(1)[0]
    seen = flat(view, tags(3, np.random.default_rng(4), SIZE))
    seen[0, 2] += 25.0
    seen[1] = np.nan
    covariance = spread((3,), 0.05)
    found = locate_single(view, seen, covariance, SIZE)
    assert np.isnan(found.points[:2]).all()
    assert np.isnan(found.covariance[:2]).all()
    assert found.used[:, 0].tolist() == [False, False, True]
    assert np.isfinite(found.points[2]).all()
