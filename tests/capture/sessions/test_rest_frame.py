"""Which markers lay a session's frames onto the rest pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.capture.sessions.rest_frame import align_with_rest
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Tracks
from tests.capture.sessions import capture_rig as rig

FRAMES, NOISE = 200, 0.02
NONE = np.full((FRAMES, 4, 4, 3), np.nan, np.float32)


SHIFT = np.array([5, -3, 700])


def turns(time):
    return Rotation.from_rotvec(0.2 * np.sin(np.outer(time, [1.0, 0.7, 0.5])))


def corners(seen):
    """Of the anchor's tags (t, 4, 4, 3), where `seen` (t, 4)."""
    true = rig.markers().corners[:4].reshape(-1, 3)
    shown = np.stack([r.apply(true) for r in turns(np.arange(FRAMES) / 30)]) + SHIFT
    shown += np.random.default_rng(4).normal(scale=2 * NOISE, size=shown.shape)
    out = shown.reshape(FRAMES, 4, 4, 3).astype(np.float32)
    out[~seen] = np.nan
    return out


def tracks(hidden):
    """Tags in hands: the last two go out by up to 12 mm; `hidden` (t, m) are not seen."""
    rng = np.random.default_rng(3)
    time = np.arange(FRAMES) / 30
    true = np.array([rig.places(t) if t > 2 else rig.CENTERS for t in time])
    shown = np.stack([r.apply(p) for r, p in zip(turns(time), true, strict=True)])
    shown = shown + SHIFT
    points = shown + rng.normal(scale=NOISE, size=shown.shape)
    points[hidden] = np.nan
    sigma = np.where(np.isfinite(points), NOISE, np.nan)
    return Tracks(time, np.arange(6), points, sigma, np.arange(FRAMES)), true, time < 2


def errors(laid, true):
    return np.linalg.norm(laid.aligned.points - true, axis=2)


def test_only_frames_without_the_anchor_are_aligned_by_all_markers():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[FRAMES // 2 :, :2] = True  # two of four anchors: they do not tell a rotation
    seen, true, resting = tracks(hidden)
    laid = align_with_rest(rig.markers(), seen, NONE, resting, "auto")
    off, half = errors(laid, true), FRAMES // 2
    assert laid.by == "anchor"
    assert np.nanmax(off[:half]) < 0.15
    assert laid.by_all == pytest.approx(0.5)
    assert laid.aligned.ok.all()
    # The tags that go out pull the others along, by about what is told.
    assert 0.5 < np.sqrt(np.nanmean(off[half:] ** 2)) / laid.off < 2
    assert (laid.aligned.sigma[half:, 2:] > laid.off / 2).all()
    (told,) = laid.warnings
    assert "50% are aligned by all markers" in told
    strict = align_with_rest(rig.markers(), seen, NONE, resting, "anchor")
    assert not strict.aligned.ok[half:].any()
    assert strict.warnings == []


@pytest.mark.parametrize(("left", "bound"), [(2, 0.3), (1, 1.5)])
def test_corners_of_one_tag_of_the_anchor_are_enough(left, bound):
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[FRAMES // 2 :, : 4 - left] = True
    seen, true, resting = tracks(hidden)
    laid = align_with_rest(rig.markers(), seen, corners(~hidden[:, :4]), resting, "auto")
    off, half = errors(laid, true), FRAMES // 2
    assert (laid.by, laid.by_all, laid.warnings) == ("anchor", 0.0, [])
    assert np.nanmax(off[:half]) < 0.15
    assert np.nanmax(off[half:]) < bound  # 50 mm from the anchor, corners of 15 mm
    within = np.abs(laid.aligned.points - true) <= 2 * laid.aligned.sigma
    assert 0.85 < within[half:, 4:].mean() < 0.999


def test_anchor_tags_not_seen_at_rest_count_by_their_centers():
    hidden = np.zeros((FRAMES, 6), bool)
    seen, true, resting = tracks(hidden)
    of = corners(np.ones((FRAMES, 4), bool))
    of[resting, 1:] = np.nan
    laid = align_with_rest(rig.markers(), seen, of, resting, "auto")
    assert laid.by == "anchor"
    assert np.nanmax(errors(laid, true)) < 0.15


def test_a_rarely_visible_anchor_is_not_used():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[5:, :2] = True
    seen, _, resting = tracks(hidden)
    laid = align_with_rest(rig.markers(), seen, NONE, resting, "auto")
    assert laid.by == "all"
    assert len(laid.warnings) == 1
    hidden[:, :2] = True
    with pytest.raises(CaptureError):
        align_with_rest(rig.markers(), tracks(hidden)[0], NONE, np.zeros(FRAMES, bool), "anchor")
