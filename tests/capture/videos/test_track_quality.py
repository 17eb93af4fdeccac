"""The measured size of tags."""

import numpy as np
import pytest

from defsense_fab.capture.videos.track_quality import measure_size


def sides(true, tags, frames=200, noise=0.05, apart=0.0, seed=0):
    rng = np.random.default_rng(seed)
    out = true + apart * rng.normal(size=tags) + noise * rng.normal(size=(frames, tags))
    out[rng.random(out.shape) < 0.3] = np.nan
    return out


@pytest.mark.parametrize("tags", [1, 2, 12])
def test_a_size_that_differs_by_one_per_cent_is_reported(tags):
    for true, is_warned in ((14.55, True), (15.4, True), (15.0, False), (14.9, False)):
        result = measure_size(sides(true, tags), 15.0)
        assert result.side == pytest.approx(true, abs=0.02)
        assert (result.warning is not None) == is_warned
    warning = measure_size(sides(14.55, tags), 15.0).warning
    assert warning.code == "tag-size-wrong"
    assert "97.0%" in warning
    assert "3.1%" in warning


def test_the_standard_deviation_matches_the_scatter_of_the_median():
    result = [measure_size(sides(15.0, 12, apart=0.1, seed=k), 15.0) for k in range(100)]
    scatter = np.std([f.side for f in result])
    assert np.mean([f.sigma for f in result]) == pytest.approx(scatter, rel=0.35)


def test_an_uncertain_size_is_not_reported():
    assert measure_size(sides(14.7, 4, apart=1.0), 15.0).warning is None
    assert measure_size(np.full((50, 3), np.nan), 15.0) is None
    assert measure_size(np.full((2, 3), 15.0), 15.0) is None
