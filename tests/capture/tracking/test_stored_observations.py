"""Tags in a temporary file: what was added is what is read, in any order."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking import observations
from defsense_fab.capture.tracking.observations import (
    Observations,
    frame_blocks,
    interpolate,
    observe,
    store_views,
)
from tests.capture.rigs import collect


def views(frames, rng):
    """Frames of up to five tags, of which some are there twice, and some frames show nothing."""
    out = []
    for _ in range(frames):
        n = int(rng.integers(0, 6))
        root = rng.normal(size=(n, 5, 2, 2))
        corners = rng.uniform(0, 1000, (n, 4, 2))
        out.append(TagView(rng.integers(0, 8, n), corners, root @ root.swapaxes(2, 3), corners))
    return out


@pytest.mark.parametrize("in_memory", [0, 10**9])
def test_stored_tags_are_read_in_any_order(tmp_path, monkeypatch, in_memory):
    monkeypatch.setattr(observations, "MAX_MEMORY_BYTES", in_memory)
    rng = np.random.default_rng(0)
    shown = views(200, rng)
    tags = store_views(shown, tmp_path)
    assert tags.count.tolist() == [len(v.ids) for v in shown]
    frames = rng.permutation(200)[:60]
    which, position = tags.find(frames)
    rows = tags.store.read(which)
    for k, frame in enumerate(frames):
        mine, view = rows[position == k], shown[frame]
        np.testing.assert_array_equal(mine["id"], view.ids)
        np.testing.assert_array_equal(mine["corners"], view.corners)
        np.testing.assert_allclose(mine["covariance"], view.covariance, rtol=1e-6, atol=1e-6)
    numbers, twice = tags.survey()
    assert numbers.tolist() == sorted({int(i) for v in shown for i in v.ids})
    again = {int(i) for v in shown for i in v.ids if (v.ids == i).sum() > 1}
    assert twice.tolist() == sorted(again)
    hidden = np.arange(200) % 2 == 0
    assert not tags.without(hidden).count[hidden].any()
    assert (tags.only(~hidden).count == tags.count[~hidden]).all()
    assert not list(tmp_path.iterdir()) or in_memory == 0


def test_parts_equal_the_whole(monkeypatch):
    """Also where what is read at once begins and ends between frames that show a tag twice."""
    rng = np.random.default_rng(1)
    shown, time, ids = views(300, rng), np.arange(300) / 30, np.array([5, 0, 3])
    whole = collect(time, shown, ids)
    assert 0.2 < np.isfinite(whole.corners[..., 0, 0]).mean() < 0.6
    monkeypatch.setattr(observations, "BLOCK_TAGS", 40)
    seen = observe(time, store_views(shown), ids)
    frames = np.arange(300)
    for part in (frames, frames[::-7], np.array([4, 4, 80]), frames[:0]):
        found = seen.part(part)
        assert isinstance(found, Observations)
        np.testing.assert_array_equal(found.corners, whole.corners[part])
        np.testing.assert_array_equal(found.covariance, whole.covariance[part])
    asked = rng.uniform(-0.1, 10.1, 500)
    for one, other in zip(
        interpolate(seen, asked, 0.004), interpolate(whole, asked, 0.004), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_blocks_contain_each_frame_once():
    for frames, tags in ((0, 5), (1, 0), (5000, 20), (50_000, 1), (3, 10**6)):
        parts = list(frame_blocks(frames, tags))
        assert np.concatenate([np.zeros(0, int), *parts]).tolist() == list(range(frames))
        assert max((len(p) * tags for p in parts), default=0) <= max(20_000, tags)
