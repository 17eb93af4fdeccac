"""How a live device begins when not all is well: cords open or shorted, held in a pose."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.runtime.frames.live_decoder import LiveDecoder, Sample
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.frames.rest_tracker import RestTracker
from tests.runtime.frames.test_live_decoder import model, recorded, run  # noqa: F401

RATE = 60.0


def rest_of(run):  # noqa: F811
    return run.rest


def lie(decoder, ohms, seconds, begin=0.0):
    """The last frame of a device that lies still."""
    rng, out = np.random.default_rng(1), None
    for k in range(round(seconds * RATE)):
        t = begin + k / RATE
        out = decoder(Sample(t, ohms * (1 + 1e-5 * rng.normal(size=len(ohms))), t)) or out
    return out


@pytest.mark.parametrize(("reads", "words"), [(np.inf, "left is open"), (1e-3, "left is shorted")])
def test_a_cord_that_is_lost_from_the_start_is_told_and_decoded_without(model, run, reads, words):  # noqa: F811
    rest = run.rest
    decoder = LiveDecoder(model, None, rest)
    lost = rest.copy()
    lost[0] = reads
    frame = lie(decoder, lost, 0.5)
    assert frame.quality is Quality.LOST
    assert any(words in note for note in frame.notes)
    frame = lie(decoder, lost, 4.0, 0.5)
    assert frame.quality is Quality.FALLBACK
    assert frame.lost == "left"
    # Its plug is put in: R0 of it, which was guessed, is measured at the next rest.
    frame = lie(decoder, rest * [1.02, 1.0, 1.0], 6.0, 4.5)
    assert frame.quality is Quality.TRUSTED
    assert abs(frame.signals[0]) < 2e-3


def test_a_cord_that_is_lost_where_no_training_rest_is_known_is_measured_later(model, run):  # noqa: F811
    decoder = LiveDecoder(model)
    lost = run.rest.copy()
    lost[0] = np.inf
    assert lie(decoder, lost, 4.0).quality is Quality.FALLBACK
    frame = lie(decoder, run.rest, 6.0, 4.0)
    assert frame.quality is Quality.TRUSTED
    np.testing.assert_allclose(frame.signals, 0.0, atol=2e-3)


def test_a_rest_that_was_measured_in_a_pose_is_measured_anew(model, run):  # noqa: F811
    span = model.main.range.high - model.main.range.low
    decoder = LiveDecoder(model, None, run.rest)
    bent = run.rest * (1 + 3.0 * span)
    assert lie(decoder, bent, 3.0).quality is not Quality.LOST
    frame = lie(decoder, run.rest, 2.0, 3.0)
    assert frame.quality is Quality.LOST
    assert any("make no sense" in note and "At rest now" in note for note in frame.notes)
    frame = lie(decoder, run.rest, 8.0, 5.0)
    assert frame.quality is Quality.TRUSTED
    assert any("measured anew" in note for note in frame.notes)
    np.testing.assert_allclose(frame.signals, 0.0, atol=1e-3)


def test_at_rest_now_sets_the_cords_that_can_be_read_and_says_so(model, run):  # noqa: F811
    decoder = LiveDecoder(model, run.rest, run.rest)
    lost = run.rest * 1.01
    lost[1] = np.inf
    lie(decoder, lost, 2.0)
    decoder.rest_now()
    frame = lie(decoder, lost, 1.0, 2.0)
    assert any(note == "R0 is what the cords read now (but top)" for note in frame.notes)
    assert abs(frame.signals[0]) < 1e-3
    nothing = np.full(3, np.inf)
    lie(decoder, nothing, 1.0, 3.0)
    decoder.rest_now()
    frame = lie(decoder, nothing, 0.2, 4.0)
    assert any("no cord can be read" in note for note in frame.notes)


def test_poses_that_are_kept_step_by_step_do_not_become_the_rest():
    span, R0 = np.array([0.2]), np.array([1000.0])
    tracker = RestTracker(span, R0)
    for step in range(9):
        level = 0.08 * step
        for k in range(round(40 * RATE)):
            told = tracker(40 * step + k / RATE, R0 * (1 + level * span))
    assert np.abs(told.ohms / R0 - 1).max() <= 0.3 * 0.2 + 1e-6
    assert told.farthest


def test_a_cord_that_fails_without_fallback_is_not_trusted(model, run):  # noqa: F811
    decoder = LiveDecoder(model, run.rest, fallback=False)
    shorted = run.rest.copy()
    shorted[2] *= 0.05
    frame = lie(decoder, shorted, 1.0)
    assert frame.quality in (Quality.FALLBACK, Quality.LOST)
