"""Checks of units; only impossible values forbid training."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset_checks import require_trainable
from defsense_fab.training.data.unit_checks import (
    check_cord_resistance,
    check_resistance_unit,
    check_units,
)
from tests.support.errors import raises
from tests.training.synthetic import dataset


@pytest.fixture(scope="module")
def good():
    return dataset()


def changed(data, *, length=1.0, time=1.0, ohm=1.0):
    """Return the dataset with each quantity times a factor."""
    runs = [
        replace(
            r,
            points=r.points * length,
            sigma=r.sigma * length,
            time=r.time * time,
            sample_time=r.sample_time * time,
            ohm=r.ohm * ohm,
            rest=r.rest * ohm,
        )
        for r in data.recordings
    ]
    return replace(data, rest_points=data.rest_points * length, recordings=tuple(runs))


@pytest.mark.parametrize(
    ("factors", "data"),
    [
        ({"length": 1e-3}, {"quantity": "positions", "unit": "m"}),
        ({"length": 1e3}, {"quantity": "positions", "unit": "um"}),
        ({"time": 1 / 3600}, {"quantity": "times", "unit": "h"}),
        ({"time": 1e6}, {"quantity": "times", "unit": "ms"}),
    ],
)
def test_impossible_values_forbid_training(good, factors, data):
    with raises(TrainingError, "wrong-unit", **data):
        require_trainable(changed(good, **factors))


@pytest.mark.parametrize(
    ("factors", "data"),
    [
        ({"time": 1e3}, {"quantity": "times", "unit": "ms"}),
        ({"ohm": 1e-3}, {"quantity": "resistances", "unit": "kohm"}),
    ],
)
def test_unlikely_values_are_reported(good, factors, data):
    problems = check_units(changed(good, **factors))
    assert problems
    assert not any(p.is_fatal for p in problems)
    assert problems[0].code == "wrong-unit"
    assert problems[0].data == data


def test_correct_units_are_not_reported(good):
    assert check_units(good) == []
    for factors in ({"length": 0.1}, {"length": 10}, {"time": 0.1}, {"time": 10}, {"ohm": 0.1}):
        assert check_units(changed(good, **factors)) == []


def test_kiloohm_of_known_cords_forbids_training(good):
    (problem,) = check_cord_resistance(changed(good, ohm=1e-3), shortest_ohm=290.0)
    assert problem.is_fatal
    assert problem.data == {"quantity": "resistances", "unit": "kohm", "shortest_ohm": 290.0}
    assert check_cord_resistance(good, shortest_ohm=290.0) == []
    assert check_cord_resistance(good, shortest_ohm=0.0) == []


@pytest.mark.parametrize("ohm", [1e-3, 1e3])
def test_samples_in_another_unit_than_r0_forbid_training(good, ohm):
    runs = [replace(r, ohm=r.ohm * ohm) for r in good.recordings]
    runs[1].ohm[:, 0] = np.nan  # a broken channel does not hide it
    first = (runs[0].name,)
    with raises(TrainingError, "wrong-unit", count=2, recordings=first, unit="kohm") as caught:
        require_trainable(replace(good, recordings=tuple(runs)))
    assert caught.value.data["value"] == pytest.approx(ohm, rel=0.3)


@pytest.mark.parametrize("broken", [np.nan, 0.0, 1.0, 1e6])
def test_a_broken_channel_is_not_taken_for_another_unit(good, broken):
    run = good.recordings[0]
    ohm = run.ohm.copy()
    ohm[:, 0] = broken
    assert check_resistance_unit(ohm, run.rest) == []
    assert check_resistance_unit(np.full_like(ohm, np.nan), run.rest) == []
    assert check_resistance_unit(ohm[:0], run.rest) == []


def test_resistances_in_units_of_r0_are_not_checked(good):
    runs = tuple(replace(r, ohm=r.ohm / r.rest, rest=np.ones_like(r.rest)) for r in good.recordings)
    relative = replace(good, recordings=runs)
    assert check_units(relative) == check_cord_resistance(relative, shortest_ohm=290.0) == []


def test_a_single_far_position_and_a_long_pause_are_accepted(good):
    run = good.recordings[0]
    points, time = run.points.copy(), run.time.copy()
    points[3, 0] = 2e4
    time[len(time) // 2 :] += 50 * 86400
    assert check_units(replace(good, recordings=(replace(run, points=points, time=time),))) == []


def test_unknown_positions_are_accepted(good):
    run = replace(good.recordings[0], points=np.full_like(good.recordings[0].points, np.nan))
    assert check_units(replace(good, recordings=(run,))) == []
