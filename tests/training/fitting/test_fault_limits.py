"""Fault limits derived from training data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.fitting.fault_limits import fit_fault_limits

from ..conftest import Maker


def repeats(dataset: Dataset, step: float) -> np.ndarray:
    """Return the limits in s for a converter with `step` ohm per count."""
    r = dataset.recordings[0]
    coarse = replace(r, ohm=step * np.round(r.ohm / step))
    result = fit_fault_limits(replace(dataset, recordings=(coarse,))).repeats
    assert result is not None
    return result


def test_how_long_a_channel_may_be_constant(recorded: Maker) -> None:
    """It is nine samples at 60 Hz for a fine converter, longer for a coarse one, and unlimited if
    noise is below a count.
    """
    dataset = recorded(60)
    np.testing.assert_allclose(repeats(dataset, 1e-6), 9 / 60, rtol=0.01)
    some = repeats(dataset, 1.0)
    assert (some > 9.5 / 60).all()
    assert (some < 2.0).all()
    assert (repeats(dataset, 500.0) > 1e5).all()
