"""Diagnosis of channels from readings that are written by hand, not by the twin."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.capture.board_check.assignment import choose_poses, indistinct_pairs
from defsense_fab.capture.board_check.diagnosis import diagnose, rest_deviation
from defsense_fab.capture.board_check.mains import (
    apparent_frequency,
    choose_sampling,
    fit_hum,
    hum_distance,
)
from defsense_fab.capture.board_check.records import BoardSetup, Change, ExpectedCord, Phase
from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.voltage_divider import conversion_time
from tests.support.errors import raises

RATE_HZ, FULL_SCALE, REFERENCE_OHM = 134, 1024.0, 1000.0


def make_cord(name, ohm, **changes):
    poses = {pose: Change(mean, 0.008) for pose, mean in changes.items()}
    return ExpectedCord(name, ohm, ohm / 1.2, ohm * 1.2, 0.002, 1.0, poses)


CORDS = [make_cord("left", 1000.0, lean=0.06), make_cord("right", 1010.0, lean=-0.06)]
BOARD = BoardSetup(0, FULL_SCALE, 16, np.array([REFERENCE_OHM, REFERENCE_OHM]))


def make_phase(kind, subject, ohm, seconds=4.0, seed=0, extra=None):
    """Return readings of resistances (c,) with a noise of 0.2 %, and additional counts (n, c)."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    noisy = np.array(ohm) * (1 + 0.002 * rng.normal(size=(len(time), len(ohm))))
    counts = FULL_SCALE * noisy / (noisy + REFERENCE_OHM)
    return Phase(kind, subject, time, counts if extra is None else counts + extra(time, rng))


def codes(*phases, cords=CORDS, board=BOARD):
    return [f.code for f in diagnose(cords, board, phases)]


@pytest.mark.parametrize(
    ("ohm", "code"),
    [
        (1000.0, "ok"),
        (1e9, "open"),
        (0.2, "short"),
        (10_100.0, "reference-wrong"),
        (99.0, "reference-wrong"),
        (105_000.0, "saturated"),
        (9.0, "saturated"),
        (1400.0, "rest-off"),
        (700.0, "rest-off"),
    ],
)
def test_resistance_at_rest_decides(ohm, code):
    assert codes(make_phase("rest", "", [ohm, 1010.0])) == [code, "ok"]


def test_wrong_resistor_is_named():
    # With 10 kohm instead of 1 kohm, a cord of 1 kohm reads 100 ohm.
    finding = diagnose(CORDS, BOARD, [make_phase("rest", "", [100.0, 1010.0])])[0]
    assert finding.data["resistor"] == pytest.approx(10_000.0)


def test_channel_without_values_is_not_read():
    phase = make_phase("rest", "", [1000.0, 1010.0])
    phase.counts[::3, 0] = np.nan
    assert codes(phase) == ["not-read", "ok"]
    phase.counts[:, 0] = np.nan
    assert codes(phase) == ["not-read", "ok"]


@pytest.mark.parametrize("mains", [50, 60])
@pytest.mark.parametrize("clock", [0.996, 1.0, 1.004])
def test_hum_is_found_with_a_clock_that_is_off(mains, clock):
    def hum(time, rng):
        return np.stack([3.0 * np.sin(2 * np.pi * mains * clock * time + 1), 0 * time], axis=1)

    findings = diagnose(CORDS, BOARD, [make_phase("rest", "", [1000.0, 1010.0], extra=hum)])
    assert [f.code for f in findings] == ["hum", "ok"]
    assert findings[0].data["hertz"] == mains


def test_white_noise_is_no_hum_and_is_reported_if_large():
    def noise(time, rng):
        return np.stack([3.0 * rng.normal(size=len(time)), 0 * time], axis=1)

    assert codes(make_phase("rest", "", [1000.0, 1010.0], extra=noise)) == ["noisy", "ok"]


def test_false_alarms_of_hum_are_as_rare_as_stated():
    rng = np.random.default_rng(1)
    time = np.arange(5 * RATE_HZ) / RATE_HZ
    chances = [fit_hum(time, rng.normal(size=len(time))).false_alarm for _ in range(100)]
    # At most ten are expected below 0.1; the random numbers are the same on every run.
    assert sum(p < 0.1 for p in chances) <= 20
    assert min(chances) > 1e-6


def test_contact_that_jumps_while_its_wire_moves_is_loose():
    def jumps(time, rng):
        is_open = np.cumsum(rng.random(len(time)) < 0.05) % 2
        return np.stack([10.0 * is_open, 0 * time], axis=1)

    rest = make_phase("rest", "", [1000.0, 1010.0])
    moved = make_phase("wiggle", "left", [1000.0, 1010.0], seed=1, extra=jumps)
    still = make_phase("wiggle", "right", [1000.0, 1010.0], seed=2)
    assert codes(rest, moved, still) == ["loose", "ok"]


def test_smooth_motion_of_the_device_is_not_loose():
    def motion(time, rng):
        return np.stack([5.0 * np.sin(2 * np.pi * 3 * time)] * 2, axis=1)

    rest = make_phase("rest", "", [1000.0, 1010.0])
    moved = make_phase("wiggle", "left", [1000.0, 1010.0], seed=1, extra=motion)
    assert codes(rest, moved) == ["ok", "ok"]


@pytest.mark.parametrize("extent", [0.6, 0.9, 1.1])
def test_exchanged_cords_show_in_a_pose_that_is_held_more_or_less_far(extent):
    rest = make_phase("rest", "", [1000.0, 1010.0])
    change = 0.06 * extent
    right = make_phase("pose", "lean", [1000 * (1 + change), 1010 * (1 - change)], seed=1)
    exchanged = make_phase("pose", "lean", [1000 * (1 - change), 1010 * (1 + change)], seed=1)
    assert codes(rest, right) == ["ok", "ok"]
    findings = diagnose(CORDS, BOARD, [rest, exchanged])
    assert [(f.code, f.others) for f in findings] == [
        ("swapped", ("right",)),
        ("swapped", ("left",)),
    ]


def test_exchanged_cords_of_different_lengths_show_at_rest():
    cords = [make_cord("short", 500.0), make_cord("middle", 1000.0), make_cord("long", 2000.0)]
    board = BoardSetup(0, FULL_SCALE, 16, np.full(3, REFERENCE_OHM))
    turned = make_phase("rest", "", [2000.0, 500.0, 1000.0])
    assert codes(turned, cords=cords, board=board) == ["swapped"] * 3
    finding = diagnose(cords, board, [turned])[0]
    assert finding.others == ("long",)


def test_cord_that_reads_like_another_is_not_exchanged_with_an_open_one():
    cords = [make_cord("short", 500.0), make_cord("long", 1000.0)]
    assert codes(make_phase("rest", "", [1000.0, 1e9]), cords=cords) == ["rest-off", "open"]


def test_connected_pins_have_one_voltage_in_a_pose():
    rest = make_phase("rest", "", [1005.0, 1005.0])
    pose = make_phase("pose", "lean", [1004.0, 1004.0], seed=1)
    findings = diagnose(CORDS, BOARD, [rest, pose])
    assert [(f.code, f.others) for f in findings] == [("short", ("right",)), ("short", ("left",))]


def test_supply_that_is_off_is_named_on_all_channels():
    phase = make_phase("rest", "", [1000.0, 1010.0])
    scaled = Phase("rest", "", phase.time, 1.5 * phase.counts)
    findings = diagnose(CORDS, BOARD, [scaled])
    assert [f.code for f in findings] == ["saturated", "saturated"]
    assert findings[0].data["supply"] == pytest.approx(1.5, rel=0.01)


def test_short_recording_is_refused():
    with raises(CaptureError, "too-few-samples"):
        make_phase("rest", "", [1000.0, 1010.0], seconds=0.1)


def test_poses_are_chosen_only_where_resistances_are_similar():
    different = [make_cord("a", 500.0, lean=0.1), make_cord("b", 1500.0, lean=-0.1)]
    assert choose_poses(different, rest_deviation(different)) == ()
    assert choose_poses(CORDS, rest_deviation(CORDS)) == ("lean",)
    equal = [make_cord("a", 1000.0, lean=0.05), make_cord("b", 1000.0, lean=0.05)]
    deviation = rest_deviation(equal)
    assert choose_poses(equal, deviation) == ()
    assert indistinct_pairs(equal, deviation, ()) == [("a", "b")]


@pytest.mark.parametrize("converter", [0, 1])
@pytest.mark.parametrize("channels", [1, 2, 3, 4, 6, 8, 12, 16])
def test_sampling_is_reached_and_separates_the_mains(converter, channels):
    sampling = choose_sampling(converter, channels, 1 if converter else 16)
    busy = conversion_time(converter, channels, sampling.averages)
    assert sampling.rate * busy < 1
    assert hum_distance(sampling.rate) >= 2.0


def test_apparent_frequencies_are_those_of_samples():
    for frequency, rate in ((50.0, 134), (60.0, 134), (100.0, 65), (120.0, 47)):
        time = np.arange(4000) / rate
        spectrum = np.abs(np.fft.rfft(np.cos(2 * np.pi * frequency * time + 0.3)))
        peak = np.fft.rfftfreq(len(time), 1 / rate)[spectrum.argmax()]
        assert apparent_frequency(frequency, rate) == pytest.approx(peak, abs=rate / 2000)
