"""Predicted errors add up and are compared with measured ones."""

import numpy as np
import pytest

from defsense_fab.training.evaluation.decoded_frames import decode_frames
from defsense_fab.training.evaluation.error_budget import CAMERAS, CLOCKS
from defsense_fab.training.evaluation.predicted_error import (
    DESIGN,
    REPEATABILITY,
    DesignPrediction,
    predict_error,
)
from defsense_fab.training.fitting.repeatability import Repeatability
from tests.training import soft_bar as bar

REPEATS = Repeatability(at_once=0.30, drift=0.05, cameras=0.04, clocks=0.02, share=0.6)


@pytest.fixture(scope="module")
def frames():
    data = bar.dataset(bar.recording(20, sigma=0.2))
    return decode_frames(bar.trained(data), data, 1.0)


def test_shares_add_up_and_noise_counts_once(frames):
    result = predict_error(REPEATS, frames, DesignPrediction(0.5, 0.4, 0.45, 0.6))
    assert sum(result.shares.values()) == pytest.approx(result.predicted**2, rel=1e-12)
    assert result.shares[DESIGN] == pytest.approx(0.25)
    assert result.shares[REPEATABILITY] == pytest.approx(0.30 - 0.02 - 0.16)
    assert result.predicted**2 == pytest.approx(0.25 - 0.16 + 0.30 + 0.05 + 0.04)
    assert result.measured == pytest.approx(np.sqrt((frames.frame_error**2).mean()))
    assert result.ratio == pytest.approx(result.predicted / result.measured)
    assert result.design_ratio == pytest.approx(0.5 / result.measured)


def test_without_a_design(frames):
    result = predict_error(REPEATS, frames)
    assert DESIGN not in result.shares
    assert result.design_ratio is None
    assert result.shares[CAMERAS] == 0.04
    assert result.predicted**2 == pytest.approx(0.39)


def test_clocks_are_part_of_repeatability(frames):
    small = Repeatability(at_once=0.01, drift=0.0, cameras=0.0, clocks=0.02, share=1.0)
    result = predict_error(small, frames)
    assert result.shares[CLOCKS] == 0.01
    assert result.shares[REPEATABILITY] == 0
