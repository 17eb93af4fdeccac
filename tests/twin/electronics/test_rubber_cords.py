"""The twin's rubber cords: asymmetric loops, softening, healing, and each of it switched off."""

import time
from dataclasses import fields

import numpy as np
import pytest

from defsense_fab.decoding.past import Past
from defsense_fab.twin.electronics.rubber_cords import RubberPieces, RubberState, RubberTraits
from defsense_fab.twin.scenes.assumptions import list_assumptions, disable_traits

RATE = 60.0
EVERYTHING = {a.trait for a in list_assumptions(RubberTraits())}
MEMORY = {"relaxation", "hysteresis", "mullins"}


def only(*traits):
    return disable_traits(RubberTraits(), EVERYTHING - set(traits))


def answer(traits, signal, state=None, seed=0):
    """(R - R0)/R0 (n,) of one piece of 1 kohm, and how it is then."""
    pieces = RubberPieces.drawn(traits, np.array([1000.0]), np.random.default_rng(seed))
    begin = state or RubberState.new(traits, 1)
    moments = np.arange(len(signal)) / RATE
    ohm, end = pieces.resistances(moments, signal[:, None], begin, np.random.default_rng(seed))
    return ohm[:, 0] / pieces.ohm[0] - 1, end


def cycles(size, period, count):
    turn = np.arange(round(count * period * RATE)) / RATE / period % 1
    return size * (1 - np.abs(2 * turn - 1))


def test_without_memory_a_cord_answers_as_the_ideal_one():
    signal = cycles(0.3, 2.0, 3) - 0.1
    assert answer(only(), signal)[0] == pytest.approx(signal, abs=1e-12)


def loop(traits, period=4.0):
    """The fourth cycle: strains that rise, and what the cord says on the way out and back there."""
    signal = cycles(0.2, period, 5)
    said, half = answer(traits, signal)[0], round(period * RATE / 2)
    out = slice(6 * half, 7 * half)
    back = slice(7 * half, 8 * half)
    s = np.linspace(0.02, 0.18, 50)
    return (
        s, np.interp(s, signal[out], said[out]), np.interp(s, signal[back][::-1], said[back][::-1])
    )  # fmt: skip


@pytest.mark.parametrize("trait", ["relaxation", "hysteresis"])
def test_loops_are_asymmetric(trait):
    """The way back is no mirror image of the way out: of a linear filter (and of gears that have
    equal play both ways) it is, about their common middle. Friction holds the way out above the
    way back; what heals is above it at the far end, and below near rest, where it reads too
    high."""
    s, out, back = loop(only(trait))
    assert out[-1] > back[-1]
    assert (out > back).all() == (trait == "hysteresis")
    up, down = out - s, back - s
    middle = (up.mean() + down.mean()) / 2
    mirrored = -(down[::-1] - middle) + middle
    assert np.abs(up - mirrored).max() > 0.05 * np.abs(up - down).max()
    linear = Past(moved=(4.0,))(np.arange(1200) / RATE, cycles(0.2, 4.0, 5)[:, None])[:, 1]
    cycle = linear[-240:] - linear[-240:].mean()
    assert cycle[120:] == pytest.approx(-cycle[:120], abs=3e-3 * np.abs(cycle).max() + 1e-3)


def test_no_memories_of_the_signal_undo_it():
    """What is left after a fit by many exponential memories and rates of the signal."""
    rng = np.random.default_rng(1)
    knots = np.r_[0, rng.uniform(0, 0.3, 200)]
    signal = np.interp(np.arange(0, 300, 1 / RATE), np.linspace(0, 300, 201), knots)
    said, _ = answer(only(*MEMORY), signal)
    past = Past(moved=(0.2, 1.0, 5.0, 25.0), worked=(0.2, 1.0, 5.0, 25.0))
    known = past(np.arange(len(signal)) / RATE, signal[:, None])
    A = np.column_stack([known, np.ones(len(signal))])
    left = said - A @ np.linalg.lstsq(A, said, rcond=None)[0]
    assert left.std() > 0.02 * (said - signal).std()
    assert left.std() > 1e-3


def test_the_first_stretch_is_not_like_the_second():
    signal = cycles(0.2, 4.0, 3)
    said, end = answer(only("mullins"), signal)
    at = round(RATE)  # half way up
    first, second, third = (said[at + k * round(4 * RATE)] for k in range(3))
    assert first > 1.05 * second
    assert third == pytest.approx(second, rel=1e-3)
    top = round(2 * RATE)
    assert said[top] == pytest.approx(said[top + round(4 * RATE)], rel=1e-2)
    farther, _ = answer(only("mullins"), cycles(0.3, 4.0, 1), end)
    assert farther.max() == pytest.approx(0.3 * 1.12, rel=0.02)
    traits = only("mullins")
    again, _ = answer(traits, signal, end.rested(traits, 100.0))
    assert again[at] == pytest.approx(first, rel=1e-3)


def test_after_release_it_reads_too_high_and_decays_in_minutes():
    """As the data sheet of the paper's supplier says of a stretch of 50 % (s = 1)."""
    t = np.arange(0, 300, 1 / RATE)
    said, _ = answer(only("relaxation"), np.interp(t, [0, 5, 6, 66, 67, 300], [0, 0, 1, 1, 0, 0]))
    released = said[t >= 67.05]
    assert 0.05 < released[0] < 0.15
    assert 0.001 < released[round(60 * RATE)] < 0.02
    assert (np.diff(released) < 0).all()
    held = said[(t > 6) & (t < 66)]
    assert held[0] > held[-1] > 1


def test_drift_temperature_and_ageing_change_the_rest():
    hour, still = np.arange(3601.0), np.zeros((3601, 400))

    def after(trait):
        rng = np.random.default_rng(0)
        pieces = RubberPieces.drawn(only(trait), np.full(400, 1000.0), rng)
        return pieces.resistances(hour, still, RubberState.new(only(trait), 400), rng)[0][-1]

    assert np.std(after("drift") / 1000) == pytest.approx(np.hypot(0.004, 0.006), rel=0.1)
    warmer = after("temperature") / 1000 - 1
    assert np.ptp(warmer) == 0
    assert warmer[0] == pytest.approx(0.003 * 2.0 * (1 - 0.5**3), abs=0.003)
    old = RubberPieces(only("ageing"), np.array([1000.0]), np.zeros(1), age=10.0)
    state = RubberState.new(old.traits, 1)
    ohm, _ = old.resistances(
        np.arange(2.0), np.array([[0.0], [0.1]]), state, np.random.default_rng(0)
    )
    assert ohm[:, 0] == pytest.approx([1040.0, 1040 * (1 + 0.1 * 0.98)])


@pytest.mark.parametrize("trait", sorted(EVERYTHING))
def test_each_trait_does_something_and_can_be_switched_off(trait):
    signal = cycles(0.2, 4.0, 3)
    whole, without_it = RubberTraits(), disable_traits(RubberTraits(), {trait})

    def ohm(traits):
        rng = np.random.default_rng(3)
        drawn = RubberPieces.drawn(traits, np.array([1000.0]), rng)
        pieces = RubberPieces(traits, drawn.ohm, drawn.trend, age=5.0)
        begin = RubberState.new(traits, 1)
        return pieces.resistances(np.arange(len(signal)) / RATE, signal[:, None], begin, rng)[0]

    assert np.abs(ohm(whole) - ohm(without_it)).max() > 1e-3
    assert ohm(whole) == pytest.approx(ohm(RubberTraits()), abs=0)


def test_every_number_has_a_source():
    told = list_assumptions(RubberTraits())
    assert len(told) == len(fields(RubberTraits))
    assert all(a.source and a.meaning for a in told)


def test_ten_minutes_of_three_cords_take_no_second():
    t = np.arange(36000) / RATE
    signals = 0.1 * np.abs(np.sin(t[:, None] * [0.3, 0.5, 0.7]))
    traits = RubberTraits()
    pieces = RubberPieces.drawn(traits, np.full(3, 1000.0), np.random.default_rng(0))
    state, rng = RubberState.new(traits, 3), np.random.default_rng(0)
    pieces.resistances(t[:10], signals[:10], state, rng)
    begun = time.process_time()
    pieces.resistances(t, signals, state, rng)
    assert time.process_time() - begun < 0.5
