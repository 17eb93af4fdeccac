"""Signals of the first rest of sessions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from defsense_fab.training.fitting.pose_signals import first_rest_signals
from tests.training.synthetic import CHANNELS, R0, dataset, recording

ASKED = ((0.0, "rest"), (4.0, "bend"), (9.0, "rest"))


def begun(k: int, session: str, off: float):
    """Return a recording whose first four seconds read lower."""
    r = recording(k, session=session)
    low = R0 * (1 + off * np.array([1.0, 0.5, -0.2]))
    ohm = np.where(r.sample_time[:, None] < r.sample_time[0] + 4.0, low, r.ohm)
    return replace(r, ohm=ohm, rest=R0, poses=ASKED)


def test_each_session_counts_once_with_its_first_run():
    runs = [begun(1, "a", -0.02), begun(2, "a", -0.5), begun(3, "b", -0.03), begun(4, "c", -0.04)]
    result = first_rest_signals(dataset(*runs))
    assert result is not None
    np.testing.assert_allclose([result[c] for c in CHANNELS], [-0.03, -0.015, 0.006], atol=1e-9)


def test_sessions_without_an_initial_rest_are_ignored():
    moving = replace(recording(1), poses=((0.0, "bend"), (5.0, "rest")))
    assert first_rest_signals(dataset(moving)) is None
    assert first_rest_signals(dataset(replace(recording(1), poses=()))) is None
    blind = replace(begun(1, "a", -0.02), ohm=np.full_like(recording(1).ohm, np.nan))
    assert first_rest_signals(dataset(blind)) is None
