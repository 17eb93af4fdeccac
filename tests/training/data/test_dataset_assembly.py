"""Joining datasets, and leaving out uncertain positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset_assembly import (
    exclude_uncertain_positions,
    join_datasets,
    select_channels,
)

from ...support.errors import raises
from ..synthetic import CHANNELS, IDS, REST, dataset, recording

# What cameras hardly know is left out, by what they say themselves.


def test_only_unusually_uncertain_positions_are_left_out():
    data = dataset(recording(1))
    r = data.recordings[0]
    sigma = np.full(r.points.shape, 0.1)
    sigma[10, 0], sigma[20, 1], sigma[30, 0] = 2.0, 0.5, np.nan
    points = np.where(np.isfinite(r.points), r.points, 0.0)
    r = replace(r, points=points, sigma=sigma)
    result, share = exclude_uncertain_positions(replace(data, recordings=(r,)))
    gone = r.visible & ~result.recordings[0].visible
    assert np.argwhere(gone).tolist() == [[10, 0]]  # 0.5 mm is below the limit
    assert share == pytest.approx(1 / r.visible.sum())
    assert np.array_equal(result.recordings[0].points[~gone], r.points[~gone], equal_nan=True)


def test_uniformly_uncertain_positions_are_kept():
    data = dataset(recording(1))
    r = replace(data.recordings[0], sigma=np.full(data.recordings[0].points.shape, 2.0))
    result, share = exclude_uncertain_positions(replace(data, recordings=(r,)))
    assert share == 0.0
    assert np.array_equal(result.recordings[0].visible, r.visible)
    unknown = replace(r, sigma=np.full(r.points.shape, np.nan))
    assert exclude_uncertain_positions(replace(data, recordings=(unknown,)))[1] == 0.0


def permuted(part, order):
    recordings = tuple(replace(r, ohm=r.ohm[:, order], rest=r.rest[order]) for r in part.recordings)
    return replace(part, channels=tuple(part.channels[k] for k in order), recordings=recordings)


def test_channels_are_matched_by_name_and_markers_by_number():
    a = dataset(recording(1))
    fewer = [2, 0, 3, 1]
    r = recording(2)
    b = dataset(
        replace(r, points=r.points[:, fewer], sigma=r.sigma[:, fewer]),
        ids=IDS[fewer],
        rest_points=REST[fewer],
        provenance={"sessions": [{"folder": "b"}]},
    )
    both = join_datasets([a, permuted(b, [2, 0, 1])])
    assert both.channels == CHANNELS
    assert both.ids.tolist() == IDS.tolist()
    np.testing.assert_array_equal(both.recordings[1].ohm, r.ohm)
    np.testing.assert_array_equal(both.recordings[1].rest, r.rest)
    np.testing.assert_array_equal(both.recordings[1].points[:, :4], r.points[:, :4])
    assert np.isnan(both.recordings[1].points[:, 4]).all()
    np.testing.assert_array_equal(both.rest_points, REST)
    assert both.provenance["sessions"] == [{"folder": "b"}]
    turned = join_datasets([b, a])
    assert turned.ids.tolist() == sorted(IDS.tolist())
    np.testing.assert_array_equal(turned.rest_points[turned.ids == 8], REST[4:])
    np.testing.assert_array_equal(
        select_channels(both, CHANNELS[::-1]).recordings[0].ohm[:, 2], both.recordings[0].ohm[:, 0]
    )


@pytest.mark.parametrize(
    ("other", "code", "data"),
    [
        ({"device": "bun"}, "devices-differ", {"devices": ("bar", "bun")}),
        ({"layout": "other"}, "layouts-differ", {"layouts": ("abc", "other")}),
        (
            {"channels": ("left", "middle", "top")},
            "channels-differ",
            {"missing": ("right",), "extra": ("top",)},
        ),
        (
            {"rest_points": REST + np.array([0, 0, 4])},
            "markers-moved",
            {"marker": 1, "distance_mm": 4.0},
        ),
    ],
)
def test_datasets_that_do_not_match_are_refused(other, code, data):
    with raises(TrainingError, code, **data):
        join_datasets([dataset(recording(1)), dataset(recording(2), **other)])


def test_extra_channels_and_empty_lists_are_refused():
    a = dataset(recording(1))
    more = replace(
        a,
        channels=(*CHANNELS, "spare"),
        recordings=tuple(
            replace(r, ohm=np.hstack([r.ohm, r.ohm[:, :1]]), rest=np.append(r.rest, 1.0))
            for r in a.recordings
        ),
    )
    with raises(TrainingError, "channels-differ", missing=(), extra=("spare",)):
        join_datasets([a, more])
    with raises(TrainingError, "no-data"):
        join_datasets([])
    # An unknown layout matches any other.
    assert join_datasets([dataset(recording(1), layout=""), a]).layout == "abc"
