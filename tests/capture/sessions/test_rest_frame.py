"""Frames of a session are aligned with the rest pose by the anchor's tags, or by all."""

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


def corners(is_visible):
    """Return the corners of the anchor's tags (t, 4, 4, 3), mm, where visible (t, 4)."""
    true = rig.markers().corners[:4].reshape(-1, 3)
    shown = np.stack([r.apply(true) for r in turns(np.arange(FRAMES) / 30)]) + SHIFT
    shown += np.random.default_rng(4).normal(scale=2 * NOISE, size=shown.shape)
    out = shown.reshape(FRAMES, 4, 4, 3).astype(np.float32)
    out[~is_visible] = np.nan
    return out


def tracks(hidden):
    """Return tracks of tags of which the last two move by up to 12 mm, without `hidden` (t, m).

    Also return the true positions (t, m, 3), mm, and the frames at rest (t,).
    """
    rng = np.random.default_rng(3)
    time = np.arange(FRAMES) / 30
    true = np.array([rig.marker_positions(t) if t > 2 else rig.CENTERS for t in time])
    shown = np.stack([r.apply(p) for r, p in zip(turns(time), true, strict=True)])
    shown = shown + SHIFT
    points = shown + rng.normal(scale=NOISE, size=shown.shape)
    points[hidden] = np.nan
    sigma = np.where(np.isfinite(points), NOISE, np.nan)
    return Tracks(time, np.arange(6), points, sigma, np.arange(FRAMES)), true, time < 2


def errors(alignment, true):
    return np.linalg.norm(alignment.aligned.points - true, axis=2)


def test_only_frames_without_the_anchor_are_aligned_by_all_markers():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[FRAMES // 2 :, :2] = True  # two of four anchors do not determine a rotation
    session_tracks, true, resting = tracks(hidden)
    alignment = align_with_rest(rig.markers(), session_tracks, NONE, resting, "auto")
    error, half = errors(alignment, true), FRAMES // 2
    assert alignment.by == "anchor"
    assert np.nanmax(error[:half]) < 0.15
    assert alignment.by_all == pytest.approx(0.5)
    assert alignment.aligned.ok.all()
    # The tags that move displace the others, by about as much as is reported.
    assert 0.5 < np.sqrt(np.nanmean(error[half:] ** 2)) / alignment.off < 2
    assert (alignment.aligned.sigma[half:, 2:] > alignment.off / 2).all()
    (warning,) = alignment.warnings
    assert "50% are aligned by all markers" in warning
    strict = align_with_rest(rig.markers(), session_tracks, NONE, resting, "anchor")
    assert not strict.aligned.ok[half:].any()
    assert strict.warnings == []


@pytest.mark.parametrize(("count", "bound"), [(2, 0.3), (1, 1.5)])
def test_corners_of_one_tag_of_the_anchor_are_enough(count, bound):
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[FRAMES // 2 :, : 4 - count] = True
    session_tracks, true, resting = tracks(hidden)
    alignment = align_with_rest(
        rig.markers(), session_tracks, corners(~hidden[:, :4]), resting, "auto"
    )
    error, half = errors(alignment, true), FRAMES // 2
    assert (alignment.by, alignment.by_all, alignment.warnings) == ("anchor", 0.0, [])
    assert np.nanmax(error[:half]) < 0.15
    assert np.nanmax(error[half:]) < bound  # 50 mm from the anchor, corners of 15 mm
    within = np.abs(alignment.aligned.points - true) <= 2 * alignment.aligned.sigma
    assert 0.85 < within[half:, 4:].mean() < 0.999


def test_anchor_tags_not_seen_at_rest_count_by_their_centers():
    hidden = np.zeros((FRAMES, 6), bool)
    session_tracks, true, resting = tracks(hidden)
    outlines = corners(np.ones((FRAMES, 4), bool))
    outlines[resting, 1:] = np.nan
    alignment = align_with_rest(rig.markers(), session_tracks, outlines, resting, "auto")
    assert alignment.by == "anchor"
    assert np.nanmax(errors(alignment, true)) < 0.15


def test_rarely_visible_anchor_is_not_used():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[5:, :2] = True
    session_tracks, _, resting = tracks(hidden)
    alignment = align_with_rest(rig.markers(), session_tracks, NONE, resting, "auto")
    assert alignment.by == "all"
    assert len(alignment.warnings) == 1
    hidden[:, :2] = True
    with pytest.raises(CaptureError):
        align_with_rest(rig.markers(), tracks(hidden)[0], NONE, np.zeros(FRAMES, bool), "anchor")
