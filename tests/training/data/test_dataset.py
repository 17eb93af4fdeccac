"""Fingerprints identify recordings by their content."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from defsense_fab.training.data.dataset import is_same_recording, recording_fingerprint

from ..conftest import Maker


def test_a_rounded_and_shifted_copy_has_the_same_fingerprint(recorded: Maker) -> None:
    r = recorded(120).recordings[0]
    other = replace(
        r,
        ohm=np.round(r.ohm[:, [2, 0, 1]], 1),
        rest=1.02 * r.rest[[2, 0, 1]],
        time=np.round(r.time + 100, 3),
        sample_time=np.round(r.sample_time + 100, 4),
    )
    assert is_same_recording(recording_fingerprint(r), recording_fingerprint(other))


def test_other_recordings_of_the_device_have_other_fingerprints(recorded: Maker) -> None:
    each = [recording_fingerprint(recorded(60, seed=k).recordings[0]) for k in range(8)]
    assert not any(is_same_recording(a, b) for k, a in enumerate(each) for b in each[:k])


def test_recordings_without_signals_are_never_the_same(recorded: Maker) -> None:
    r = recorded(60).recordings[0]
    still = replace(r, ohm=np.full_like(r.ohm, 1500.0))
    open_circuit = replace(r, ohm=np.full_like(r.ohm, np.nan))
    for one in (
        still,
        open_circuit,
        replace(r, time=r.time[:1], points=r.points[:1], sigma=r.sigma[:1]),
    ):
        assert not is_same_recording(recording_fingerprint(one), recording_fingerprint(one))
