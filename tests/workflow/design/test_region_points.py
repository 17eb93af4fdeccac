"""Boxes about chosen points, and what is told of regions."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.regions import Box
from defsense_fab.workflow.design.region_points import (
    find_region_problems,
    fit_box,
    points_in_regions,
)

LINE = np.stack([np.arange(0.0, 11.0), np.zeros(11), np.zeros(11)], axis=1)


def region(low, high):
    return Box(np.array([low, -1.0, -1.0]), np.array([high, 1.0, 1.0]))


def test_a_fitted_box_holds_the_points_and_has_round_corners():
    points = np.array([[140.02, -15, -15], [150, 15, 15.0]])
    box = fit_box(points, 150.0)
    assert box.low.tolist() == [139.0, -16.0, -16.0]
    assert box.high.tolist() == [151.0, 16.0, 16.0]
    assert box.contains(points).all()
    small = fit_box(points / 100, 1.5)
    assert small.low.tolist() == [1.39, -0.16, -0.16]
    flat = fit_box(np.zeros((1, 3)), 150.0)
    assert (flat.low < flat.high).all()
    with pytest.raises(ValueError):  # not a user's error: it has no code
        fit_box(np.zeros((0, 3)), 150.0)


def test_empty_and_overlapping_regions_are_found():
    def found(**regions):
        problems = find_region_problems(points_in_regions(regions, LINE))
        return {name: [(p.code, p.regions, p.count) for p in ps] for name, ps in problems.items()}

    assert found(base=region(-1, 3), tip=region(7, 11)) == {}
    assert found(base=region(-1, 3), tip=region(20, 21)) == {
        "tip": [("region-without-points", ("tip",), 0)]
    }
    assert found(tip=region(8.5, 9.5)) == {"tip": [("region-too-few-points", ("tip",), 1)]}
    shared = ("regions-share-points", ("base", "tip"), 3)
    assert found(base=region(-1, 5), tip=region(3, 11)) == {"base": [shared], "tip": [shared]}
