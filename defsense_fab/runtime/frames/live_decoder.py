"""From a sample of the read-out board to a frame: rest and drift, faults, the decoder that is fit
for both, and how far it is to be believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import LiveError
from ...decoding.trained_model import Decoded, TrainedModel, decoded
from ...sensing.response import relative_change
from .live_faults import SWAPPED, LiveFault, LiveFaults, SwapWatch, fault_told
from .live_frame import LiveFrame, Quality
from .rest_tracker import Rest, RestTracker, drift_told

_UNTRAINED = 1.5  # distance from the training; of its own, 1 % lie beyond 1
_ABSURD = 5.0  # such a distance is no shape that the decoder can tell anything of
_SMOOTH = 0.3  # s over which the distance is averaged for that
_GROSS = 3.0  # times R0 in training, which no cord of the same length has
_REPLACED = 0.15  # relative change of R0 from the training's that is no drift
_PATIENCE = 5.0  # s of readings that make no sense, after which R0 is measured anew
_SAID = 10.0  # s, for which that is told
_NONSENSE = (
    "the readings make no sense: if the device is at rest, let it lie for some seconds, or say so"
    ' ("At rest now")'
)
_MEASURED_ANEW = "R0 was measured anew, since by the former one the readings made no sense"
_DRIFTED_FAR = (
    "the rest reading has drifted as far as it is followed: let the device rest and say so"
    ' ("At rest now"), or train again'
)
_SETTLE = (
    "move the device through all its poses once, then leave it at rest for two seconds: rubber sets"
    " in its first cycles"
)


@dataclass(frozen=True)
class Sample:
    """One of the read-out board: its clock `time` (s), resistances (c,) ohm in the model's order of
    channels, and when it arrived (s, `time.monotonic`)."""

    time: float
    ohms: Float
    arrived: float


class LiveDecoder:
    """Decodes samples one after another. `rest` (c,): R0 in ohm where it is known; otherwise the
    device must lie at rest for two seconds first. `trained_rest` (c,) is that of the training, to
    compare with; `lying` (c,) what signals were in its first rest, before cords had set. Without
    `fallback` a cord that fails is told, and nothing else is done."""

    def __init__(
        self, model: TrainedModel, rest: Float | None = None, trained_rest: Float | None = None,
        *, lying: Float | None = None, track: bool = True, fallback: bool = True,
    ) -> None:  # fmt: skip
        c = len(model.channels)
        for name, values in (("rest", rest), ("trained_rest", trained_rest), ("lying", lying)):
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
        self._rest, self._fixed = RestTracker(span, rest, lying, trained_rest), not track
        self._rest_ohms = None if rest is None else np.asarray(rest, float)
        self._trained_rest, self._fallback = trained_rest, fallback
        self._faults, self._swaps = LiveFaults(model.faults, c), SwapWatch(model)
        lost: list[str | None] = [None, *(n for n in model.channels if n in model.without)]
        self._streams = {name: model.stream(name) for name in lost}  # each with its own past
        self._found: list[LiveFault] = []
        self._number, self._distance, self._rest_asked = 0, 0.0, False
        self._absurd_since, self._said = np.inf, (-np.inf, "")
        self._last: Decoded | None = None
        self._last_time = -np.inf
        self._ids = tuple(int(i) for i in model.ids)

    @property
    def rested(self) -> bool:
        """Whether R0 is known: before that, frames are lost."""
        return self._rest_ohms is not None

    def rest_now(self) -> None:
        """The device is at rest at this moment: R0 is what it reads. From any thread."""
        self._rest_asked = True

    def __call__(self, sample: Sample) -> LiveFrame | None:
        """The frame; None for a sample that is not later than the one before. Raises
        LiveError for another number of channels than the model has."""
        model, c = self.model, len(self.model.channels)
        if sample.ohms.shape != (c,):
            raise LiveError(
                f"the sample has {sample.ohms.size} channels, the model was trained on {c}"
                f" ({', '.join(model.channels)})",
                code="channels-differ",
                where=model.device,
                action="Connect the cords that the model was trained on, and no others",
                count=sample.ohms.size,
                expected=c,
            )
        if not sample.time > self._last_time:
            return None
        since, self._last_time = sample.time - self._last_time, sample.time
        ohms = self._exchanged(sample.ohms)
        lost = frozenset(f.channel for f in self._found)
        rest = self._rest(sample.time, ohms, lost)
        if self._rest_asked or self._nonsense(sample.time, ohms, rest):
            rest = self._set_rest(sample.time, rest, lost)
        if self._rest_ohms is None or not self._fixed:
            self._refer(rest.ohms)
        self._number += 1
        if self._rest_ohms is None:
            return self._waiting(sample)
        before = self._swaps.pair
        self._swaps(sample.time, sample.ohms, self._rest_ohms)
        if self._swaps.pair != before:
            self._faults.begin_anew()
        ohms = self._exchanged(sample.ohms)
        known = np.isfinite(ohms) & (ohms > 0)
        with np.errstate(all="ignore"):
            signals = relative_change(ohms, self._rest_ohms)
        self._found = self._faults(sample.time, ohms, signals)
        return self._frame(sample, since, known, np.where(known, signals, np.nan), rest)

    def _refer(self, rest: Float | None) -> None:
        """R0 is `rest` from now on."""
        before, self._rest_ohms = self._rest_ohms, rest
        if before is None and rest is not None:
            self._faults.begin_anew()  # before, they were of signals by R0 in training
        if before is None or rest is None or np.array_equal(before, rest, equal_nan=True):
            return
        ratio = np.nan_to_num(before / rest, nan=1.0)
        for stream in self._streams.values():
            stream.refer(ratio)

    def _exchanged(self, ohms: Float) -> Float:
        return self._swaps.exchanged(ohms) if self._fallback else ohms

    def _frame(
        self, sample: Sample, since: float, known: Bool, signals: Float, rest: Rest
    ) -> LiveFrame:
        model, swapped = self.model, self._swaps.pair
        notes = [fault_told(model.channels, f.kind, (f.channel,)) for f in self._found]
        if swapped is not None:
            notes.append(fault_told(model.channels, SWAPPED, swapped))
        inputs = {n: s.inputs(sample.time, signals) for n, s in self._streams.items()}
        lost, quality = None, Quality.TRUSTED if swapped is None else Quality.FALLBACK
        names = [model.channels[f.channel] for f in self._found]
        if len(names) == 1 and names[0] in self._streams and self._fallback:
            lost, quality = names[0], Quality.FALLBACK
        elif names and self._fallback:
            quality = Quality.LOST
            if len(names) == 1:
                notes.append("the model has no decoder without that cord")
        elif names:
            quality = Quality.FALLBACK
        now = decoded(model.branch(lost), inputs[lost][None], len(self._ids))
        far = not now.distance[0] < _ABSURD
        # One cord that is off is that cord's; several that can be read are R0's.
        absurd = bool(known.all()) and swapped is None and (len(names) > 1 or (far and not names))
        self._absurd_since = min(self._absurd_since, sample.time) if absurd else np.inf
        if absurd:
            notes.append(_NONSENSE)
        if far or quality == Quality.LOST or not np.isfinite(now.points).all():
            quality = Quality.LOST
            now = self._last or now
        elif now.distance[0] < _UNTRAINED or self._last is None:
            self._last = now
        self._follow_distance(float(now.distance[0]), since)
        if quality == Quality.TRUSTED and self._distance > _UNTRAINED:
            quality = Quality.UNTRAINED
            notes.append("the readings are outside of what the model was trained on")
        if not rest.settled:
            notes.append(_SETTLE)
        drift = drift_told(model.channels, rest.drift)
        notes += [drift] if drift else []
        if rest.farthest:
            quality = Quality.UNTRAINED if quality == Quality.TRUSTED else quality
            notes.append(_DRIFTED_FAR)
        if sample.time < self._said[0]:
            notes.append(self._said[1])
        notes += self._replaced()
        return self._made(sample, signals, now, quality, lost, tuple(notes))

    def _follow_distance(self, distance: float, since: float) -> None:
        if np.isfinite(distance):
            self._distance += (distance - self._distance) * -np.expm1(-since / _SMOOTH)

    def _nonsense(self, time: float, ohms: Float, rest: Rest) -> bool:
        """Whether readings have made no sense for so long, and lie so still, that it is R0 that
        is wrong: it was measured while the device was held in a pose. Then they are nearer to R0
        in training than it is; of plugs that are swapped they are not."""
        if self._fixed or not rest.still or not time - self._absurd_since > _PATIENCE:
            return False
        if self._trained_rest is None or self._rest_ohms is None:
            return False
        with np.errstate(all="ignore"):
            now, before = np.log(np.array([ohms, self._rest_ohms]) / self._trained_rest)
        return bool(np.abs(now).max() < np.abs(before).max())

    def _set_rest(self, time: float, rest: Rest, lost: frozenset[int]) -> Rest:
        """Take what the cords read at this moment for their rest, and say so."""
        asked, self._rest_asked = self._rest_asked, False
        self._absurd_since = np.inf
        if not self._rest.set_now(lost):
            self._said = (time + _SAID, "no cord can be read, so that R0 stays what it was")
            return rest
        left_out = ", ".join(self.model.channels[c] for c in sorted(lost))
        told = "R0 is what the cords read now" if asked else _MEASURED_ANEW
        self._said = (time + _SAID, f"{told} (but {left_out})" if left_out else told)
        return self._rest.told

    def _replaced(self) -> list[str]:
        if self._trained_rest is None or self._rest_ohms is None:
            return []
        off = np.nan_to_num(self._rest_ohms / self._trained_rest - 1)
        return [
            f"{name} has {100 * d:+.0f} % of its resistance at rest in training: if the cord was"
            " replaced, run 'defsense recalibrate'"
            for name, d in zip(self.model.channels, off, strict=True)
            if abs(d) > _REPLACED
        ]

    def _waiting(self, sample: Sample) -> LiveFrame:
        """Before R0 is known; cords far from their R0 in training are open or shorted."""
        c = len(self.model.channels)
        known = sample.ohms if self._trained_rest is None else self._trained_rest
        with np.errstate(all="ignore"):
            signals = relative_change(sample.ohms, known)
        gross = (signals > _GROSS - 1) | (signals < 1 / _GROSS - 1)
        self._found = self._faults(sample.time, sample.ohms, np.where(gross, signals, 0.0))
        points = self.model.rest_points[None]
        none = np.full((1, len(self._ids)), np.nan)
        now = Decoded(points, none, np.array([np.nan]))
        note = "leave the device at rest for two seconds: its resistances at rest are measured"
        notes = [fault_told(self.model.channels, f.kind, (f.channel,)) for f in self._found]
        return self._made(sample, np.full(c, np.nan), now, Quality.LOST, None, (*notes, note))

    def _made(
        self, sample: Sample, signals: Float, now: Decoded, quality: Quality, lost: str | None,
        notes: tuple[str, ...],
    ) -> LiveFrame:  # fmt: skip
        return LiveFrame(
            self.model.device, self._number, sample.time, sample.arrived, self.model.channels,
            sample.ohms, signals, self._ids, now.points[0], now.radius[0], float(now.distance[0]),
            quality, lost, notes=notes,
        )  # fmt: skip
