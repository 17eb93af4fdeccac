"""What cameras hardly know is left out, by what they say themselves."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.data.uncertain_places import without_uncertain
from tests.training.synthetic import dataset, recording


def test_places_far_less_certain_than_usual_are_left_out_and_no_others():
    data = dataset(recording(1))
    r = data.recordings[0]
    sigma = np.full(r.points.shape, 0.1)
    sigma[10, 0], sigma[20, 1], sigma[30, 0] = 2.0, 0.5, np.nan
    points = np.where(np.isfinite(r.points), r.points, 0.0)
    r = replace(r, points=points, sigma=sigma)
    found, share = without_uncertain(replace(data, recordings=(r,)))
    gone = r.seen & ~found.recordings[0].seen
    assert np.argwhere(gone).tolist() == [[10, 0]]  # 0.5 mm is five times as uncertain, and known
    assert share == pytest.approx(1 / r.seen.sum())
    assert np.array_equal(found.recordings[0].points[~gone], r.points[~gone], equal_nan=True)


def test_cameras_that_are_poor_throughout_lose_nothing():
    data = dataset(recording(1))
    r = replace(data.recordings[0], sigma=np.full(data.recordings[0].points.shape, 2.0))
    found, share = without_uncertain(replace(data, recordings=(r,)))
    assert share == 0.0
    assert np.array_equal(found.recordings[0].seen, r.seen)
    unknown = replace(r, sigma=np.full(r.points.shape, np.nan))
    assert without_uncertain(replace(data, recordings=(unknown,)))[1] == 0.0
