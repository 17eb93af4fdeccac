"""Arrays in other units than they should be do not become a model in silence."""

from dataclasses import replace

import numpy as np
import pytest

import defsense_fab as df


def arrays(twin, *, length=1.0, time=1.0, ohm=1.0):
    """What a twin recorded, as arrays, each quantity times a factor."""
    run = twin.recordings[0]
    when = run.time[::2]
    at = np.stack([np.interp(when, run.sample_time, column) for column in run.ohm.T], axis=1)
    return df.dataset(
        when * time, at * ohm, run.points[::2] * length, rest_resistances=run.rest * ohm,
        rest_positions=twin.rest_points * length, channels=twin.channels,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"length": 1e-3}, "are they in metres?"),
        ({"time": 1 / 3600}, "are the times in s?"),
        ({"ohm": 1e-3}, "is not that of this device's cords.* are resistances in kiloohm?"),
    ],
)
def test_other_units_are_refused(twin, layout, factors, message):
    with pytest.raises(df.DefsenseError, match=message):
        df.train(arrays(twin, **factors), layout, decoder="affine", in_step=True)


def test_samples_in_another_unit_than_r0_are_refused(twin, model):
    run = twin.recordings[0]
    kiloohm = replace(twin, recordings=(replace(run, ohm=run.ohm * 1e-3),))
    with pytest.raises(df.DefsenseError, match=r"times smaller than R0.* Give both in ohm"):
        df.train(kiloohm, decoder="affine", in_step=True)
    with pytest.raises(df.DefsenseError, match=r"times smaller than R0.* Give both in ohm"):
        model.predict(run.sample_time, run.ohm * 1e-3, run.rest)


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"time": 1e3}, "are the times in ms? Give times in s"),
        ({"ohm": 1e-3}, "are resistances in kiloohm? Give ohm"),
    ],
)
def test_what_can_hardly_be_is_among_the_notes(twin, factors, message):
    made = df.train(arrays(twin, **factors), decoder="affine", in_step=True)
    assert any(message in note for note in made.notes)
    assert f"{len(made.notes)} notes" in repr(made)
