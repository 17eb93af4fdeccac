"""Relate the read-out board's clock to a camera's, by the board's LED or by motion.

camera = offset + (1 + drift) device, s. The offset includes the camera's delay between an exposure
and its stamp, and for a rolling shutter the LED's position in the image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from .clock_fit import ClockMatch, Clocks, even_frame_times
from .led_likelihood import (
    LedMatch,
    LedStates,
    find_other_shift,
    find_shift,
    normalize_brightness,
    refine_shift,
)
from .led_schedule import MAX_SAMPLE_GAP_S, LedSchedule, check_clock, find_schedule
from .motion_sync import find_lag

MIN_DURATION_S = 5.0  # of both recordings
MIN_TOGGLES = 6
MIN_AGREEMENT = 0.6  # share of the frames that agree with the LED, less those that do not
LOOP_SIGMA_S = 0.3e-3  # standard deviation of where the board's loop puts all toggles
MAX_MOTION_ERROR_S = 0.05
#: Largest errors of an offset that is known beforehand, such as from times of arrival.
MAX_ROUGH_LED_ERROR_S, MAX_ROUGH_MOTION_ERROR_S = 0.35, 1.0


@dataclass(frozen=True)
class Sync:
    """Relation of two clocks: camera = offset + (1 + drift) device, s.

    Attributes:
        offset: Camera time at device time zero, s.
        drift: Relative rate difference.
        offset_sigma: Standard deviation of the offset at the device time `middle`, s.
        drift_sigma: Standard deviation of the drift.
        middle: Device time in the middle of the recording, s.
        error: Largest expected error of a sample's camera time within the recording, s: twice a
            standard deviation at its ends, with the uncertainty of the board's toggles or of the
            cords' lag.
        method: `led` or `motion`.
        evidence: Number of toggles, or the seconds that were compared.
    """

    offset: float
    drift: float
    offset_sigma: float
    drift_sigma: float
    middle: float
    error: float
    method: str
    evidence: float

    def to_camera(self, device: Float) -> Float:
        """Return the camera's times, s, of device times (n,), s."""
        return np.asarray(self.offset + (1 + self.drift) * np.asarray(device))

    def to_device(self, camera: Float) -> Float:
        """Return the device's times, s, of camera times (t,), s."""
        return np.asarray((np.asarray(camera) - self.offset) / (1 + self.drift))


def synchronize_by_led(
    frame_time: Float,
    brightness: Float,
    device_time: Float,
    led: Bool,
    rough: Clocks | float | None = None,
    conversion: float = 0.0,
) -> Sync:
    """Relate the clocks by the board's LED.

    The clock of the samples must not jump; samples may be missing.

    Args:
        frame_time: Stamps of the frames (t,), s.
        brightness: Brightness of the LED in the frames (t,), NaN where not known.
        device_time: Times of the samples (n,), s, as `micros` states them.
        led: Whether the LED was on (n,).
        rough: Clocks or an offset, s, known beforehand to 0.35 s; None if nothing is
            known. Then blinking that never changes is refused.
        conversion: Time that the conversions of a sample take, s (see
            `voltage_divider.conversion_time`). A sample's flag is older than its time by half.

    Raises:
        CaptureError: If a clock goes back, a recording is too short, the LED is not seen to switch,
            or several offsets explain the same frames.
    """
    _check_lengths("frames", frame_time, brightness)
    _check_lengths("samples", device_time, led)
    check_clock("camera", frame_time)
    schedule = find_schedule(device_time, led, conversion)
    expected, limit = _expected(rough), MAX_ROUGH_LED_ERROR_S if rough is not None else None
    _check_durations(frame_time, device_time)
    frames = even_frame_times(frame_time)
    states = normalize_brightness(frames.time, brightness)
    if states is None:
        raise CaptureError(
            "no LED is seen to switch in the images",
            code="led-not-seen",
            where="synchronization",
            action="Turn it to the camera and record again, or synchronize by motion",
        )
    start = find_shift(states, schedule, expected, limit)
    if start is None or start.score < MIN_AGREEMENT:
        range_ = f" at an offset within {limit:g} s of the expected one" if limit else ""
        raise CaptureError(
            f"the light that blinks in the images is not the read-out board's LED{range_}",
            code="led-unrelated",
            where="synchronization",
            action="Check that both files are of one recording, or synchronize by motion",
        )
    match = refine_shift(states, schedule, start, expected.drift)
    _check_match(states, schedule, match, expected, limit)
    # All toggles may be moved together: by a uniform distribution, and by the loop's delay.
    common = float(np.hypot(schedule.slack / np.sqrt(3), LOOP_SIGMA_S))
    lateness = 0.0 if frames.is_even else 3 * match.jitter  # late stamps are all late
    error = 2 * float(np.hypot(match.end_sigma, common)) + lateness
    match = replace(match, sigma=float(np.hypot(match.sigma, common)))
    return _sync(match, "led", error, float(match.toggles))


def synchronize_by_motion(
    frame_time: Float,
    motion: Float,
    device_time: Float,
    signals: Float,
    rough: Clocks | float | None = None,
    max_gap: float | None = MAX_SAMPLE_GAP_S,
) -> Sync:
    """Relate the clocks by motion, without an LED.

    The offset and drift are those at which motion and signals have most in common. The time by
    which the cords lag behind the body cannot be separated from the offset and is not in `error`: a
    lag of 0.1 s in a third of the signal moves the offset by about 30 ms. With cords that lag, only
    the LED gives the offset.

    Args:
        frame_time: Stamps of the frames (t,), s.
        motion: Motion in the frames (t, d), such as main components or distances of aligned
            markers; NaN where not known.
        device_time: Times of the samples (n,), s.
        signals: Signals of the samples (n, c), NaN where not known.
        rough: Clocks or an offset, s, known beforehand to 1 s. None searches all
            offsets at which half of the shorter recording is in both.
        max_gap: Longest gap between samples that is not a jump of the clock, s. None accepts any,
            for clocks that were compared with another.

    Raises:
        CaptureError: If a clock jumps, a recording is too short, nothing moves, motion and signals
            have nothing in common, or several offsets explain the same.
    """
    _check_lengths("frames", frame_time, motion)
    _check_lengths("samples", device_time, signals)
    check_clock("camera", frame_time)
    check_clock("read-out board", device_time, max_gap)
    _check_durations(frame_time, device_time)
    frames = even_frame_times(frame_time)
    motion, signals = (np.asarray(a, float).reshape(len(a), -1) for a in (motion, signals))
    limit = MAX_ROUGH_MOTION_ERROR_S if rough is not None else None
    match = find_lag(frames.time, motion, device_time, signals, _expected(rough), limit)
    error = 2 * match.end_sigma + abs(match.disagreement)
    if error > MAX_MOTION_ERROR_S:
        raise CaptureError(
            f"motion and signals determine the offset only to {1e3 * error:.0f} ms",
            code="offset-uncertain",
            where="synchronization",
            action="Move the device faster and for longer, or put the LED in view",
            error=error,
        )
    return _sync(match, "motion", error, match.span)


def _sync(match: ClockMatch, method: str, error: float, evidence: float) -> Sync:
    return Sync(
        offset=match.middle - (1 + match.drift) * match.device_middle,
        drift=match.drift,
        offset_sigma=match.sigma,
        drift_sigma=match.drift_sigma,
        middle=match.device_middle,
        error=error,
        method=method,
        evidence=evidence,
    )


def _expected(rough: Clocks | float | None) -> Clocks:
    return rough if isinstance(rough, Clocks) else Clocks(float(rough or 0.0), 0.0)


def _check_match(
    states: LedStates,
    schedule: LedSchedule,
    match: LedMatch,
    expected: Clocks,
    within: float | None,
) -> None:
    """Raise CaptureError for a match by few toggles, or if another offset matches as well."""
    if match.toggles < MIN_TOGGLES:
        raise CaptureError(
            f"{match.toggles} toggles of the LED were seen, at least {MIN_TOGGLES} are needed",
            code="too-few-toggles",
            where="synchronization",
            action="Record longer",
            count=match.toggles,
        )
    other = find_other_shift(states, schedule, match, expected, within)
    if other is not None:
        raise CaptureError(
            f"an offset {abs(other):.2f} s {'later' if other > 0 else 'earlier'} explains the"
            " LED's blinking as well",
            code="offset-ambiguous",
            where="synchronization",
            action=(
                "State the offset more closely, or switch the LED off for some seconds while"
                " recording"
            ),
        )


def _check_lengths(name: str, time: Float, values: Float | Bool) -> None:
    if values.ndim < 1 or len(values) != len(time):
        raise CaptureError(
            f"there are {len(time)} times, but {len(values)} {name}",
            code="length-differs",
            where="synchronization",
            action="Pass one time for each value",
            input=name,
        )


def _check_durations(frame_time: Float, device_time: Float) -> None:
    for name, time in (("camera", frame_time), ("read-out board", device_time)):
        if np.ptp(time) < MIN_DURATION_S:
            raise CaptureError(
                f"{np.ptp(time):.1f} s of the {name} are too short, at least {MIN_DURATION_S:g} s"
                " are needed",
                code="recording-too-short",
                where="synchronization",
                action="Record longer",
                clock=name,
            )
