"""Decode readings into frames: track the rest, detect faults, and choose a decoder that fits both.

A frame whose readings cannot be decoded repeats the last good positions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import LiveError
from ...decoding.trained_model import (
    UNTRAINED_DISTANCE,
    Decoded,
    TrainedModel,
    decode_inputs,
)
from ...sensing.response import relative_change
from .live_faults import SWAPPED, LiveFault, LiveFaults, SwapWatch, fault_note
from .live_frame import MEASURING_REST, LiveFrame, Note, Quality
from .rest_signals import rest_signals
from .rest_tracker import Rest, RestTracker, drift_note

IMPLAUSIBLE_DISTANCE = 5.0  # readings so far from the training cannot be decoded
_DISTANCE_TIME_CONSTANT_S = 0.3  # of the average that is compared with UNTRAINED_DISTANCE
_MAX_REST_RATIO = 3.0  # times R0 in the training, which no cord of the same length has
_REPLACED_CHANGE = 0.15  # relative change of R0 since the training that is no drift
_IMPLAUSIBLE_TIMEOUT_S = 5.0  # after which R0 is measured again
_REST_NOTE_S = 10.0  # for which a new R0 is reported

_IMPLAUSIBLE = Note(
    "readings-implausible",
    "the readings are implausible: if the device is at rest, leave it for some seconds or press"
    ' "At rest now"',
)
_REST_REMEASURED = (
    "R0 was measured again, because the readings were implausible with the former value"
)
_DRIFT_LIMITED = Note(
    "drift-too-large",
    "the readings at rest have drifted as far as they are followed: let the device rest and press"
    ' "At rest now", or train again',
)
_NOT_SETTLED = Note(
    "cords-not-settled",
    "move the device through all its poses once, then leave it at rest for three seconds: rubber"
    " sets in its first cycles",
)
UNTRAINED = Note(
    "readings-untrained", "the readings are outside the range that the model was trained on"
)
NO_DECODER = Note("no-decoder-without-cord", "the model has no decoder without that cord")
_WAITING = Note(
    MEASURING_REST,
    "leave the device at rest for three seconds while its resistances at rest are measured",
)


@dataclass(frozen=True)
class Reading:
    """The resistances of all cords at one sample of the read-out board.

    Attributes:
        time: Time on the board's clock, s.
        ohms: Resistances (c,), ohm, in the model's order of channels.
        arrived: Time of arrival, s, on this machine's `time.monotonic`.
    """

    time: float
    ohms: Float
    arrived: float


def require_channels(reading: Reading, model: TrainedModel) -> None:
    """Raise a LiveError if a reading has another number of channels than the model."""
    c = len(model.channels)
    if reading.ohms.shape != (c,):
        raise LiveError(
            f"the sample has {reading.ohms.size} channels, the model was trained on {c}"
            f" ({', '.join(model.channels)})",
            code="channels-differ",
            where=model.device,
            action="Connect the channels that the model was trained on, and no others",
            count=reading.ohms.size,
            expected=c,
        )


class LiveDecoder:
    """Decode readings one after another.

    Args:
        model: The trained model.
        rest: Resistances at rest R0 (c,), ohm, if they are known. Otherwise the device must be at
            rest for three seconds first.
        trained_rest: R0 (c,) in the training, ohm, to compare with.
        first_rest_signals: Signals (c,) in the training's first rest, before cords had set.
        follow_drift: Whether R0 follows the drift of the cords.
        fallback: Whether to decode without a cord that fails; otherwise it is only reported.
        is_handled: Whether somebody can move the device and let it rest, and should be asked to.

    Raises:
        LiveError: The number of values of `rest` or `trained_rest` differs from the model's
            channels.
    """

    def __init__(
        self,
        model: TrainedModel,
        rest: Float | None = None,
        trained_rest: Float | None = None,
        *,
        first_rest_signals: Float | None = None,
        follow_drift: bool = True,
        fallback: bool = True,
        is_handled: bool = True,
    ) -> None:
        c = len(model.channels)
        for name, values in (("rest", rest), ("trained_rest", trained_rest)):
            if values is not None and np.shape(values) != (c,):
                raise LiveError(
                    f"has {np.size(values)} values, expected one for each of {c} channels",
                    code="channels-differ",
                    where=name,
                    count=np.size(values),
                    expected=c,
                )
        span = np.maximum(model.main.range.high - model.main.range.low, 1e-6)
        self.model = model
        self._tracker = RestTracker(
            span, rest, first_rest_signals, trained_rest, self._rest_signals
        )
        self._follow_drift = follow_drift
        self._rest_ohms = None if rest is None else np.asarray(rest, float)
        self._trained_rest, self._fallback = trained_rest, fallback
        self._is_handled = is_handled
        self._find_faults, self._swaps = LiveFaults(model.faults, c), SwapWatch(model)
        without: list[str | None] = [None, *(n for n in model.channels if n in model.without)]
        self._streams = {name: model.stream(name) for name in without}  # each with its own past
        self._faults: list[LiveFault] = []
        self._number, self._mean_distance, self._is_rest_requested = 0, 0.0, False
        self._implausible_since = np.inf
        self._restore_rest: Callable[[], None] | None = None
        self._is_restoring = False
        self._rest_note, self._rest_note_until = Note("", ""), -np.inf
        self._last_good: Decoded | None = None
        self._last_inputs: tuple[str | None, Float] | None = None
        self._last_time = -np.inf
        self._ids = tuple(int(i) for i in model.ids)

    @property
    def has_rest(self) -> bool:
        """Whether R0 is known; until then, frames are lost."""
        return self._rest_ohms is not None

    def rest_now(self) -> None:
        """Take the next readings as those at rest. May be called from any thread."""
        self._is_rest_requested = True

    def undo_rest_now(self) -> None:
        """Use R0 as it was before the last `rest_now`. May be called from any thread."""
        self._is_restoring = True

    def __call__(self, reading: Reading) -> LiveFrame | None:
        """Return the frame of a reading, or None if it is not later than the one before.

        Raises:
            LiveError: The reading has another number of channels than the model.
        """
        require_channels(reading, self.model)
        if not reading.time > self._last_time:
            return None
        since, self._last_time = reading.time - self._last_time, reading.time
        ohms = self._unswap(reading.ohms)
        failed = frozenset(f.channel for f in self._faults)
        rest = self._tracker(reading.time, ohms, failed)
        if self._is_restoring:
            rest = self._undo_rest(reading.time)
        elif self._is_rest_requested or self._is_rest_wrong(reading.time, ohms, rest):
            rest = self._set_rest(reading.time, rest, failed)
        if self._rest_ohms is None or self._follow_drift:
            self._use_rest(rest.ohms)
        self._number += 1
        if self._rest_ohms is None:
            return self._frame_before_rest(reading)
        former_pair = self._swaps.pair
        self._swaps(reading.time, reading.ohms, self._rest_ohms)
        if self._swaps.pair != former_pair:
            self._find_faults.reset()
        ohms = self._unswap(reading.ohms)
        readable = np.isfinite(ohms) & (ohms > 0)
        with np.errstate(all="ignore"):
            signals = relative_change(ohms, self._rest_ohms)
        self._faults = self._find_faults(reading.time, ohms, signals)
        return self._decode(reading, since, readable, np.where(readable, signals, np.nan), rest)

    def _use_rest(self, rest: Float | None) -> None:
        """Refer signals, also the remembered ones, to another R0."""
        former, self._rest_ohms = self._rest_ohms, rest
        if former is None and rest is not None:
            self._find_faults.reset()  # its signals so far were relative to R0 in the training
        if former is None or rest is None or np.array_equal(former, rest, equal_nan=True):
            return
        ratio = np.nan_to_num(former / rest, nan=1.0)
        for stream in self._streams.values():
            stream.change_rest(ratio)

    def _rest_signals(self, is_rest: bool) -> Float:
        """Return the signals (c,) of the device at rest; NaN of channels that cannot be read.

        Args:
            is_rest: Whether somebody has said that the device is at rest now: then what the decoder
                does not see is no memory.
        """
        model = self.model
        if not model.main.past.count or self._last_inputs is None:
            return np.zeros(len(model.channels))
        lost, inputs = self._last_inputs
        branch = model.branch(lost)
        signals = np.full(len(model.channels), np.nan)
        if np.isfinite(inputs).all():
            rest, present = model.rest_points.ravel(), inputs[: len(branch.channels)]
            prior = np.zeros(len(present)) if is_rest else present
            signals[list(branch.channels)] = rest_signals(branch, inputs, rest, prior)
        return np.asarray(model.offset + model.gain * signals)

    def _unswap(self, ohms: Float) -> Float:
        return self._swaps.unswap(ohms) if self._fallback else ohms

    def _decode(
        self, reading: Reading, since: float, readable: Bool, signals: Float, rest: Rest
    ) -> LiveFrame:
        model, swapped = self.model, self._swaps.pair
        notes = [fault_note(model.channels, f.kind, (f.channel,)) for f in self._faults]
        if swapped is not None:
            notes.append(fault_note(model.channels, SWAPPED, swapped))
        inputs = {n: s.inputs(reading.time, signals) for n, s in self._streams.items()}
        lost_channel, quality = self._choose_decoder(notes)
        failed = len(self._faults)
        branch, present = model.branch(lost_channel), inputs[lost_channel]
        self._last_inputs = (lost_channel, present)
        now = decode_inputs(branch, present[None], len(self._ids))
        is_far = not now.distance[0] < IMPLAUSIBLE_DISTANCE
        # A single implausible cord has a fault; several that can be read have a wrong R0.
        is_implausible = (
            bool(readable.all()) and swapped is None and (failed > 1 or (is_far and not failed))
        )
        self._implausible_since = (
            min(self._implausible_since, reading.time) if is_implausible else np.inf
        )
        if is_implausible:
            notes.append(_IMPLAUSIBLE)
        if is_far or quality == Quality.LOST or not np.isfinite(now.points).all():
            quality = Quality.LOST
            now = self._last_good or now
        elif now.distance[0] < UNTRAINED_DISTANCE or self._last_good is None:
            self._last_good = now
        self._average_distance(branch.signal_distance(present), since)
        if quality == Quality.TRUSTED and self._mean_distance > UNTRAINED_DISTANCE:
            quality = Quality.UNTRAINED
            notes.append(UNTRAINED)
        if rest.is_drift_limited and quality == Quality.TRUSTED:
            quality = Quality.UNTRAINED
        notes += self._rest_notes(reading.time, rest)
        return self._frame(reading, signals, now, quality, lost_channel, tuple(notes))

    def _choose_decoder(self, notes: list[Note]) -> tuple[str | None, Quality]:
        """Return the channel to decode without, and the quality, by the present faults."""
        is_swapped = self._swaps.pair is not None
        names = [self.model.channels[f.channel] for f in self._faults]
        if not names:
            return None, Quality.FALLBACK if is_swapped else Quality.TRUSTED
        if not self._fallback:
            return None, Quality.FALLBACK
        if len(names) == 1 and names[0] in self._streams:
            return names[0], Quality.FALLBACK
        if len(names) == 1:
            notes.append(NO_DECODER)
        return None, Quality.LOST

    def _rest_notes(self, time: float, rest: Rest) -> list[Note]:
        notes = [_NOT_SETTLED] if self._is_handled and not rest.has_settled else []
        drift = drift_note(self.model.channels, rest.drift)
        notes += [drift] if drift else []
        if rest.is_drift_limited:
            notes.append(_DRIFT_LIMITED)
        if time < self._rest_note_until:
            notes.append(self._rest_note)
        return notes + self._replacement_notes()

    def _average_distance(self, distance: float, since: float) -> None:
        if np.isfinite(distance):
            share = -np.expm1(-since / _DISTANCE_TIME_CONSTANT_S)
            self._mean_distance += (distance - self._mean_distance) * share

    def _is_rest_wrong(self, time: float, ohms: Float, rest: Rest) -> bool:
        """Return whether R0 must be measured again, because it was measured in a pose.

        Then the readings have been implausible for some seconds, are steady, and are nearer to R0
        in the training than R0 is. The readings of swapped plugs are not.
        """
        timeout = time - self._implausible_since > _IMPLAUSIBLE_TIMEOUT_S
        if not self._follow_drift or not rest.is_still or not timeout:
            return False
        if self._trained_rest is None or self._rest_ohms is None:
            return False
        with np.errstate(all="ignore"):
            now, former = np.log(np.array([ohms, self._rest_ohms]) / self._trained_rest)
        return bool(np.abs(now).max() < np.abs(former).max())

    def _set_rest(self, time: float, rest: Rest, failed: frozenset[int]) -> Rest:
        """Take the present readings as those at rest, and report it for some seconds."""
        is_requested, self._is_rest_requested = self._is_rest_requested, False
        self._implausible_since = np.inf
        self._rest_note_until = time + _REST_NOTE_S
        restore = self._tracker.former()
        if not self._tracker.set_now(failed):
            self._rest_note = Note("rest-unchanged", "no cord can be read: R0 is unchanged")
            return rest
        if is_requested:
            self._restore_rest = restore
        skipped = tuple(self.model.channels[c] for c in sorted(failed))
        text = "R0 was set to the present readings" if is_requested else _REST_REMEASURED
        text += f" (except {', '.join(skipped)})" if skipped else ""
        code = "rest-set" if is_requested else "rest-remeasured"
        self._rest_note = Note(code, text, {"skipped": skipped})
        return self._tracker.rest

    def _undo_rest(self, time: float) -> Rest:
        """Restore R0 as it was before the last request, and report it for some seconds."""
        self._is_restoring = self._is_rest_requested = False
        if self._restore_rest is not None:
            self._restore_rest()
            self._restore_rest = None
            self._implausible_since = np.inf
            self._rest_note = Note("rest-restored", "R0 is the former one again")
            self._rest_note_until = time + _REST_NOTE_S
        return self._tracker.rest

    def _replacement_notes(self) -> list[Note]:
        if self._trained_rest is None or self._rest_ohms is None:
            return []
        change = np.nan_to_num(self._rest_ohms / self._trained_rest - 1)
        return [
            Note(
                "cord-replaced",
                f"{name} has changed by {100 * d:+.0f} % at rest since the training: if"
                " its cord was replaced, recalibrate the model",
                {"channel": name, "change": float(d)},
            )
            for name, d in zip(self.model.channels, change, strict=True)
            if abs(d) > _REPLACED_CHANGE
        ]

    def _frame_before_rest(self, reading: Reading) -> LiveFrame:
        """Return a lost frame; cords far from their R0 in the training are open or shorted."""
        c = len(self.model.channels)
        expected = reading.ohms if self._trained_rest is None else self._trained_rest
        with np.errstate(all="ignore"):
            signals = relative_change(reading.ohms, expected)
        is_failed = (signals > _MAX_REST_RATIO - 1) | (signals < 1 / _MAX_REST_RATIO - 1)
        self._faults = self._find_faults(
            reading.time, reading.ohms, np.where(is_failed, signals, 0.0)
        )
        no_radius = np.full((1, len(self._ids)), np.nan)
        now = Decoded(self.model.rest_points[None], no_radius, np.array([np.nan]))
        notes = [fault_note(self.model.channels, f.kind, (f.channel,)) for f in self._faults]
        return self._frame(reading, np.full(c, np.nan), now, Quality.LOST, None, (*notes, _WAITING))

    def _frame(
        self,
        reading: Reading,
        signals: Float,
        now: Decoded,
        quality: Quality,
        lost_channel: str | None,
        notes: tuple[Note, ...],
    ) -> LiveFrame:
        return replace(
            make_frame(self.model, reading, signals, now),
            number=self._number,
            quality=quality,
            lost_channel=lost_channel,
            notes=notes,
        )


def make_frame(model: TrainedModel, reading: Reading, signals: Float, now: Decoded) -> LiveFrame:
    """Return the first frame of a reading, which is trusted, with decoded positions.

    Args:
        model: The model.
        reading: The reading.
        signals: Its signals (c,).
        now: What was decoded from them, for one time.
    """
    return LiveFrame(
        device=model.device,
        number=1,
        time=reading.time,
        arrived=reading.arrived,
        channels=model.channels,
        ohms=reading.ohms,
        signals=signals,
        ids=tuple(model.ids.tolist()),
        markers=now.points[0],
        radius=now.radius[0],
        distance=float(now.distance[0]),
        quality=Quality.TRUSTED,
        targets=model.targets,
    )
