"""The memory of printed traces: direction, opened paths, settling, and prints that differ."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.filament_memory import fit, read_readings, repeatability, staircase, terms
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.twin.electronics.contact_network import FITTED_RANGE, ContactNetwork
from defsense_fab.twin.scenes.assumptions import disable_traits, list_assumptions

RATE = 100.0
MEMORY = ContactNetwork()
ALL_TRAITS = {a.trait for a in list_assumptions(MEMORY)}


def only(*traits):
    return disable_traits(MEMORY, ALL_TRAITS - set(traits))


def respond(memory, times, signal, state=None):
    """Return the response (n,) of the typical print, and its state at the end."""
    pieces = disable_traits(memory, {"spread"}).draw(1, np.random.default_rng(0))
    start = state or memory.new_state(1)
    response, end = memory.respond(times, signal[:, None], start, pieces)
    return response[:, 0], end


def ramps(levels, seconds=1.0):
    times = np.arange(0, seconds * (len(levels) - 1) + 1e-9, 1 / RATE)
    return times, np.interp(times, seconds * np.arange(len(levels)), levels)


def loop_share(amplitude):
    """Return the largest difference between straining and returning, over the span, in cycle 10."""
    times, signal = ramps([0, amplitude] * 10 + [0], 2.0)
    response, _ = respond(only("hysteresis"), times, signal)
    up, down = response[-401:-200], response[-201:][::-1]
    return np.abs(up - down).max() / np.ptp(response[-401:])


def test_response_is_ideal_without_any_trait():
    times, signal = ramps([0, 0.3, -0.1, 0.2, 0])
    assert respond(only(), times, signal)[0] == pytest.approx(signal, abs=1e-12)


def test_curvature_raises_resistance_in_tension_and_in_compression():
    times, signal = ramps([-0.2, 0.2])
    response, _ = respond(only("tunneling"), times, signal)
    assert (response - signal)[[0, -1]] == pytest.approx(
        [0.8 * np.expm1(0.04), 1.2 * np.expm1(0.04)]
    )


def test_resistance_is_higher_while_straining_and_rises_again_near_rest():
    times, signal = ramps([0, 0.2, 0], 2.0)
    response, _ = respond(only("hysteresis"), times, signal)
    up, down = response[:200], response[201:401][::-1]
    middle = (signal[:200] > 0.14) & (signal[:200] < 0.17)
    assert (up[middle] - down[middle] > MEMORY.direction).all()
    # A secondary peak: R rises although the trace returns.
    falling = response[200:]
    assert (falling - np.minimum.accumulate(falling)).max() > 0.005
    held = np.append(times, times[-1] + np.arange(1, 600))
    after, _ = respond(only("hysteresis"), held, np.append(signal, np.zeros(599)))
    assert after[len(times)] > 0.02
    assert after[-1] < 0.0


def test_large_signals_have_relatively_less_memory():
    shares = [loop_share(a) for a in (0.05, 0.1, 0.2)]
    assert shares[0] > 1.3 * shares[1]
    assert shares[1] > 1.3 * shares[2] > 0
    assert loop_share(0.02) == pytest.approx(shares[0], rel=0.1)


def test_fast_movement_saturates_the_contacts_that_it_breaks():
    memory = only("relaxation")
    signal_of = lambda times: np.interp(times, [0, 1], [0, 1.0])  # noqa: E731
    times = np.arange(0, 60, 1 / RATE)
    response, _ = respond(memory, times, signal_of(times))
    added = np.log1p(response) - np.log1p(signal_of(times))
    assert 0.5 * memory.broken_limit < added.max() < memory.broken_limit
    assert added[-1] < 0.1 * added.max()
    small = 0.05 * signal_of(times)
    part = np.log1p(respond(memory, times, small)[0]) - np.log1p(small)
    assert part.max() > 1.5 * 0.05 * added.max()


def test_rest_resistance_falls_in_the_first_cycles_and_recovers():
    memory = only("mullins")
    times, signal = ramps([0, 0.1] * 40 + [0])
    response, end = respond(memory, times, signal)
    rest = response[::200]
    assert (np.diff(rest) < 0).all()
    assert rest[-1] == pytest.approx(np.expm1(-memory.settled), rel=0.1)
    assert abs(np.diff(rest)[-1]) < 0.1 * abs(np.diff(rest)[0])
    later = memory.rest_state(end, 24.0)
    fresh, _ = respond(memory, times[:2], signal[:2] * 0, later)
    assert rest[-1] < 0.1 * rest[-1] < fresh[0] < 0


def test_prints_differ_in_their_sizes():
    sizes = MEMORY.draw(4000, np.random.default_rng(0))
    assert np.median(sizes, axis=0) == pytest.approx(
        [MEMORY.direction, MEMORY.opened, MEMORY.broken, MEMORY.settled, MEMORY.softening], rel=0.06
    )
    assert np.log(sizes).std(axis=0) == pytest.approx(np.full(5, 0.88 * MEMORY.spread), rel=0.1)


def test_states_continue():
    times, signal = ramps([0, 0.1, -0.05, 0.2, 0.05, 0.15])
    whole, end = respond(MEMORY, times, signal)
    first, state = respond(MEMORY, times[:251], signal[:251])
    second, last = respond(MEMORY, times[250:], signal[250:], state)
    assert np.concatenate([first, second[1:]]) == pytest.approx(whole, abs=1e-12)
    for a, b in zip(end, last, strict=True):
        assert a == pytest.approx(b, abs=1e-12)


def test_constants_are_those_of_the_published_readings():
    """The terms explain most of what the five sensors show; nearly all of it is not a response."""
    readings, levels = read_readings()
    time, strain, read = staircase(levels)
    u = np.interp(read, time, strain)
    response = np.column_stack([np.ones_like(u), u, u * u])
    added = terms(MEMORY, time, strain, read)
    sizes, share = fit(readings, response, added)
    assert fit(readings, response, added[:, :0])[1] < 0.1
    assert share > 0.7
    expected = [MEMORY.direction, MEMORY.opened, MEMORY.settled]
    assert np.median(sizes, axis=0) == pytest.approx(expected, rel=0.02)
    assert np.median(repeatability(readings)) == pytest.approx(MEMORY.fluctuation, rel=0.02)


def test_each_constant_has_a_source():
    rows = read_rows("filament_memory.csv")
    assert set(rows) == {a.name for a in list_assumptions(MEMORY)}
    assert all(row["basis"] and row["source"] for row in rows.values())
    assert replace(MEMORY, fresh=FITTED_RANGE).new_state(2)[-1] == pytest.approx([FITTED_RANGE] * 2)
