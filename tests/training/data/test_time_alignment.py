"""Clocks are judged with a memory in the model: hysteresis is not a clock error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.data.dataset_checks import check_dataset
from defsense_fab.training.data.time_alignment import (
    align_samples,
    find_time_shift,
    find_time_shifts,
)
from tests.training import soft_bar, synthetic

pytestmark = pytest.mark.slow


def late_by(r: Recording, seconds: float) -> Recording:
    """Return the recording with signals that are late."""
    return replace(r, sample_time=r.sample_time + seconds)


def lagging(constant: float, seed: int = 1) -> Recording:
    """Return a recording whose signals follow the movement with a time constant in s."""
    r = synthetic.recording(seed, 120.0)
    memory = Past((constant,))(r.sample_time, r.signals)[:, r.signals.shape[1] :]
    return replace(r, ohm=r.rest * (1 + r.signals - 0.7 * memory))


def cut(r: Recording, count: int, length: float) -> Dataset:
    """Return a dataset of short runs."""
    parts = []
    for k in range(count):
        frames = (r.time >= 3 + k * length) & (r.time < 3 + (k + 1) * length)
        samples = (r.sample_time >= 3 + k * length) & (r.sample_time < 3 + (k + 1) * length)
        parts.append(
            replace(
                r,
                name=f"run-{k}",
                sample_time=r.sample_time[samples],
                ohm=r.ohm[samples],
                time=r.time[frames],
                points=r.points[frames],
                sigma=r.sigma[frames],
            )
        )
    return synthetic.dataset(*parts)


@pytest.mark.parametrize("constant", [1.0, 4.0])
def test_signals_that_follow_slowly_are_not_late(constant: float) -> None:
    r = lagging(constant)
    shift = find_time_shift([r])
    assert shift is not None
    assert not shift.is_significant
    assert shift.low <= 0.05
    assert "out-of-step" not in {p.code for p in check_dataset(synthetic.dataset(r))}
    aligned, notes = align_samples(synthetic.dataset(r), "auto")
    assert notes == []
    assert "shifts" not in aligned.provenance


@pytest.mark.parametrize("late", [-1.0, -0.3, -0.12, 0.2, 1.0])
@pytest.mark.parametrize("source", [synthetic.recording(2), soft_bar.recording(60, noise=1e-3)])
def test_a_true_shift_is_found(source: Recording, late: float) -> None:
    shift = find_time_shift([late_by(source, late)])
    assert shift is not None
    assert shift.is_significant
    assert shift.seconds == pytest.approx(-late, abs=0.05)
    assert shift.low < -late < shift.high


def test_slow_movement_does_not_show_the_clocks() -> None:
    r = soft_bar.recording(60, seed=3, noise=5e-3)
    slow = soft_bar.dataset(replace(r, time=10 * r.time, sample_time=10 * r.sample_time))
    (problem,) = (p for p in check_dataset(slow) if p.code == "clocks-unknown")
    assert not problem.is_fatal
    assert problem.data["low_s"] < -0.1 or problem.data["high_s"] > 0.1


def test_short_runs_are_judged_together() -> None:
    runs = cut(synthetic.recording(2, 60.0), 9, 6.0)
    found = find_time_shifts(runs)
    assert len(found) == 9
    assert all(s.is_known and not s.is_significant for s in found.values())
    late = replace(runs, recordings=tuple(late_by(r, 0.3) for r in runs.recordings))
    found = find_time_shifts(late)
    assert all(s.is_significant for s in found.values())
    assert found["run-4"].seconds == pytest.approx(-0.3, abs=0.05)


def test_a_clock_that_is_seconds_off_is_found() -> None:
    late = 5.0
    data = synthetic.dataset(late_by(synthetic.recording(2, 80.0), late))
    (problem,) = (p for p in check_dataset(data) if p.code == "out-of-step")
    assert not problem.is_fatal
    assert problem.value == pytest.approx(-late, abs=0.1)
    aligned, notes = align_samples(data, "auto")
    assert "out-of-step" not in {p.code for p in check_dataset(aligned)}
    assert "future" in notes[0]


def test_scalar_targets_have_shifts_too() -> None:
    """Targets of any number of dimensions are compared; the record itself has three."""
    r = late_by(synthetic.recording(2), 0.3)
    flat = np.broadcast_to(r.points[:, 3:4], (len(r.time), 1, 3))
    shift = find_time_shift([replace(r, points=flat, sigma=np.full(flat.shape, 0.1))])
    assert shift is not None
    assert shift.seconds == pytest.approx(-0.3, abs=0.05)
