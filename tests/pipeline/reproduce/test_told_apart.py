"""Poses counted by which is shown and which is found."""

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.pipeline.reproduce.told_apart import ToldApart, count_poses, told_apart
from tests.runtime.bars import POSES, markers, poses


def test_poses_are_counted_where_one_is_shown_and_taken_for_what_their_shape_is():
    rng = np.random.default_rng(3)
    basis = poses(markers(30, rng))
    shown = [(POSES[k], a) for k in range(6) for a in (0.6, 1.0)]
    weights = np.array([a * np.eye(6)[POSES.index(name)] for name, a in shown])
    mixed, faint = 0.7 * (np.eye(6)[0] + np.eye(6)[2]), 0.4 * np.eye(6)[3]
    weights = np.vstack([weights, mixed, faint])
    moved = np.array([basis.displacements(w) for w in weights])
    moved += rng.normal(0, 0.5, moved.shape)
    radius = np.full(moved.shape[:2], 1.0)

    names = ("grip", *POSES[::-1])  # the twin's order is another, and it knows more
    truth = np.column_stack([np.zeros(len(weights)), weights[:, ::-1]])
    found = count_poses(basis, moved, radius, names, truth, 6)
    assert np.array_equal(found.counts, 2 * np.eye(6, dtype=int))
    assert found.share == 1.0

    # A pull that is read as what a twist does counts as a twist that was found.
    moved[10:12] = moved[4:6]
    wrong = count_poses(basis, moved, radius, names, truth, 6)
    assert wrong.counts[5, 2] == 2
    assert wrong.share == pytest.approx(10 / 12)


def test_nothing_shown_is_no_share_and_recordings_do_not_know_their_poses(tmp_path):
    assert np.isnan(ToldApart(("a", "b"), np.zeros((2, 2), np.int64)).share)
    with pytest.raises(LiveError, match="counts of 2 poses"):
        ToldApart(("a", "b"), np.zeros((2, 3), np.int64))
    with pytest.raises(LiveError, match=r"has no truth\.npz; only a twin's sessions"):
        told_apart(tmp_path / "model.json", tmp_path, tmp_path)
