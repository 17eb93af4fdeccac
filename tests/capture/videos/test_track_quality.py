"""The size of tags as cameras measure it."""

import numpy as np
import pytest

from defsense_fab.capture.videos.tag_size import measured_size


def sides(true, tags, frames=200, noise=0.05, apart=0.0, seed=0):
    rng = np.random.default_rng(seed)
    out = true + apart * rng.normal(size=tags) + noise * rng.normal(size=(frames, tags))
    out[rng.random(out.shape) < 0.3] = np.nan
    return out


@pytest.mark.parametrize("tags", [1, 2, 12])
def test_one_per_cent_is_what_counts(tags):
    for true, told in ((14.55, True), (15.4, True), (15.0, False), (14.9, False)):
        found = measured_size(sides(true, tags), 15.0)
        assert found.side == pytest.approx(true, abs=0.02)
        assert (found.warning is not None) == told
    assert "printed at 97.0%" in measured_size(sides(14.55, tags), 15.0).warning
    assert "3.1% too far" in measured_size(sides(14.55, tags), 15.0).warning


def test_the_standard_deviation_is_that_of_the_median():
    found = [measured_size(sides(15.0, 12, apart=0.1, seed=k), 15.0) for k in range(100)]
    scatter = np.std([f.side for f in found])
    assert np.mean([f.sigma for f in found]) == pytest.approx(scatter, rel=0.35)


def test_what_is_not_sure_is_not_told():
    assert measured_size(sides(14.7, 4, apart=1.0), 15.0).warning is None
    assert measured_size(np.full((50, 3), np.nan), 15.0) is None
    assert measured_size(np.full((2, 3), 15.0), 15.0) is None
