"""Test that arrays in wrong units are refused or noted."""

from dataclasses import replace

import numpy as np
import pytest

import defsense_fab as df
from tests.support.errors import raises


def scaled_dataset(twin, *, length=1.0, time=1.0, ohm=1.0):
    """Return a twin's recording as a dataset of arrays, each quantity times a factor."""
    run = twin.recordings[0]
    times = run.time[::2]
    columns = [np.interp(times, run.sample_time, column) for column in run.ohm.T]
    return df.dataset(
        times * time,
        np.stack(columns, axis=1) * ohm,
        run.points[::2] * length,
        rest_resistances=run.rest * ohm,
        rest_positions=twin.rest_points * length,
        channels=twin.channels,
    )


@pytest.mark.parametrize(
    ("factors", "quantity", "unit"),
    [
        ({"length": 1e-3}, "positions", "m"),
        ({"time": 1 / 3600}, "times", "h"),
        ({"ohm": 1e-3}, "resistances", "kohm"),
    ],
)
def test_other_units_are_refused(twin, layout, factors, quantity, unit):
    data = scaled_dataset(twin, **factors)
    with raises(df.DefsenseError, "wrong-unit", quantity=quantity, unit=unit):
        df.train(data, layout, decoder="affine", is_synchronized=True)


def test_samples_in_another_unit_than_r0_are_refused(twin, model):
    run = twin.recordings[0]
    kiloohm = replace(twin, recordings=(replace(run, ohm=run.ohm * 1e-3),))
    with raises(df.DefsenseError, "wrong-unit", quantity="resistances"):
        df.train(kiloohm, decoder="affine", is_synchronized=True)
    with raises(df.DefsenseError, "wrong-unit", quantity="resistances"):
        model.predict(run.sample_time, run.ohm * 1e-3, run.rest)


@pytest.mark.parametrize(("factors", "unit"), [({"time": 1e3}, " ms"), ({"ohm": 1e-3}, "kiloohm")])
def test_unlikely_units_are_noted(twin, factors, unit):
    model = df.train(scaled_dataset(twin, **factors), decoder="affine", is_synchronized=True)
    assert any(unit in note for note in model.notes)
    assert f"{len(model.notes)} notes" in repr(model)


def test_times_of_a_dataset_must_increase():
    with raises(df.DefsenseError, "times-not-increasing"):
        df.dataset(
            [0, 0],
            [[1.0], [1]],
            np.zeros((2, 1, 3)),
            rest_resistances=[1.0],
            rest_positions=np.zeros((1, 3)),
            channels=["a"],
        )
