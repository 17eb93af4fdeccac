"""Start of a live device with open or shorted cords, or held in a pose."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.runtime.frames.live_decoder import LiveDecoder, Reading
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.frames.rest_tracker import RestTracker
from tests.runtime.frames.test_live_decoder import model, recorded, run  # noqa: F401

RATE = 60.0


def lie(decoder, ohms, seconds, start=0.0):
    """Return the last frame of a device that lies still."""
    rng, out = np.random.default_rng(1), None
    for k in range(round(seconds * RATE)):
        t = start + k / RATE
        out = decoder(Reading(t, ohms * (1 + 1e-5 * rng.normal(size=len(ohms))), t)) or out
    return out


@pytest.mark.parametrize(("reads", "code"), [(np.inf, "torn"), (1e-3, "shorted")])
def test_cord_that_failed_before_the_start_is_reported_and_left_out(model, run, reads, code):  # noqa: F811
    rest = run.rest
    decoder = LiveDecoder(model, None, rest)
    lost = rest.copy()
    lost[0] = reads
    frame = lie(decoder, lost, 0.5)
    assert frame.quality is Quality.LOST
    assert (code, {"channels": ("left",)}) in [(n.code, n.data) for n in frame.notes]
    frame = lie(decoder, lost, 4.0, 0.5)
    assert frame.quality is Quality.FALLBACK
    assert frame.lost_channel == "left"
    # Its plug is connected: its R0, which was estimated, is measured at the next rest.
    frame = lie(decoder, rest * [1.02, 1.0, 1.0], 6.0, 4.5)
    assert frame.quality is Quality.TRUSTED
    assert abs(frame.signals[0]) < 2e-3


def test_failed_cord_is_measured_later_without_a_training_rest(model, run):  # noqa: F811
    decoder = LiveDecoder(model)
    lost = run.rest.copy()
    lost[0] = np.inf
    assert lie(decoder, lost, 4.0).quality is Quality.FALLBACK
    frame = lie(decoder, run.rest, 6.0, 4.0)
    assert frame.quality is Quality.TRUSTED
    np.testing.assert_allclose(frame.signals, 0.0, atol=2e-3)


def test_rest_measured_in_a_pose_is_measured_again(model, run):  # noqa: F811
    span = model.main.range.high - model.main.range.low
    decoder = LiveDecoder(model, None, run.rest)
    bent = run.rest * (1 + 3.0 * span)
    assert lie(decoder, bent, 3.0).quality is not Quality.LOST
    frame = lie(decoder, run.rest, 2.0, 3.0)
    assert frame.quality is Quality.LOST
    assert "readings-implausible" in [note.code for note in frame.notes]
    frame = lie(decoder, run.rest, 8.0, 5.0)
    assert frame.quality is Quality.TRUSTED
    assert "rest-remeasured" in [note.code for note in frame.notes]
    np.testing.assert_allclose(frame.signals, 0.0, atol=1e-3)


def test_rest_now_sets_the_readable_cords_and_reports_it(model, run):  # noqa: F811
    decoder = LiveDecoder(model, run.rest, run.rest)
    lost = run.rest * 1.01
    lost[1] = np.inf
    lie(decoder, lost, 2.0)
    decoder.rest_now()
    frame = lie(decoder, lost, 1.0, 2.0)
    assert ("rest-set", {"skipped": ("top",)}) in [(n.code, n.data) for n in frame.notes]
    assert abs(frame.signals[0]) < 1e-3
    nothing = np.full(3, np.inf)
    lie(decoder, nothing, 1.0, 3.0)
    decoder.rest_now()
    frame = lie(decoder, nothing, 0.2, 4.0)
    assert "rest-unchanged" in [note.code for note in frame.notes]


def test_a_rest_that_was_taken_is_undone(model, run):  # noqa: F811
    decoder = LiveDecoder(model, run.rest, run.rest)
    moved = run.rest * 1.01
    before = lie(decoder, moved, 0.2)
    decoder.rest_now()
    assert np.abs(lie(decoder, moved, 0.2, 1.0).signals).max() < 1e-3
    decoder.undo_rest_now()
    frame = lie(decoder, moved, 0.2, 2.0)
    assert "rest-restored" in [note.code for note in frame.notes]
    np.testing.assert_allclose(frame.signals, before.signals, atol=1e-3)


def test_poses_held_step_by_step_do_not_become_the_rest():
    span, R0 = np.array([0.2]), np.array([1000.0])
    tracker = RestTracker(span, R0)
    for step in range(9):
        level = 0.08 * step
        for k in range(round(40 * RATE)):
            rest = tracker(40 * step + k / RATE, R0 * (1 + level * span))
    assert np.abs(rest.ohms / R0 - 1).max() <= 0.3 * 0.2 + 1e-6
    assert rest.is_drift_limited


def test_failed_cord_without_fallback_is_not_trusted(model, run):  # noqa: F811
    decoder = LiveDecoder(model, run.rest, fallback=False)
    shorted = run.rest.copy()
    shorted[2] *= 0.05
    frame = lie(decoder, shorted, 1.0)
    assert frame.quality in (Quality.FALLBACK, Quality.LOST)
