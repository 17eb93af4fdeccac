"""What a design and a training foretell adds up, and is compared with what was measured."""

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
    found = predict_error(REPEATS, frames, DesignPrediction(0.5, 0.4, 0.45, 0.6))
    assert sum(found.shares.values()) == pytest.approx(found.predicted**2, rel=1e-12)
    assert found.shares[DESIGN] == pytest.approx(0.25)
    assert found.shares[REPEATABILITY] == pytest.approx(0.30 - 0.02 - 0.16)
    assert found.predicted**2 == pytest.approx(0.25 - 0.16 + 0.30 + 0.05 + 0.04)
    assert found.measured == pytest.approx(np.sqrt((frames.frame_error**2).mean()))
    assert found.ratio == pytest.approx(found.predicted / found.measured)
    assert found.design_ratio == pytest.approx(0.5 / found.measured)


def test_without_a_design(frames):
    found = predict_error(REPEATS, frames)
    assert DESIGN not in found.shares
    assert found.design_ratio is None
    assert found.shares[CAMERAS] == 0.04
    assert found.predicted**2 == pytest.approx(0.39)


def test_clocks_are_a_part_of_what_differs(frames):
    small = Repeatability(at_once=0.01, drift=0.0, cameras=0.0, clocks=0.02, share=1.0)
    found = predict_error(small, frames)
    assert found.shares[CLOCKS] == 0.01
    assert found.shares[REPEATABILITY] == 0
