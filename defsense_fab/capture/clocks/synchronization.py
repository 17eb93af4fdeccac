"""How the read-out board's clock and a camera's go together: by the read-out board's LED, or by
what moves.

camera = offset + (1 + drift) * device, s. What a camera adds between an exposure and its stamp is
in the offset, and so is, of a rolling shutter, the place of the LED in the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from .clock_fit import Clocks, even_frame_times
from .led_likelihood import normalise, posterior, shift_of, shifts_alike
from .led_schedule import PAUSE, check_clock, find_schedule
from .motion_sync import find_lag

_SHORTEST = 5.0  # s that both clocks must have in common
_FEWEST = 6  # toggles
_AGREE = 0.6  # frames that are as the read-out board says, less those that are not: of all
_LOOP = 0.3e-3  # s, standard deviation of where the read-out board's loop puts all toggles
_MOST_ERROR = 0.05  # s: what is known less well is not known


@dataclass(frozen=True)
class Sync:
    """camera = offset + (1 + drift) device, s. Standard deviations: `offset_sigma` s at the
    device's time `middle` s, `drift_sigma`; `error` s: what the camera's time of a sample may be
    wrong by within the recording, twice a standard deviation at its ends, with what is unsure about
    the read-out board's toggles or the cords' lag. `method`: led or motion; `evidence`: the toggles
    seen, or the seconds compared."""

    offset: float
    drift: float
    offset_sigma: float
    drift_sigma: float
    middle: float
    error: float
    method: str
    evidence: float

    def to_camera(self, device: Float) -> Float:
        """The camera's time, s, at device times (n,), s."""
        return np.asarray(self.offset + (1 + self.drift) * np.asarray(device))

    def to_device(self, camera: Float) -> Float:
        """The device's time, s, at times (t,), s, of the camera."""
        return np.asarray((np.asarray(camera) - self.offset) / (1 + self.drift))


def by_led(
    frame_time: Float,
    brightness: Float,
    exposure: float | None,
    device_time: Float,
    led: Bool,
    rough: Clocks | float | None = None,
    within: float = 0.35,
    conversion: float = 0.0,
    pause: float | None = PAUSE,
) -> Sync:
    """From the LED's `brightness` (t,) in frames with stamps (t,) s, NaN where not known, and its
    flags (n,) in samples with times (n,) s: what `micros` said. `exposure` s; None: found from
    frames in which the LED switched. `rough`: clocks or an offset known beforehand to `within` s;
    None: none is known, and a blinking that never changes is refused. `conversion` s that the
    conversions of a sample take (`readout.conversion_time`): half of it is what a sample's flag is
    older than its time. A longer `pause` s between samples is taken for a jump of the clock; None:
    for a pause, where it was compared with another clock's.

    Raises CaptureError for clocks that jump, too short a recording, no toggles in either, and where
    several offsets explain the same."""
    _check_pair("frames", frame_time, brightness)
    _check_pair("samples", device_time, led)
    check_clock("camera", frame_time)
    toggles = find_schedule(device_time, led, conversion, pause)
    before = _clocks(rough)
    _check_length(frame_time, device_time)
    frames = even_frame_times(frame_time)
    lit = normalise(frames.time, brightness)
    if lit is None:
        raise CaptureError(
            "synchronise: no LED is seen to switch in the images; turn it to the camera and record"
            " again, or go without it, by motion",
            code="led-not-seen",
        )
    start = shift_of(lit, toggles, before, within if rough is not None else None)
    if start is None or start.score < _AGREE:
        raise CaptureError(
            "synchronise: what blinks in the images is not the read-out board's LED"
            + (f" at an offset within {within:g} s of what was expected" if rough else "")
            + "; check that both are of one recording, or go without it, by motion",
            code="led-unrelated",
        )
    found = posterior(lit, toggles, start, exposure, before.drift)
    if found.toggles < _FEWEST:
        raise CaptureError(
            f"synchronise: {found.toggles} toggles of the LED were seen, {_FEWEST} are needed;"
            " record longer",
            code="toggles-too-few",
            count=found.toggles,
        )
    reach = within if rough is not None else None
    other = shifts_alike(lit, toggles, found, before, reach)
    if other is not None:
        raise CaptureError(
            f"synchronise: an offset {abs(other):.2f} s {'later' if other > 0 else 'earlier'}"
            " explains the LED's blinking as well; give the offset more closely, or switch the LED"
            " off for some seconds while recording",
            code="offset-ambiguous",
        )
    half = found.span / 2
    spread = float(np.hypot(found.shift_sigma, found.drift_sigma * half))
    # Where one toggle may be, all may: a uniform distribution; the loop is late as well.
    same = float(np.hypot(toggles.slack / np.sqrt(3), _LOOP))
    spread = float(np.hypot(spread, same))
    unsteady = 0.0 if frames.even else 3 * found.jitter  # late stamps: all in one sense
    offset = found.middle + found.shift - (1 + found.drift) * found.device_middle
    sigma = float(np.hypot(found.shift_sigma, same))
    return Sync(
        offset, found.drift, sigma, found.drift_sigma, found.device_middle,
        2 * spread + unsteady, "led", float(found.toggles),
    )  # fmt: skip


def by_motion(
    frame_time: Float,
    motion: Float,
    device_time: Float,
    signals: Float,
    rough: Clocks | float | None = None,
    within: float = 1.0,
    pause: float | None = PAUSE,
) -> Sync:
    """Without an LED: from `motion` (t, d) of frames with stamps (t,) s, as main components or
    distances of aligned markers, and `signals` (n, c) of samples with times (n,) s; NaN where not
    known. The offset and drift at which they have most in common; the offset is looked for within
    `within` s of `rough` (None: at all at which half of the shorter recording is in both). `pause`
    as in `by_led`.

    What the cords lag behind the body is not told from the offset, and not in `error`: a lag of
    0.1 s in a third of the signal moves it by some 30 ms. With cords that lag only the LED tells.

    Raises CaptureError for clocks that jump, too short a recording, and where nothing moves, or
    motion and signals have nothing in common, or several offsets explain the same."""
    _check_pair("frames", frame_time, motion)
    _check_pair("samples", device_time, signals)
    check_clock("camera", frame_time)
    check_clock("read-out board", device_time, pause)
    _check_length(frame_time, device_time)
    frames = even_frame_times(frame_time)
    motion, signals = (np.asarray(a, float).reshape(len(a), -1) for a in (motion, signals))
    before = _clocks(rough)
    found = find_lag(
        frames.time, motion, device_time, signals, before, within if rough is not None else None
    )
    spread = float(np.hypot(found.shift_sigma, found.drift_sigma * found.span / 2))
    error = 2 * spread + abs(found.disagree)
    if error > _MOST_ERROR:
        raise CaptureError(
            f"synchronise: motion and signals tell the offset to {1e3 * error:.0f} ms only; move"
            " the device faster and for longer, or put the LED in view",
            code="offset-uncertain",
            error=error,
        )
    offset = found.middle + found.shift - (1 + found.drift) * found.device_middle
    return Sync(
        offset, found.drift, found.shift_sigma, found.drift_sigma, found.device_middle, error,
        "motion", found.span,
    )  # fmt: skip


def _clocks(rough: Clocks | float | None) -> Clocks:
    return rough if isinstance(rough, Clocks) else Clocks(float(rough or 0.0), 0.0, 0.0)


def _check_pair(name: str, time: Float, values: Float | Bool) -> None:
    if values.ndim < 1 or len(values) != len(time):
        raise CaptureError(
            f"synchronise: {len(time)} times do not go with {len(values)} {name}",
            code="length-differs",
            input=name,
        )


def _check_length(frame_time: Float, device_time: Float) -> None:
    for name, time in (("camera", frame_time), ("read-out board", device_time)):
        if np.ptp(time) < _SHORTEST:
            raise CaptureError(
                f"synchronise: {np.ptp(time):.1f} s of the {name}, {_SHORTEST:g} s are needed;"
                " record longer",
                code="recording-too-short",
                clock=name,
            )
