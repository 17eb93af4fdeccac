"""Useless models are recognized, with the cause that was put into the data."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.data.dataset_checks import require_trainable
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.fitting.usefulness import MAX_ERROR_SHARE, MIN_CHANCE_SHARE
from defsense_fab.training.fitting.useless_causes import judge_model
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.frames import Frames
from tests.training import soft_bar, synthetic

pytestmark = pytest.mark.slow

OPTIONS = TrainOptions(decoder="affine", memory=False)


@pytest.fixture(scope="module")
def training():
    """Return a training of one decoder on a useful recording."""
    return train(synthetic.dataset(synthetic.recording(1, 60.0)), OPTIONS)


def judged(training, recording):
    """Return the judgment of the trained model on another recording."""
    return judge_model(training.model, Frames.from_dataset(synthetic.dataset(recording)))


def test_a_model_that_follows_the_movement_is_useful(training):
    judgment = training.usefulness
    assert not judgment.is_useless
    assert judgment.message == ""
    assert judgment.cause is None
    selected = next(c for c in training.candidates if c.name == training.selected)
    assert judgment.error == pytest.approx(selected.test.rmse, rel=1e-6)
    points = training.test_frames.points
    mean = np.nanmean(training.training_frames.points, axis=0)
    spread = np.sqrt(np.nanmean(((points - mean) ** 2).sum(axis=2)))
    assert judgment.movement == pytest.approx(spread, rel=0.1)
    assert judgment.to_json()["code"] is None
    other = judged(training, synthetic.recording(2))
    assert other.error < 0.5 * other.movement


def test_the_error_is_graded_by_the_largest_movement_without_rare_wrong_markers(training):
    recording = synthetic.recording(2)
    judgment = judged(training, recording)
    distances = np.linalg.norm(recording.points - synthetic.dataset(recording).rest_points, axis=2)
    assert 0.8 * np.nanmax(distances) < judgment.travel <= np.nanmax(distances)
    share = 100 * judgment.error / judgment.travel
    assert f"{share:.2g} %" in judgment.error_in_words(judgment.error)
    points = recording.points.copy()
    points[:: 2 * len(points) // 3] += 1000.0
    assert judged(training, replace(recording, points=points)).travel < np.nanmax(distances)


def exchange_channels(r):
    return replace(r, ohm=r.ohm[:, [1, 0, 2]], rest=r.rest[[1, 0, 2]])


def exchange_markers(r):
    order = [0, 1, 3, 2, 4]
    return replace(r, points=r.points[:, order], sigma=r.sigma[:, order])


def shift_clock(r):
    return replace(r, sample_time=r.sample_time + 4.3)


def enlarge_movement(r):
    return replace(r, points=synthetic.REST + 10 * (r.points - synthetic.REST))


def hold_channel(r):
    ohm = r.ohm.copy()
    ohm[:, 1] = ohm[0, 1]
    return replace(r, ohm=ohm)


def keep_still(r):
    rng = np.random.default_rng(0)
    return replace(r, points=synthetic.REST + rng.normal(size=r.points.shape) * 0.1)


def forget_rest(r):
    return replace(r, rest=r.rest * [1.25, 0.8, 1.2])


def reverse_signals(r):
    return replace(r, ohm=r.ohm[::-1].copy())


def lose_marker(r):
    points = r.points.copy()
    points[:, 2] = [200.0, 300, 400]
    return replace(r, points=points)


DEFECTS = {
    exchange_channels: "permuted-channels",
    exchange_markers: "markers-exchanged",
    shift_clock: "out-of-step",
    enlarge_movement: "wrong-unit",
    hold_channel: "constant-channel",
    keep_still: "too-little-movement",
    forget_rest: "rest-changed",
    reverse_signals: "signals-tell-nothing",
    lose_marker: "wrong-markers",
}


@pytest.mark.parametrize(
    ("defect", "code"), DEFECTS.items(), ids=lambda each: getattr(each, "__name__", each)
)
def test_the_cause_of_a_useless_model_is_found(training, defect, code):
    judgment = judged(training, defect(synthetic.recording(2)))
    assert judgment.is_useless
    assert judgment.error >= MAX_ERROR_SHARE * judgment.movement
    assert judgment.cause.code == code
    data = judgment.to_json()
    assert (data["code"], data["cause"]["code"]) == ("useless-model", code)


def in_last_third(r, change):
    """Return the recording with changed points of its last frames."""
    points, first = r.points.copy(), int(0.7 * len(r.time))
    points[first:] = change(points[first:])
    return replace(r, points=points)


@pytest.mark.parametrize("order", [[3, 2, 1, 0, 4, 5], [1, 2, 3, 0, 4, 5]])
def test_exchanged_labels_in_the_test_do_not_forbid_training(order):
    r = soft_bar.recording(90, seed=2, noise=1e-3, sigma=0.1)
    data = soft_bar.dataset(in_last_third(r, lambda points: points[:, order]))
    require_trainable(data)
    judgment = train(data, OPTIONS).usefulness
    assert judgment.is_useless
    assert judgment.cause.code == "markers-exchanged"
    assert set(judgment.cause.data["order"]) <= {3, 5, 7, 11}


def test_a_clock_that_is_seconds_off_is_the_cause():
    late, r = 5.0, synthetic.recording(2, 80.0)
    data = synthetic.dataset(replace(r, sample_time=r.sample_time + late))
    require_trainable(data)
    cause = train(data, OPTIONS).usefulness.cause
    assert cause.code == "out-of-step"
    assert cause.data["shift_s"] == pytest.approx(-late, abs=0.1)


def nearly_periodic(late, noise):
    """Return a recording of one movement again and again, whose signals are late."""
    r = synthetic.recording(1, 120.0)
    rng = np.random.default_rng(0)
    knots = np.arange(0, 140, 4.0)
    phase = np.interp(np.arange(0, 130, 0.01), knots, np.cumsum(rng.normal(1, 0.12, len(knots))))
    wave = np.sin(2 * np.pi * phase)

    def at(time):
        return np.interp(time, np.arange(0, 130, 0.01), wave)

    signals = at(r.sample_time - late)[:, None] * [0.1, 0.05, -0.08]
    signals += noise * rng.normal(size=signals.shape)
    points = synthetic.REST + at(r.time)[:, None, None] * np.ones((len(synthetic.IDS), 3)) * 10
    return synthetic.dataset(
        replace(r, ohm=r.rest * (1 + signals), points=points, sigma=np.full(points.shape, 0.1))
    )


def test_periodic_movement_is_compared_with_chance():
    late = train(nearly_periodic(8.0, 1e-3), OPTIONS).usefulness
    assert late.is_useless
    noisy = train(nearly_periodic(0.0, 0.07), OPTIONS).usefulness
    assert noisy.error > MIN_CHANCE_SHARE * noisy.movement
    assert noisy.error < noisy.chance
    assert not noisy.is_useless
    assert train(nearly_periodic(0.0, 1e-3), OPTIONS).usefulness.chance is None
