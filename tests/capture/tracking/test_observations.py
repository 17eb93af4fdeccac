"""Tags of a camera: storage in a temporary file, repeated numbers, and positions between frames."""

import numpy as np
import pytest

from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking import observations
from defsense_fab.capture.tracking.observations import (
    frame_blocks,
    interpolate,
    observe,
    store_views,
)
from tests.capture.rigs import collect, spread


def view(*tags):
    """Return a view of tags by number at x (px)."""
    corners = np.array([[[x, 0.0], [x + 9, 0], [x + 9, 9], [x, 9]] for _, x in tags])
    corners = corners.reshape(-1, 4, 2)
    ids = np.array([number for number, _ in tags], int)
    return TagView(ids, corners, spread((len(tags),), 0.1), corners)


def random_views(frames, rng):
    """Return views of up to five tags, some of which are repeated or empty."""
    views = []
    for _ in range(frames):
        n = int(rng.integers(0, 6))
        root = rng.normal(size=(n, 5, 2, 2))
        corners = rng.uniform(0, 1000, (n, 4, 2))
        views.append(TagView(rng.integers(0, 8, n), corners, root @ root.swapaxes(2, 3), corners))
    return views


@pytest.mark.parametrize("memory_bytes", [0, 10**9])
def test_stored_tags_are_read_in_any_order(monkeypatch, memory_bytes):
    monkeypatch.setattr(observations, "MAX_MEMORY_BYTES", memory_bytes)
    rng = np.random.default_rng(0)
    views = random_views(200, rng)
    tags = store_views(views)
    assert tags.count.tolist() == [len(v.ids) for v in views]
    frames = rng.permutation(200)[:60]
    indices, position = tags.find(frames)
    rows = tags.store.read(indices)
    for k, frame in enumerate(frames):
        frame_rows, expected = rows[position == k], views[frame]
        np.testing.assert_array_equal(frame_rows["id"], expected.ids)
        np.testing.assert_array_equal(frame_rows["corners"], expected.corners)
        np.testing.assert_allclose(
            frame_rows["covariance"], expected.covariance, rtol=1e-6, atol=1e-6
        )
    numbers, repeated = tags.survey()
    assert numbers.tolist() == sorted({int(i) for v in views for i in v.ids})
    expected_repeated = {int(i) for v in views for i in v.ids if (v.ids == i).sum() > 1}
    assert repeated.tolist() == sorted(expected_repeated)
    hidden = np.arange(200) % 2 == 0
    assert not tags.without(hidden).count[hidden].any()
    assert (tags.only(~hidden).count == tags.count[~hidden]).all()


def test_size_of_the_blocks_does_not_change_observations(monkeypatch):
    rng = np.random.default_rng(1)
    views, time, ids = random_views(300, rng), np.arange(300) / 30, np.array([5, 0, 3])
    whole = collect(time, views, ids)
    assert 0.2 < np.isfinite(whole.corners[..., 0, 0]).mean() < 0.6
    times = rng.uniform(-0.1, 10.1, 500)
    expected = interpolate(observe(time, store_views(views), ids), times, 0.004)
    monkeypatch.setattr(observations, "BLOCK_TAGS", 40)
    observed = observe(time, store_views(views), ids)
    frames = np.arange(300)
    for selected in (frames, frames[::-7], np.array([4, 4, 80]), frames[:0]):
        part = observed.part(selected)
        np.testing.assert_array_equal(part.corners, whole.corners[selected])
        np.testing.assert_array_equal(part.covariance, whole.covariance[selected])
    for one, other in zip(interpolate(observed, times, 0.004), expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_blocks_contain_each_frame_once():
    for frames, tags in ((0, 5), (1, 0), (5000, 20), (50_000, 1), (3, 10**6)):
        parts = list(frame_blocks(frames, tags))
        assert np.concatenate([np.zeros(0, int), *parts]).tolist() == list(range(frames))
        assert max((len(p) * tags for p in parts), default=0) <= max(20_000, tags)


def test_nearer_of_two_equal_numbers_is_chosen():
    views = [
        view((3, 300.0), (3, 10.0)),
        view((3, 12.0), (8, 50.0)),
        view((3, 290.0), (3, 14.0)),
        view(),
        view((3, 15.0), (99, 1.0)),
    ]
    chosen = collect(np.arange(5) / 30, views, np.array([3, 8]))
    assert chosen.corners[:, 0, 0, 0] == pytest.approx([np.nan, 12, 14, np.nan, 15], nan_ok=True)
    assert np.isnan(chosen.corners[[0, 2, 3, 4], 1]).all()
    assert np.isnan(chosen.covariance[3]).all()


def test_corners_are_interpolated_between_frames():
    time, ids = np.array([0, 0.1, 0.2, 0.3, 0.7, 0.8]), np.array([5])
    corners = np.zeros((6, 1, 4, 2)) + (10 * time)[:, None, None, None]
    variance = spread((1,), 1.0)
    views = [TagView(ids, c, variance, c) for c in corners]
    views[2] = view()
    times = np.array([-0.05, 0.0, 0.025, 0.1004, 0.15, 0.25, 0.3, 0.5, 0.75, 0.9])
    result, covariance = interpolate(observe(time, store_views(views), ids), times)
    expected = [np.nan, 0, 0.25, 1.0, np.nan, np.nan, 3, np.nan, 7.5, np.nan]
    assert result[:, 0, 0, 0] == pytest.approx(expected, nan_ok=True)
    assert covariance[2, 0, 0, 0, 0] == pytest.approx(0.75**2 + 0.25**2)
    for count in (0, 1):
        first_frames = observe(time[:count], store_views(views[:count]), ids)
        assert np.isfinite(interpolate(first_frames, times)[0]).sum() == count * 8
