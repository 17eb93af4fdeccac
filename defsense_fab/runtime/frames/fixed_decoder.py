"""Decode readings of a sensor that is no device: relative to a fixed reference, without a rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...decoding.quantities import Readings
from ...decoding.trained_model import (
    UNTRAINED_DISTANCE,
    Decoded,
    TrainedModel,
    decode_inputs,
)
from .live_decoder import (
    IMPLAUSIBLE_DISTANCE,
    NO_DECODER,
    UNTRAINED,
    Reading,
    make_frame,
    require_channels,
)
from .live_faults import LiveFaults, fault_note
from .live_frame import LiveFrame, Note, Quality

_MIN_READING = 1e6  # added to signals: only cords of rubber are shorted by their resistance
_MAX_STEP_BACK_S = 0.2  # of times; larger steps are those of a clock that has restarted
_CLOCK_NOTE_S = 3.0
_CLOCK_RESTARTED = Note(
    "clock-restarted", "the time went back: the readings before are forgotten, as after a restart"
)
_IMPLAUSIBLE = Note(
    "readings-implausible", "the readings are far from those that the model was trained on"
)


class FixedDecoder:
    """Decode readings one after another.

    A channel without a value, or with a fault, is left out if the model has a decoder without it;
    otherwise the last good values are repeated.

    Args:
        model: The trained model.
        readings: Units and reference of its channels.
        fallback: Whether to decode without a channel that fails; otherwise it is only reported.
    """

    has_rest = True  # none is needed

    def __init__(self, model: TrainedModel, readings: Readings, *, fallback: bool = True) -> None:
        self.model = model
        self._readings, self._fallback = readings, fallback
        self._find_faults = LiveFaults(model.faults, len(model.channels))
        without: list[str | None] = [None, *(n for n in model.channels if n in model.without)]
        self._without = without
        self._number, self._last_time, self._clock_note_until = 0, -np.inf, -np.inf
        self._forget()
        self._last_good: Decoded | None = None
        self._ids = tuple(int(i) for i in model.ids)

    def rest_now(self) -> None:
        """Do nothing: the reference of the readings is fixed."""

    def undo_rest_now(self) -> None:
        """Do nothing: the reference of the readings is fixed."""

    def __call__(self, reading: Reading) -> LiveFrame | None:
        """Return the frame of a reading, or None if it is not later than the one before.

        Raises:
            LiveError: The reading has another number of channels than the model.
        """
        model = self.model
        require_channels(reading, model)
        if reading.time < self._last_time - _MAX_STEP_BACK_S:
            self._forget()
            self._clock_note_until = reading.time + _CLOCK_NOTE_S
        if not reading.time > self._last_time:
            return None
        self._last_time = reading.time
        self._number += 1
        signals = self._readings.signals(reading.ohms)
        faults = self._find_faults(reading.time, _MIN_READING + signals, signals)
        failed = {f.channel for f in faults} | set(np.flatnonzero(~np.isfinite(signals)).tolist())
        notes = [fault_note(model.channels, f.kind, (f.channel,)) for f in faults]
        if reading.time < self._clock_note_until:
            notes.append(_CLOCK_RESTARTED)
        lost, quality = self._choose_decoder(sorted(failed), notes)
        inputs = {name: s.inputs(reading.time, signals) for name, s in self._streams.items()}
        branch = model.branch(lost)
        now = decode_inputs(branch, inputs[lost][None], len(self._ids))
        is_far = not now.distance[0] < IMPLAUSIBLE_DISTANCE
        if is_far and not failed:
            notes.append(_IMPLAUSIBLE)
        if is_far or quality is Quality.LOST or not np.isfinite(now.points).all():
            quality, now = Quality.LOST, self._last_good or self._unknown()
        elif now.distance[0] < UNTRAINED_DISTANCE or self._last_good is None:
            self._last_good = now
        is_trained = not branch.signal_distance(inputs[lost]) > UNTRAINED_DISTANCE
        if quality is Quality.TRUSTED and not is_trained:
            quality = Quality.UNTRAINED
            notes.append(UNTRAINED)
        return replace(
            make_frame(model, reading, signals, now),
            number=self._number,
            quality=quality,
            lost_channel=lost,
            notes=tuple(notes),
        )

    def _forget(self) -> None:
        """Forget the readings so far."""
        self._find_faults.reset()
        self._streams = {n: self.model.stream(n) for n in self._without}  # each with its own past
        self._last_time = -np.inf

    def _choose_decoder(self, failed: list[int], notes: list[Note]) -> tuple[str | None, Quality]:
        """Return the channel to decode without, and the quality, by the channels that failed."""
        names = [self.model.channels[k] for k in failed]
        if not names:
            return None, Quality.TRUSTED
        if not self._fallback:
            return None, Quality.FALLBACK
        if len(names) == 1 and names[0] in self._streams:
            return names[0], Quality.FALLBACK
        if len(names) == 1:
            notes.append(NO_DECODER)
        return None, Quality.LOST

    def _unknown(self) -> Decoded:
        """Return unknown targets, before any reading could be decoded."""
        values = np.full((1, *self.model.rest_points.shape), np.nan)
        return Decoded(values, values[..., 0], np.array([np.nan]))


def target_values(frame: LiveFrame) -> dict[str, dict[str, object]]:
    """Return the targets of a frame in plain values; empty for markers.

    Args:
        frame: The frame.

    Returns:
        By name: `value` (a number, or three for positions), `half_width` and `unit`; unknown
        numbers are None.
    """
    if frame.targets is None:
        return {}

    def plain(x: float) -> float | None:
        return round(x, 6) if np.isfinite(x) else None

    out: dict[str, dict[str, object]] = {}
    for k, (name, unit) in enumerate(zip(frame.targets.names, frame.targets.units, strict=True)):
        numbers = [plain(x) for x in frame.markers[k].tolist()]
        value = numbers[0] if frame.targets.axes == 1 else numbers
        out[name] = {"value": value, "half_width": plain(float(frame.radius[k])), "unit": unit}
    return out
