"""Each simulated cause of errors is identified, and shares add up."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.evaluation import error_budget as budget
from defsense_fab.training.evaluation.corrections import RIDGES, fit_features, residual_of
from defsense_fab.training.evaluation.decoded_frames import decode_frames
from defsense_fab.training.evaluation.evaluate import evaluate
from defsense_fab.training.evaluation.marker_motion import sample_noise
from tests.training import soft_bar as bar

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model():
    """A model that is exact to 0.1 mm on clean recordings."""
    return bar.trained(bar.dataset(bar.recording(90)), bar.quadratic_features)


def split_error(model, **causes):
    data = bar.dataset(bar.recording(60, seed=1, **causes))
    out = budget.error_budget(model, data)
    assert sum(out.shares.values()) == pytest.approx(out.total, rel=1e-12)
    assert out.total == pytest.approx(evaluate(model, data).total.rmse ** 2)
    return out


@pytest.mark.parametrize(
    ("cause", "causes", "least"),
    [
        (budget.CAMERAS, {"sigma": 0.5}, 0.95),
        (budget.PLACEMENT, {"gain": (1.2, 0.9, 1.1)}, 0.9),
    ],
)
def test_a_single_cause_is_identified(model, cause, causes, least):
    out = split_error(model, **causes)
    assert out.total > 20 * split_error(model).total
    assert out.shares[cause] > least * out.total
    assert abs(out.shares[budget.UNEXPLAINED]) < 0.05 * out.total
    others = {k: v for k, v in out.shares.items() if k not in (cause, budget.UNEXPLAINED)}
    assert max(others.values()) < (1 - least) * out.total


def test_read_out_noise_is_identified():
    """The model was trained with the same noise, so its trained range includes it."""
    noisy = bar.trained(
        bar.dataset(bar.recording(90, noise=0.004)), bar.quadratic_features, noise=0.004
    )
    out = split_error(noisy, noise=0.004)
    assert out.shares[budget.READ_OUT] == pytest.approx(out.total, rel=0.1)
    assert abs(out.shares[budget.UNEXPLAINED]) < 0.1 * out.total


def test_noise_beyond_the_trained_range_counts_once(model):
    """The model was trained without noise."""
    out = split_error(model, noise=0.004)
    assert out.shares[budget.READ_OUT] == pytest.approx(out.total, rel=0.1)
    assert out.shares[budget.UNSEEN] < 0.01 * out.total


def test_gains_that_move_frames_beyond_the_trained_range_are_identified():
    """Frames are within the trained range after the gains are corrected."""
    causes = {"noise": 0.002, "sigma": 0.15, "memory": 0.3}
    model = bar.trained(
        bar.dataset(bar.recording(120, **causes)), bar.quadratic_features, noise=0.002
    )
    data = bar.dataset(bar.recording(60, seed=5, drift=0.03, gain=(1.1, 1, 0.9), **causes))
    assert evaluate(model, data).outside.frames > 1000
    out = budget.error_budget(model, data)
    assert out.shares[budget.PLACEMENT] > 0.4 * out.total
    assert out.shares[budget.UNSEEN] < 0.05 * out.total


def test_drift_is_identified(model):
    """The drift is 0 in the middle, since its mean would be an offset."""
    run = bar.recording(60, seed=1)
    course = 0.03 * (run.sample_time / 60 - 0.5)  # gains would explain a part of a larger drift
    drifting = replace(run, ohm=bar.R0 * (1 + run.signals + course[:, None]))
    out = budget.error_budget(model, bar.dataset(drifting))
    assert out.shares[budget.DRIFT] > 0.6 * out.total
    constant = budget.error_budget(model, bar.dataset(bar.recording(60, seed=1, drift=0.06)))
    assert constant.shares[budget.PLACEMENT] > 0.6 * constant.total


def test_hysteresis_is_identified(model):
    """The part of hysteresis that is in phase with the signals counts as a gain."""
    out = split_error(model, memory=0.3)
    assert out.total > 100 * split_error(model).total
    assert 0.3 < out.shares[budget.HYSTERESIS] / out.total < 0.6
    assert 0.3 < out.shares[budget.PLACEMENT] / out.total < 0.6
    assert out.shares[budget.DECODER] < 0.05 * out.total
    assert abs(out.shares[budget.UNEXPLAINED]) < 0.05 * out.total


def test_a_clock_delay_is_identified(model):
    """At most twice the standard error is attributed to clocks."""
    run = bar.recording(60, seed=1)
    late = replace(run, sample_time=run.sample_time + 0.04, sync_error=0.02)
    out = budget.error_budget(model, bar.dataset(late))
    assert out.shares[budget.CLOCKS] > 0.9 * out.total
    small = budget.error_budget(model, bar.dataset(replace(late, sync_error=0.004)))
    assert 0 < small.shares[budget.CLOCKS] < 0.5 * small.total
    unknown = budget.error_budget(model, bar.dataset(replace(late, sync_error=None)))
    assert unknown.shares[budget.CLOCKS] == 0


def test_impossible_gains_are_rejected(model):
    """With clocks that are wrong by seconds, gains near 0 would reduce the error."""
    run = bar.recording(20, seed=2)
    late = replace(run, sample_time=run.sample_time + 3)
    out = budget.error_budget(model, bar.dataset(late))
    assert out.shares[budget.PLACEMENT] == 0
    assert out.shares[budget.DRIFT] == 0
    assert sum(out.shares.values()) == pytest.approx(out.total)


def test_an_affine_decoder_is_identified():
    data = bar.dataset(bar.recording(90))
    model = bar.trained(data)
    test = bar.dataset(bar.recording(60, seed=1))
    out = budget.error_budget(model, test)
    inside = sum(v for k, v in out.shares.items() if k != budget.UNSEEN)
    assert out.shares[budget.DECODER] > 0.95 * inside


def test_unseen_poses_are_identified():
    """The model is trained on bends and tested on twists."""
    run = bar.recording(90)
    bends = replace(
        run, points=np.where((run.time // 10 % 3 == 0)[:, None, None], run.points, np.nan)
    )
    model = bar.trained(bar.dataset(bends))
    out = budget.error_budget(model, bar.dataset(bar.recording(60, seed=1)))
    assert out.shares[budget.UNSEEN] > 0.9 * out.total


def test_random_errors_stay_unexplained(model):
    """Corrections with many coefficients do not explain random errors."""
    run = bar.recording(60, seed=1)
    rng = np.random.default_rng(0)
    noisy = bar.dataset(replace(run, points=run.points + rng.normal(0, 1, run.points.shape)))
    out = budget.error_budget(model, noisy)
    assert out.shares[budget.UNEXPLAINED] > 0.97 * out.total
    frames = decode_frames(model, noisy, 1.0)
    many = np.random.default_rng(1).normal(size=(len(frames.time), 40))
    residual = residual_of(frames)
    for ridge in RIDGES:
        assert residual.reduced_by(fit_features(residual, many, ridge)) is residual


def test_gaps_and_several_runs(model):
    runs = [
        bar.recording(30, seed=k, gaps=0.2, gain=(1.2, 0.9, 1.1), name=f"run-{k}") for k in (1, 2)
    ]
    out = budget.error_budget(model, bar.dataset(*runs), 0.5)
    assert sum(out.shares.values()) == pytest.approx(out.total)
    assert out.shares[budget.PLACEMENT] > 0.8 * out.total


def test_a_model_with_memories():
    """A decoder with memory corrects hysteresis."""
    data = bar.dataset(bar.recording(90, memory=0.3))
    test = bar.dataset(bar.recording(60, seed=1, memory=0.3))
    plain = budget.error_budget(bar.trained(data), test)
    knowing = budget.error_budget(bar.trained(data, past=Past((1.0,))), test)
    assert knowing.total < 0.7 * plain.total
    assert knowing.shares[budget.HYSTERESIS] < 0.3 * plain.shares[budget.HYSTERESIS]


def test_sample_noise():
    """The noise is found during movement, at rest, and without a rest."""
    for noise in (0.002, 0.02):
        run = bar.recording(60, noise=noise)
        assert sample_noise(run) == pytest.approx(noise, rel=0.1)
    assert (sample_noise(bar.recording(60)) < 2e-4).all()
    run = bar.recording(60, noise=0.002)
    dead = replace(
        run, ohm=np.where([True, False, True], run.ohm, np.nan), points=run.points * np.nan
    )
    size = sample_noise(dead)
    assert size[1] == 0
    assert size[0] == pytest.approx(0.002, rel=0.1)
