"""The board's and the camera's clocks are synchronized by the LED and by motion."""

import numpy as np
import pytest

from defsense_fab.capture.clocks.clock_fit import Clocks, even_frame_times
from defsense_fab.capture.clocks.led_schedule import LED_PERIOD_MS, find_schedule
from defsense_fab.capture.clocks.synchronization import synchronize_by_led, synchronize_by_motion
from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.voltage_divider import conversion_time
from tests.support.errors import raises
from tests.twin.film import Shutter

pytestmark = pytest.mark.slow

START, OFFSET, DRIFT = 100.0, 0.05, 1e-4


def board(duration, rate, rng, conversion=0.0, period=LED_PERIOD_MS):
    """Return samples' times and flags, and true times of toggles, late by up to a loop's time."""
    t = np.arange(0, duration, 1 / rate)
    t += rng.uniform(0, 2e-4, len(t))
    toggles = rng.uniform(0, 0.7) + np.arange(-3, duration * 1e3 / period) * period / 1e3
    toggles += rng.uniform(0, 1.1e-3, len(toggles))
    led = np.searchsorted(toggles, t) % 2 == 1
    return t + START + conversion / 2, led, toggles


def frames(duration, rng, rate=30.0, jitter=0.003):
    """Return stamps, true times, and which frames repeat the previous image."""
    _, time, stamp, repeats = Shutter(rate, 0, DRIFT, jitter, 0.02, 0.01).schedule(duration, rng)
    return stamp + OFFSET + (1 + DRIFT) * START, time, repeats


def film(duration, toggles, rng, exposure=0.004, noise=0.05, **kw):
    stamp, time, repeats = frames(duration, rng, **kw)
    within = np.linspace(-0.5, 0.5, 21) * exposure
    lit = (np.searchsorted(toggles, time[:, None] + within) % 2).mean(1)
    brightness = 60 + 150 * (lit + noise * rng.standard_normal(len(lit)))
    brightness[1:][repeats[1:]] = brightness[:-1][repeats[1:]]
    return stamp, brightness


def worst(sync, device):
    ends = device[[0, -1]]
    return np.abs(sync.to_camera(ends) - (OFFSET + (1 + DRIFT) * ends)).max()


@pytest.mark.parametrize(("rate", "conversion"), [(20, 0.0), (50, 0.006), (100, 0.0)])
def test_synchronization_by_the_led(rate, conversion):
    rng = np.random.default_rng(rate)
    device, led, toggles = board(60, rate, rng, conversion)
    stamp, brightness = film(60, toggles, rng)
    brightness[500:540] = 60.0  # a hand
    # Samples are stamped half-way through, so their flags are older.
    sync = synchronize_by_led(stamp, brightness, device, led, 0.2, conversion=conversion)
    assert sync.method == "led"
    assert worst(sync, device) < 0.002
    assert worst(sync, device) < sync.error < 0.004
    assert sync.drift == pytest.approx(DRIFT, abs=4e-5)
    assert sync.to_device(sync.to_camera(device)) == pytest.approx(device)


def walk(rng, time, fastest=0.8):
    rate, phase = rng.uniform(0.05, fastest, (2, 30)), rng.uniform(0, 6.28, (2, 30))
    return np.sin(2 * np.pi * rate * time[:, None, None] + phase).sum(2) / 4


@pytest.mark.parametrize("pause", [1.6, 5.3, 10.3, 17.9, 30.2])
def test_missing_samples_are_not_a_jump_of_compared_clocks(pause):
    rng = np.random.default_rng(4)
    device, led, toggles = board(70, 50, rng)
    stamp, brightness = film(70, toggles, rng)
    is_recorded = (device < START + 12) | (device > START + 12 + pause)
    sync = synchronize_by_led(stamp, brightness, device[is_recorded], led[is_recorded], 0.0)
    assert worst(sync, device) < sync.error < 0.003
    both = walk(rng, np.concatenate([stamp - OFFSET, (1 + DRIFT) * device]))
    motion, signals = (b @ rng.standard_normal((2, 3)) for b in np.split(both, [len(stamp)]))
    with raises(CaptureError, "clock-jumps", clock="read-out board"):
        synchronize_by_motion(stamp, motion, device[is_recorded], signals[is_recorded], 0.0)
    sync = synchronize_by_motion(
        stamp, motion, device[is_recorded], signals[is_recorded], 0.0, max_gap=None
    )
    assert worst(sync, device) < 0.008  # stamps that are late by half a frame's jitter


@pytest.mark.parametrize("rate", [20, 100])
def test_synchronization_by_motion(rate):
    rng = np.random.default_rng(rate)
    stamp, time, _ = frames(60, rng)
    device = np.arange(0, 60, 1 / rate)
    both, mix = walk(rng, np.concatenate([time, device])), rng.standard_normal((2, 3))
    motion, signals = both[: len(time)] @ rng.standard_normal((2, 5)), both[len(time) :] @ mix
    motion = motion + 0.02 * rng.standard_normal(motion.shape)
    signals = signals + 0.05 * signals**2 + 0.03 * rng.standard_normal(signals.shape)
    sync = synchronize_by_motion(stamp, motion, device + START, signals, rough=Clocks(-0.2, 0.0))
    assert sync.method == "motion"
    assert worst(sync, device + START) < 0.005
    assert worst(sync, device + START) < 2 * sync.error


@pytest.mark.parametrize("seed", range(3))
def test_motion_that_one_camera_saw_for_some_time(seed):
    """Its depth is wrong for a second, which gives a component of motion of that second alone."""
    rng = np.random.default_rng(seed)
    stamp, time, _ = frames(15, rng, rate=25.0)
    device = np.arange(0, 15, 0.01)
    both = walk(rng, np.concatenate([time, device]))[:, :1]
    # Distances from markers at rest: not linear in how far a marker is out, as signals are.
    motion = np.hypot(6 * both[: len(time)] + 6, [[20.0, 30.0, 40.0, 50.0]])
    alone = ((time > 4) & (time < 5.1))[:, None]
    motion = motion + 0.01 * rng.standard_normal(motion.shape)
    motion = motion + alone * 0.3 * rng.standard_normal(4)
    signals = both[len(time) :] @ rng.standard_normal((1, 2))
    sync = synchronize_by_motion(stamp, motion, device + START, signals, rough=Clocks(-0.2, 0.0))
    assert worst(sync, device + START) < 0.03


def test_inputs_that_cannot_be_synchronized():
    rng = np.random.default_rng(1)
    device, led, toggles = board(30, 50, rng)
    stamp, brightness = film(30, toggles, rng)
    noise = 100 + rng.standard_normal(len(stamp))

    def check_error(code, time=stamp, values=brightness, on=device, flags=led, clock=None, **kw):
        with raises(CaptureError, code, **({"clock": clock} if clock else {})) as error:
            synchronize_by_led(time, values, on, flags, **kw)
        assert "\n" not in str(error.value)

    check_error("led-not-seen", values=noise)
    check_error("led-never-switches", flags=np.zeros(len(led), bool))
    check_error("offset-ambiguous")
    other = film(30, np.cumsum(rng.uniform(0.1, 1.0, 100)), rng)[1][: len(stamp)]
    check_error("led-unrelated", values=np.resize(other, len(stamp)), rough=0.0)
    check_error(
        "clock-goes-back", clock="read-out board", on=np.where(device > 110, device - 5, device)
    )
    check_error("clock-goes-back", clock="camera", time=np.where(stamp > 110, stamp - 5, stamp))
    check_error("recording-too-short", clock="camera", time=stamp[:60], values=brightness[:60])
    check_error("length-differs", values=brightness[:-1])


def test_uninformative_motion():
    rng = np.random.default_rng(2)
    stamp, time, _ = frames(30, rng)
    device = np.arange(0, 30, 0.02)
    motion, signals = walk(rng, time), walk(np.random.default_rng(5), device)
    with raises(CaptureError, "motion-constant"):
        synchronize_by_motion(stamp, np.zeros_like(motion), device + START, signals, 0.0)
    with pytest.raises(CaptureError) as caught:
        synchronize_by_motion(stamp, motion, device + START, signals, 0.0)
    assert caught.value.code in ("motion-unrelated", "offset-ambiguous", "out-of-range")
    beat = np.sin(2 * np.pi * 1.5 * np.concatenate([time, device]))[:, None]
    with raises(CaptureError, "offset-ambiguous"):
        synchronize_by_motion(stamp, beat[: len(time)], device + START, beat[len(time) :], 0.0)


def test_toggles_lie_on_their_grid():
    rng = np.random.default_rng(0)
    device, led, true = board(40, 50, rng)
    toggles = find_schedule(device, led)
    assert np.diff(toggles.time) == pytest.approx(LED_PERIOD_MS / 1e3)
    values = true[(true > toggles.time[0] - START - 0.1) & (true < 40)] + START
    assert toggles.time == pytest.approx(values[: len(toggles.time)], abs=0.0015)
    # If the period is a multiple of the samples', all toggles determine no more than one.
    assert find_schedule(*board(40, 50, rng, period=1000)[:2]).slack > 0.005
    assert conversion_time(0, 3, 16) == pytest.approx(0.006, rel=0.05)
    assert conversion_time(1, 16, 1) == pytest.approx(1 / 85, rel=0.05)


def test_even_frame_times_are_recovered():
    rng = np.random.default_rng(4)
    number, _, stamp, _ = Shutter(30.0, 2.0, 0.0, 0.004, 0.05, 0.0).schedule(30, rng)
    result = even_frame_times(stamp)
    assert result.is_even
    assert result.time == pytest.approx(2 + number / 30, abs=2e-4)
    for seed in range(8):  # many are so late that they seem to be the next one
        rng = np.random.default_rng(seed)
        number, _, stamp, _ = Shutter(60.0, 2.0, 0.0, 0.003, 0.03, 0.0).schedule(40, rng)
        result = even_frame_times(stamp)
        assert result.is_even
        assert result.time == pytest.approx(2 + number / 60, abs=2e-4)
    uneven = np.cumsum(rng.uniform(0.02, 0.05, 500))
    assert not even_frame_times(uneven).is_even
    assert (even_frame_times(uneven).time == uneven).all()


@pytest.mark.parametrize("rate", [29, 27, 25, 24, 22, 20])
@pytest.mark.parametrize("part", [0.1, 0.3])
def test_camera_that_changes_its_rate_is_not_even(rate, part):
    """A longer exposure changes the rate, for example; the stamps stay unchanged."""
    count, rng = 900, np.random.default_rng(rate)
    step = np.where(np.arange(count) >= count * (1 - part), 1 / rate, 1 / 30)
    true = np.cumsum(step)
    stamp = true + np.abs(rng.normal(0, 1e-3, count))
    assert np.abs(even_frame_times(stamp).time - true).max() < 5e-3


def test_extra_stamp_moves_no_frame():
    rng = np.random.default_rng(0)
    true = np.arange(1000) / 30
    true = np.insert(true, 985, true[985] - 0.01)
    stamp = true + np.abs(rng.normal(0, 1e-3, 1001))
    assert np.abs(even_frame_times(stamp).time - true).max() < 6e-3
