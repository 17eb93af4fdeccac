"""Error budgets from the truth that a twin stores with its session."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.evaluation.error_budget import CAMERAS, READ_OUT, error_budget
from defsense_fab.training.evaluation.evaluate import evaluate
from defsense_fab.training.evaluation.twin_truth import (
    MEMORY,
    TRUTH,
    budget_of_truth,
    split_by_substitution,
)
from tests.training import soft_bar as bar

CAUSES = {"noise": 0.004, "sigma": 0.3, "memory": 0.2}


@pytest.fixture(scope="module")
def exact():
    """A model that is exact to 0.1 mm on clean recordings."""
    return bar.trained(bar.dataset(bar.recording(90)), bar.quadratic_features)


@pytest.fixture
def session(tmp_path):
    run = replace(bar.recording(60, seed=1, **CAUSES), session=str(tmp_path))
    ideal = bar.recording(60, seed=1)
    np.savez(
        tmp_path / TRUTH,
        time=ideal.time,
        ids=bar.IDS,
        points=ideal.points,
        sample_time=ideal.sample_time,
        channels=np.array(bar.CHANNELS),
        signals=ideal.signals,
    )
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


def test_a_share_is_what_the_error_loses_when_its_cause_is_removed(exact):
    def recorded(**causes):
        return bar.dataset(bar.recording(60, seed=1, **causes))

    stages = [
        ("recorded", recorded(sigma=0.5, noise=0.004, drift=0.05)),
        ("camera noise", recorded(noise=0.004, drift=0.05)),
        ("read-out noise", recorded(drift=0.05)),
        ("drift", recorded()),
    ]
    out = split_by_substitution(exact, stages)
    squares = [evaluate(exact, data).total.rmse ** 2 for _, data in stages]
    assert out.total == pytest.approx(squares[0])
    assert [out.shares[c] for c, _ in stages[1:]] == pytest.approx(-np.diff(squares))
    assert sum(out.shares.values()) == pytest.approx(out.total)
    assert out.shares["camera noise"] == pytest.approx(0.75, rel=0.05)
    formula = error_budget(exact, recorded(noise=0.004)).shares[READ_OUT]
    assert out.shares["read-out noise"] == pytest.approx(formula, rel=0.15)


def test_only_frames_in_all_stages_count(exact):
    """True data have no gaps."""
    run = bar.recording(20, seed=1, gaps=0.3)
    stages = [("recorded", bar.dataset(run)), ("gaps", bar.dataset(bar.recording(20, seed=1)))]
    out = split_by_substitution(exact, stages)
    assert out.shares["gaps"] == pytest.approx(0, abs=1e-12)
    other = bar.dataset(replace(run, time=run.time + 1e-4))
    assert split_by_substitution(exact, [stages[0], ("clock", other)]) is None
