"""Error budgets from the truth that a twin stores with its session."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.evaluation.error_budget import CAMERAS, READ_OUT
from defsense_fab.training.evaluation.evaluate import evaluate
from defsense_fab.training.evaluation.twin_truth import MEMORY, TRUTH, budget_of_truth
from tests.training import soft_bar as bar

CAUSES = {"noise": 0.004, "sigma": 0.3, "memory": 0.2}


@pytest.fixture
def session(tmp_path):
    run = replace(bar.recording(60, seed=1, **CAUSES), session=str(tmp_path))
    ideal = bar.recording(60, seed=1)
    np.savez(
        tmp_path / TRUTH, time=ideal.time, ids=bar.IDS, points=ideal.points,
        sample_time=ideal.sample_time, channels=np.array(bar.CHANNELS), signals=ideal.signals,
    )  # fmt: skip
    return bar.dataset(run)


def test_simulated_causes_are_identified_and_add_up(session):
    model = bar.trained(
        bar.dataset(bar.recording(90, **CAUSES)), bar.quadratic_features, noise=0.004
    )
    result = budget_of_truth(model, session, 1.0)
    assert result is not None
    assert result.total == pytest.approx(evaluate(model, session).total.rmse ** 2)
    assert sum(result.shares.values()) == pytest.approx(result.total, rel=1e-12)
    assert result.shares[CAMERAS] == pytest.approx(3 * 0.3**2, rel=0.1)
    assert result.shares[READ_OUT] > 0
    assert result.shares[MEMORY] > result.shares[READ_OUT] / 10


def test_decoders_with_memory_keep_the_cords_memory(session):
    data = bar.dataset(bar.recording(90, **CAUSES))
    moved = budget_of_truth(bar.trained(data, past=Past((1.0,)), noise=0.004), session, 1.0)
    worked = budget_of_truth(bar.trained(data, past=Past((), (1.0,)), noise=0.004), session, 1.0)
    assert moved is not None
    assert worked is not None
    assert MEMORY not in moved.shares
    assert READ_OUT in moved.shares
    assert READ_OUT not in worked.shares


def test_sessions_without_truth_have_no_shares(session, tmp_path):
    model = bar.trained(bar.dataset(bar.recording(60)))
    (tmp_path / TRUTH).unlink()
    assert budget_of_truth(model, session, 1.0) is None
