"""Limits of faults by what a training has seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.fitting.fault_limits import fit_fault_limits

from ..conftest import Maker


def repeats(dataset: Dataset, step: float) -> np.ndarray:
    """s, of the dataset read by a converter of so many ohm a count."""
    r = dataset.recordings[0]
    coarse = replace(r, ohm=step * np.round(r.ohm / step))
    found = fit_fault_limits(replace(dataset, recordings=(coarse,))).repeats
    assert found is not None
    return found


def test_for_how_long_a_channel_may_repeat_itself(recorded: Maker) -> None:
    """Nine samples of a fine converter, at 60 a second; more of a coarse one; for ever where
    noise is below a count."""
    dataset = recorded(60)
    np.testing.assert_allclose(repeats(dataset, 1e-6), 9 / 60, rtol=0.01)
    some = repeats(dataset, 1.0)
    assert (some > 9.5 / 60).all()
    assert (some < 2.0).all()
    assert (repeats(dataset, 500.0) > 1e5).all()
