"""Useless models are recognized, with the cause that was put into the data."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.fitting.usefulness import MAX_ERROR_SHARE
from defsense_fab.training.fitting.useless_causes import judge_model
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.frames import Frames
from tests.training import synthetic

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
