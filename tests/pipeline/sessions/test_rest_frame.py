"""Which markers lay a session's frames onto the rest pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.core.errors import CaptureError
from defsense_fab.core.tracks import Tracks
from defsense_fab.pipeline.sessions.rest_frame import lay_on_rest
from tests.pipeline.sessions import capture_rig as rig

FRAMES, NOISE = 200, 0.02


def tracks(hidden):
    """Tags in hands: the last two go out by up to 12 mm; `hidden` (t, m) are not seen."""
    rng = np.random.default_rng(3)
    time = np.arange(FRAMES) / 30
    true = np.array([rig.places(t) if t > 2 else rig.CENTERS for t in time])
    turn = Rotation.from_rotvec(0.2 * np.sin(np.outer(time, [1.0, 0.7, 0.5])))
    shown = np.stack([r.apply(p) for r, p in zip(turn, true, strict=True)])
    shown = shown + np.array([5, -3, 700])
    points = shown + rng.normal(scale=NOISE, size=shown.shape)
    points[hidden] = np.nan
    sigma = np.where(np.isfinite(points), NOISE, np.nan)
    return Tracks(time, np.arange(6), points, sigma, np.arange(FRAMES)), true, time < 2


def errors(laid, true):
    return np.linalg.norm(laid.aligned.points - true, axis=2)


def test_frames_without_the_anchor_are_laid_by_all_and_no_other():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[FRAMES // 2 :, :2] = True  # two of four anchors: they do not tell a rotation
    seen, true, resting = tracks(hidden)
    laid = lay_on_rest(rig.markers(), seen, resting, "auto")
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
    strict = lay_on_rest(rig.markers(), seen, resting, "anchor")
    assert not strict.aligned.ok[half:].any()
    assert strict.warnings == []


def test_an_anchor_that_is_hardly_seen_is_not_used():
    hidden = np.zeros((FRAMES, 6), bool)
    hidden[5:, :2] = True
    seen, _, resting = tracks(hidden)
    laid = lay_on_rest(rig.markers(), seen, resting, "auto")
    assert laid.by == "all"
    assert "of the frames only" in laid.warnings[0]
    hidden[:, :2] = True
    with pytest.raises(CaptureError):
        lay_on_rest(rig.markers(), tracks(hidden)[0], np.zeros(FRAMES, bool), "anchor")
