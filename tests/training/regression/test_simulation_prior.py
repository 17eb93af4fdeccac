"""The simulation as a prior, and the coverage of its states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.decoding.trained_model import UNTRAINED_DISTANCE
from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.data.dataset_checks import check_dataset
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.frames import Frames
from defsense_fab.training.regression.simulated_decoder import fit_simulated_model
from defsense_fab.training.regression.simulation_prior import (
    Prior,
    measure_coverage,
    predict_signals,
)
from tests.support.errors import raises

from ..conftest import Maker

pytestmark = pytest.mark.slow


def simulated(recorded: Maker, states: int = 40) -> Prior:
    """Return simulated states of the same body, without noise."""
    dataset = recorded(60, seed=99, noise=0.0, sigma=0.0)
    run = dataset.recordings[0]
    at = np.linspace(5, len(run.time) - 5, states).astype(int)
    signals = np.stack([np.interp(run.time[at], run.sample_time, s) for s in run.signals.T], axis=1)
    moved = run.points[at] - dataset.rest_points
    names = ("rest", *(f"state {k}" for k in range(states)))
    rest = np.zeros((1, signals.shape[1])), np.zeros((1, *moved.shape[1:]))
    return Prior(names, np.concatenate([rest[0], signals]), np.concatenate([rest[1], moved]))


def part(dataset: Dataset, pictures: slice) -> Dataset:
    """Return the dataset with some of its frames."""
    run = dataset.recordings[0]
    few = replace(
        run, time=run.time[pictures], points=run.points[pictures], sigma=run.sigma[pictures]
    )
    return replace(dataset, recordings=(few,))


def error(result_of: object, dataset: Dataset) -> float:
    run = dataset.recordings[0]
    result = result_of.decode(run.sample_time, run.signals, run.time)  # type: ignore[attr-defined]
    return float(np.sqrt(((result.points - run.points) ** 2).sum(2).mean()))


def test_sixty_frames_with_a_prior_are_nearly_as_good_as_thousands(
    recorded: Maker,
) -> None:
    prior = simulated(recorded)
    long, later = recorded(120, gain=[1.1, 0.9, 1.05]), recorded(30, seed=5, gain=[1.1, 0.9, 1.05])
    few = part(long, slice(0, 240, 4))
    options = TrainOptions(test_share=0.0)
    full = error(train(long, options).model, later)
    alone = error(train(few, options).model, later)
    helped = error(train(few, options, prior=prior).model, later)
    assert helped < 2.0 * full
    assert helped < 0.5 * alone


def test_a_wrong_simulation_is_not_used(recorded: Maker) -> None:
    prior = simulated(recorded)
    other = replace(prior, signals=prior.signals[::-1].copy())
    dataset = recorded(60)
    without, with_it = train(dataset), train(dataset, prior=other)
    rows = {a.name: a for a in with_it.candidates}
    assert rows["simulated"].cross_validated > 5 * rows["quadratic"].cross_validated
    assert error(with_it.model, dataset) < 1.2 * error(without.model, dataset)
    assert rows["affine"].cross_validated == without.candidates[0].cross_validated


def test_a_simulated_model_has_no_intervals(recorded: Maker) -> None:
    prior, dataset = simulated(recorded), recorded(30, noise=0.0)
    model = fit_simulated_model(
        "toy", "", dataset.channels, dataset.ids, dataset.rest_points, prior
    )
    assert error(model, dataset) < 0.5
    assert model.main.intervals is None
    assert set(model.without) == set(dataset.channels)


def test_the_range_of_a_simulated_model_contains_built_devices(recorded: Maker) -> None:
    prior, dataset = simulated(recorded), recorded(30, noise=0.0)
    model = fit_simulated_model(
        "toy", "", dataset.channels, dataset.ids, dataset.rest_points, prior
    )
    for branch in (model.main, *model.without.values()):
        signals = prior.signals[:, list(branch.channels)]
        for gain in (0.87, 1.15, np.resize([0.87, 1.15, 1.1], signals.shape[1])):
            assert (branch.range.distance(gain * signals + 0.01) < 1).mean() > 0.9
        assert branch.range.distance(5 * signals).max() > UNTRAINED_DISTANCE


def test_a_prior_without_states_is_refused() -> None:
    with raises(TrainingError, "too-few-states"):
        Prior(("rest",), np.zeros((1, 3)), np.zeros((1, 4, 3)))


def test_coverage_names_states_that_were_not_shown(recorded: Maker) -> None:
    prior, dataset = simulated(recorded), recorded(60)
    far = replace(
        prior,
        names=(*prior.names, "pull"),
        signals=np.append(prior.signals, [[0.3] * 3], axis=0),
        displacements=np.append(prior.displacements, 40 + prior.displacements[-1:], axis=0),
    )
    result = measure_coverage(Frames.from_dataset(dataset), far)
    assert not result.is_shown[-1]
    assert "pull" in result.advice[0]
    assert result.share > 0.5
    assert not result.ends_at_rest
    assert "rest" in result.advice[-1]


def test_a_recording_that_shows_all_and_ends_at_rest_has_no_advice(recorded: Maker) -> None:
    prior, dataset = simulated(recorded, 5), recorded(60)
    run = dataset.recordings[0]
    shown = dataset.rest_points + np.repeat(prior.displacements, 60, axis=0)
    rest = np.broadcast_to(dataset.rest_points, (300, *dataset.rest_points.shape))
    points = np.concatenate([shown, rest])
    run = replace(run, time=run.time[: len(points)], points=points, sigma=np.zeros_like(points))
    result = measure_coverage(Frames.from_dataset(replace(dataset, recordings=(run,))), prior)
    assert result.advice == ()
    assert result.share == 1.0


def test_signals_are_predicted_from_markers(recorded: Maker) -> None:
    prior, dataset = simulated(recorded), recorded(30, noise=0.0, gaps=0.3)
    run = dataset.recordings[0]
    result = predict_signals(prior, run, dataset.rest_points)
    off = result - run.signals_at(run.time)
    known = np.isfinite(off).all(axis=1)
    assert known.mean() > 0.8
    assert np.sqrt((off[known] ** 2).mean()) < 0.15 * run.signals.std()


def test_exchanged_channels_are_detected_in_one_session(recorded: Maker) -> None:
    prior, dataset = simulated(recorded), recorded(90)
    run = dataset.recordings[0]
    predicted = {run.name: predict_signals(prior, run, dataset.rest_points)}
    swapped = replace(dataset, recordings=(replace(run, ohm=run.ohm[:, [1, 0, 2]]),))
    kinds = {p.code for p in check_dataset(swapped, predicted=predicted)}
    assert "permuted-channels" in kinds
    assert "permuted-channels" not in {p.code for p in check_dataset(dataset, predicted=predicted)}
