"""How cords respond, measured from signals and targets."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.evaluation.cord_character import (
    TwinLikeness,
    ideal_signals,
    measure_character,
    target_terms,
)
from defsense_fab.twin.electronics.hysteretic_memory import HystereticMemory

RATE = 50.0


def make_dataset(respond, seconds=240.0, seed=0):
    """Return a dataset of one marker that moves 0-30 mm, and a cord's response to it."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / RATE)
    knots, levels = [0.0], [0.0]
    while knots[-1] < seconds:
        knots += [knots[-1] + rng.uniform(0.3, 2.0)]
        levels += [rng.uniform(0, 1)]
        knots += [knots[-1] + rng.choice([0.2, 3.0])]
        levels += [levels[-1]]
    x = np.interp(time, knots, levels)
    points = np.zeros((len(time), 1, 3))
    points[:, 0, 0] = 30 * x
    signal = respond(time, 0.3 * x) + 1e-4 * rng.normal(size=len(time))
    ohm = 1000 * (1 + signal[:, None])
    run = Recording(
        "run-1", "a", "1", time, ohm, np.array([1000.0]), time, points, np.full_like(points, 0.1)
    )
    return Dataset("d", "", ("a",), np.arange(1), points[0], (run,))


def measure(data):
    return measure_character(data, ideal_signals(data, target_terms(data)))


def character(respond, **options):
    data = make_dataset(respond, **options)
    return measure(data)


def lag(time, s, constant):
    out = np.empty_like(s)
    out[0] = s[0]
    for k in range(1, len(s)):
        out[k] = out[k - 1] + (s[k] - out[k - 1]) * (
            1 - np.exp(-(time[k] - time[k - 1]) / constant)
        )
    return out


def play(time, s):
    out, y = np.empty_like(s), 0.0
    for k, v in enumerate(s):
        y = min(max(y, v - 0.012), v + 0.012)
        out[k] = y
    return out


def test_cords_without_memory_show_noise_only():
    plain = character(lambda time, s: s + s**2)
    assert plain.noise == pytest.approx(1e-4 / 0.38, rel=0.2)
    assert max(plain.hysteresis, plain.rate, plain.after_step, plain.drift) < 0.003


def test_play_is_hysteresis_and_a_trend_is_drift():
    measured = character(play)
    assert measured.hysteresis == pytest.approx(0.024 / 0.29, rel=0.25)
    assert measured.after_step < 0.01  # the marker creeps in some of the pauses
    drifting = character(lambda time, s: s + 0.003 * time / 60)
    assert drifting.drift == pytest.approx(0.01, rel=0.1)
    assert drifting.hysteresis < 0.005


def test_lag_depends_on_speed_and_shows_after_a_stop():
    measured = character(lambda time, s: 0.8 * s + 0.2 * lag(time, s, 2.0))
    assert measured.after_step > 0.02
    assert measured.hysteresis > 0.02
    assert character(lambda time, s: 0.9 * s + 0.1 * lag(time, s, 2.0)).after_step == pytest.approx(
        measured.after_step / 2, rel=0.2
    )


def test_fitted_cords_show_more_hysteresis_than_noise():
    memory = HystereticMemory(spread=0.0)

    def respond(time, s):
        pieces = memory.draw(1, np.random.default_rng(0))
        return memory.respond(time, s[:, None], memory.new_state(1), pieces)[0][:, 0]

    measured = character(respond)
    assert 0.03 < measured.hysteresis < 0.4
    assert measured.rate > 0.02


def test_hidden_markers_open_channels_and_short_runs():
    data = make_dataset(play)
    run = data.recordings[0]
    points, ohm = run.points.copy(), np.column_stack([run.ohm, run.ohm])
    points[100:200] = np.nan
    ohm[300:400, 1] = np.nan
    run = replace(run, points=points, ohm=ohm, rest=np.array([1000.0, 1000.0]))
    data = replace(data, channels=("a", "b"), recordings=(run,))
    measured = measure(data)
    assert measured.hysteresis == pytest.approx(0.024 / 0.29, rel=0.3)
    brief = make_dataset(play, seconds=10.0)
    assert measure(brief) is None
    silent = replace(run, ohm=np.full_like(ohm, np.nan))
    silent = replace(data, recordings=(silent,))
    assert ideal_signals(silent, target_terms(silent)) is None


def test_sentences_leave_out_what_is_unknown():
    measured = replace(character(play), after_step=np.nan)
    alone = TwinLikeness(measured, {})
    assert len(alone.sentences) == 4
    assert not any("twins" in text for text in alone.sentences)
    low, high = measured, replace(measured, hysteresis=0.12)
    with_twins = TwinLikeness(measured, {"hysteretic": (low, high)}).sentences
    assert "12" in with_twins[0]
    assert "hysteretic" in with_twins[0]
