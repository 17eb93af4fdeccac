"""A decoder with memories knows at which signals the device is at rest."""

import numpy as np
import pytest

from defsense_fab.decoding.input_decoder import InputDecoder, InputFeatures, no_products
from defsense_fab.decoding.signal_history import Past
from defsense_fab.decoding.trained_model import Branch, TrainedRange
from defsense_fab.runtime.frames.rest_signals import rest_signals

REST = np.array([5.0, -3.0, 20.0])  # outputs, mm
SLOPES = np.array([[90.0, 10.0, 0.0], [0.0, -60.0, 30.0]])  # of two signals, mm
REMEMBERED = np.array([[0.4, 0.0], [0.1, -0.3]])  # signals per memory


def make_branch(slopes):
    weights = np.concatenate([slopes, -REMEMBERED @ slopes])
    features = InputFeatures(4, no_products(), np.empty((0, 4)), np.ones(4))
    decoder = InputDecoder(features, weights, REST)
    seen = TrainedRange(np.zeros(4), np.eye(4), 1.0, -np.ones(2), np.ones(2))
    return Branch((0, 1), Past((5.0,)), decoder, seen, None)


def test_signals_at_rest_follow_from_the_memories():
    branch, memories = make_branch(SLOPES), np.array([0.05, -0.02])
    expected = memories @ REMEMBERED
    inputs = np.concatenate([expected + np.array([0.03, -0.01]), memories])
    for _ in range(20):
        inputs[:2] = rest_signals(branch, inputs, REST, inputs[:2])
    assert inputs[:2] == pytest.approx(expected, abs=1e-6)


def test_signals_without_effect_on_the_positions_are_those_of_the_prior():
    branch, prior = make_branch(SLOPES * [[1.0], [0.0]]), np.array([0.0, 0.004])
    found = rest_signals(branch, np.array([0.03, -0.01, 0.0, 0.0]), REST, prior)
    assert found == pytest.approx(prior, abs=1e-6)
