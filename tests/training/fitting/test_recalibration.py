"""Recalibration from rest and three poses after a cord has changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.decoding.trained_model import TrainedModel
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.fitting.recalibration import recalibrate
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from tests.support.errors import raises

from ..conftest import Maker

POSES = {"bend": [0.8, -0.5, 0.3], "twist": [-0.3, 0.9, 0.4], "pull": [0.2, 0.3, -0.9]}


def routine(
    gain: Sequence[float] = (1.0, 1.0, 1.0),
    seconds: float = 5.0,
    shown: float = 1.0,
    seed: int = 3,
    rounds: int = 1,
) -> Recording:
    """Return a recording of rest, then of each pose from rest to its extreme and back."""
    rng = np.random.default_rng(seed)
    body = np.random.default_rng(7)
    bend = 0.06 * np.eye(3) + 0.02 * body.normal(size=(3, 3))
    more = body.normal(size=(6, 3))
    i, j = np.triu_indices(3)
    time = np.arange(0, seconds * (1 + rounds * len(POSES)), 1 / 60)
    levels, marks = np.zeros((len(time), 3)), [(0.0, "rest")]
    for k, (name, full) in enumerate(rounds * [*POSES.items()], 1):
        marks.append((k * seconds, name))
        into = (time - k * seconds) / seconds
        way = np.where((into > 0) & (into < 1), np.sin(np.pi * np.clip(into, 0, 1)) ** 2, 0.0)
        levels += shown * way[:, None] * np.array(full) * rng.uniform(0.95, 1.05)
    signals = levels @ bend + 0.005 * (levels[:, i] * levels[:, j]) @ more
    ohm = 1500 * (1 + np.array(gain) * signals + 5e-4 * rng.normal(size=signals.shape))
    none = np.full((1, 6, 3), np.nan)
    return Recording(
        "routine",
        "s",
        "1",
        time,
        ohm,
        np.full(3, 1500.0),
        np.zeros(1) + 0.5,
        none,
        none,
        None,
        tuple(marks),
    )


@pytest.fixture(scope="module")
def model(recorded: Maker) -> TrainedModel:
    dataset = recorded(90)
    shown = replace(routine(rounds=6), name="shown")
    both = replace(dataset, recordings=(dataset.recordings[0], shown))
    return train(both, TrainOptions(memory=False)).model


def error(model: TrainedModel, dataset: Dataset) -> float:
    run = dataset.recordings[0]
    result = model.decode(run.sample_time, run.signals, run.time)
    return float(np.sqrt(((result.points - run.points) ** 2).sum(2).mean()))


def test_a_gain_that_changed_by_a_fifth_is_corrected(model: TrainedModel, recorded: Maker) -> None:
    """The third gain is determined less well, since few poses strain that cord."""
    gains = []
    for channel in range(3):
        gain = [1.0, 1.0, 1.0]
        gain[channel] = 1.2
        later = recorded(30, seed=4, gain=gain)
        result = recalibrate(model, [routine(gain, rounds=3)])
        gains.append(result.gain[channel])
        np.testing.assert_allclose(np.delete(result.gain, channel), 1.0, atol=0.05)
        assert result.problems == ()
        assert error(result.model, later) < 0.9 * error(model, later)
    np.testing.assert_allclose(gains[:2], 1.2, rtol=0.08)
    assert 1.04 < gains[2] < 1.25


def test_poses_shown_less_far_do_not_change_gains(model: TrainedModel) -> None:
    result = recalibrate(model, [routine(shown=0.9)])
    np.testing.assert_allclose(result.gain, 1.0, atol=0.05)


@pytest.mark.parametrize("pose", [1, 2, 3])
def test_one_pose_shown_half_is_not_taken_for_a_gain(model: TrainedModel, pose: int) -> None:
    """Each of these poses strains one cord more than the others do."""
    run = routine()
    is_pose = (run.sample_time >= 5.0 * pose) & (run.sample_time < 5.0 * (pose + 1))
    level = np.where(is_pose, 0.5, 1.0)[:, None]
    result = recalibrate(model, [replace(run, ohm=run.rest * (1 + run.signals * level))])
    np.testing.assert_allclose(result.gain, 1.0, atol=0.08)
    assert result.problems == ()


def test_swapped_and_inverted_cords_are_reported(model: TrainedModel) -> None:
    run = routine()
    swapped = replace(run, ohm=run.ohm[:, [1, 0, 2]])
    with raises(TrainingError, "too-few-poses"):
        recalibrate(model, [swapped])
    other = replace(run, ohm=run.rest * (1 + run.signals * [1.0, 1.0, -1.0]))
    result = recalibrate(model, [other])
    assert result.problems


def test_a_changed_resistance_at_rest_does_not_change_gains(model: TrainedModel) -> None:
    run = routine()
    aged = replace(run, ohm=run.ohm + np.array([0.0, 45.0, 0.0]))
    result = recalibrate(model, [aged])
    np.testing.assert_allclose(result.rest_signals, [0.0, 0.03, 0.0], atol=2e-3)
    np.testing.assert_allclose(result.gain, 1.0, atol=0.05)


def test_a_recording_without_poses_is_refused(model: TrainedModel) -> None:
    run = replace(routine(), poses=((0.0, "rest"), (5.0, "bend")))
    with raises(TrainingError, "too-few-poses", shown=("bend",), incomplete={}):
        recalibrate(model, [run])


def test_undetermined_gains_stay_near_one_and_are_noted(model: TrainedModel) -> None:
    remembering = replace(model, pose_spread=dict.fromkeys(POSES, 0.15))
    for gain in ([1.2, 1.0, 1.0], [0.8, 0.8, 0.8]):
        result = recalibrate(remembering, [routine(gain)])
        assert np.abs(np.log(result.gain)).max() < 0.12
        assert result.change_probability < 0.9
        assert result.notes


def test_usual_differences_between_repetitions_do_not_change_gains(model: TrainedModel) -> None:
    rng = np.random.default_rng(5)
    for seed in range(10):
        run = routine(seed=seed, rounds=3)
        moved = run.signals * (1 + 0.03 * rng.normal(size=3))  # as after a day of drift
        result = recalibrate(model, [replace(run, ohm=run.rest * (1 + moved))])
        np.testing.assert_allclose(result.gain, 1.0, atol=0.08)


def test_the_extreme_of_the_previous_pose_is_not_used(model: TrainedModel) -> None:
    """The user still leaves the previous pose when the next one is requested."""
    run = routine(rounds=2)
    late = replace(run, poses=tuple((at - 2.2 * (at > 0), name) for at, name in run.poses))
    result = recalibrate(model, [late])
    np.testing.assert_allclose(result.gain, 1.0, atol=0.1)
    assert result.problems == ()


def test_poses_that_are_hardly_shown_are_refused(model: TrainedModel) -> None:
    with raises(TrainingError, "too-few-poses", shown=()) as caught:
        recalibrate(model, [routine(shown=0.3)])
    assert caught.value.data["incomplete"]["bend"] == pytest.approx(0.3, abs=0.02)
