"""Test the detection of torn, shorted, stuck and loose cords."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.arrays import Float
from defsense_fab.decoding.channel_faults import FaultLimits, find_faults

TIME = np.arange(0, 5, 1 / 60)
LIMITS = FaultLimits(
    np.full(2, -0.9), np.full(2, 0.8), np.full(2, 0.6), np.full(2, 0.01), np.full(2, 0.02)
)


def moving(seed: int = 0) -> Float:
    noise = 1e-3 * np.random.default_rng(seed).normal(size=(len(TIME), 2))
    return np.stack([0.1 * np.sin(TIME), 0.08 * np.sin(2 * TIME)], axis=1) + noise


def test_intact_device_has_no_faults() -> None:
    assert find_faults(LIMITS, TIME, moving()) == []


@pytest.mark.parametrize(
    ("kind", "value"), [("torn", np.inf), ("torn", np.nan), ("torn", 3.0), ("shorted", -0.98)]
)
def test_signal_beyond_any_strain(kind: str, value: float) -> None:
    signals = moving()
    signals[200:, 1] = value
    (fault,) = find_faults(LIMITS, TIME, signals)
    assert (fault.channel, fault.kind) == (1, kind)
    assert fault.since == pytest.approx(TIME[200])


def test_channel_that_is_constant_while_another_moves_is_stuck() -> None:
    signals = moving()
    signals[100:, 0] = signals[100, 0]
    (fault,) = find_faults(LIMITS, TIME, signals)
    assert (fault.channel, fault.kind) == (0, "stuck")


def test_device_at_rest_is_not_stuck() -> None:
    assert find_faults(LIMITS, TIME, np.zeros((len(TIME), 2))) == []


def test_loose_contact_jumps() -> None:
    signals = moving()
    signals[150:, 1] += 0.1 * (np.arange(len(TIME) - 150) % 3 == 0)
    (fault,) = find_faults(LIMITS, TIME, signals)
    assert (fault.channel, fault.kind) == (1, "loose")


def test_past_fault_is_not_reported() -> None:
    signals = moving()
    signals[50:100, 1] = np.inf
    assert find_faults(LIMITS, TIME, signals) == []


def test_stuck_channel_stays_stuck_while_others_move_slowly() -> None:
    signals = moving()
    signals[:, 1] = 0.004 * TIME + 1e-4 * np.sin(50 * TIME)
    signals[60:, 0] = signals[60, 0]
    faults = [find_faults(LIMITS, TIME[:k], signals[:k]) for k in range(240, 300)]
    assert all(len(f) == 1 and f[0].kind == "stuck" for f in faults)
    assert all(f[0].since == pytest.approx(TIME[60]) for f in faults)
