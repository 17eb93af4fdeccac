"""Markers in, named controls out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.errors import ControlError
from .control_spec import ControlSpec as ControlSpec
from .control_spec import default_specs, plain_name
from .expressions import Expression, compile_expression
from .pose_amplitudes import Amplitudes, PoseAmplitudes, PoseBasis

# The One Euro filter: smooth while little moves, quick while much does.
#
# Casiez, Roussel, Vogel: 1€ Filter: A Simple Speed-based Low-pass Filter for Noisy Input in
# Interactive Systems, CHI 2012. A first-order low pass whose cutoff grows with the speed.


class OneEuro:
    """Smooths one value. `cutoff` (Hz) is that of a value at rest: less jitter the lower it is;
    `speed` (Hz per unit/s, the paper's beta) is what speed adds to it: less lag the higher it is;
    `slope_cutoff` (Hz) smooths the speed. A cutoff of 0 leaves values as they are."""

    def __init__(self, cutoff: float, speed: float = 0.0, slope_cutoff: float = 1.0) -> None:
        self._cutoff, self._speed, self._slope_cutoff = cutoff, speed, slope_cutoff
        self._time: float | None = None
        self._value = self._slope = 0.0

    def __call__(self, value: float, time: float) -> float:
        """The smoothed value at `time` (s). Where the clock goes back (another board, one that was
        reset) or a value is no number, the filter begins anew."""
        if self._cutoff <= 0 or not math.isfinite(value):
            self._time = None
            return value
        if self._time is None or time < self._time:
            self._time, self._value, self._slope = time, value, 0.0
            return value
        step = time - self._time
        if step > 0:
            slope = (value - self._value) / step
            self._slope += _weight(self._slope_cutoff, step) * (slope - self._slope)
            cutoff = self._cutoff + self._speed * abs(self._slope)
            self._value += _weight(cutoff, step) * (value - self._value)
            self._time = time
        return self._value


def _weight(cutoff: float, step: float) -> float:
    """Of the new value, in a low pass of this cutoff (Hz) and step (s): 1 / (1 + tau / step)."""
    turn = 2 * math.pi * cutoff * step
    return turn / (turn + 1)


@dataclass(frozen=True)
class Controls:
    """Values and confidences (0..1) by the controls' names, and the amplitudes behind them."""

    values: Mapping[str, float]
    confidence: Mapping[str, float]
    amplitudes: Amplitudes


class ControlBank:
    """Controls of a device whose markers are at `rest` (m, 3) mm and which has these poses.

    Without `specs` each pose is a control. `independent` is as in `PoseAmplitudes`: the number of
    cords where markers are decoded from them.
    """

    def __init__(
        self,
        basis: PoseBasis,
        rest: Float,
        specs: Sequence[ControlSpec] = (),
        independent: int | None = None,
    ) -> None:
        self._rest = np.asarray(rest, float)
        if self._rest.shape != basis.values.shape[2:]:
            raise ControlError(
                f"{self._rest.shape[0]} markers at rest, and poses of {basis.values.shape[2]}",
                code="markers-differ",
                count=self._rest.shape[0],
                expected=basis.values.shape[2],
            )
        self._poses = PoseAmplitudes(basis, independent)
        self._pose_names = [plain_name(name) for name in basis.names]
        self._entries = _compiled(self._pose_names, specs or default_specs(basis.names))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(entry.spec.name for entry in self._entries)

    def update(self, markers: Float, sd: Float, time: float) -> Controls:
        """Controls of `markers` (m, 3) mm in the rest frame at `time` (s); `sd` (m,) mm is the
        standard deviation of each coordinate (the radius of a 90 % interval over RADIUS_90)."""
        found = self._poses(markers - self._rest, sd)
        poses = self._pose_names
        known = dict(zip(poses, found.values.tolist(), strict=True))
        sure = dict(zip(poses, found.confidence.tolist(), strict=True))
        values: dict[str, float] = {}
        confidence: dict[str, float] = {}
        for entry in self._entries:
            name = entry.spec.name
            smooth = entry.smooth(entry.formula(known), time)
            values[name] = entry.spec.shaping(smooth)
            confidence[name] = min((sure[n] for n in entry.formula.names), default=1.0)
            # A control named like a pose does not hide the pose from the formulas after it.
            known.setdefault(name, values[name])
            sure.setdefault(name, confidence[name])
        return Controls(values, confidence, found)


@dataclass(frozen=True)
class _Entry:
    spec: ControlSpec
    formula: Expression
    smooth: OneEuro


def _compiled(poses: Sequence[str], specs: Sequence[ControlSpec]) -> list[_Entry]:
    known, entries = list(poses), list[_Entry]()
    for spec in specs:
        if spec.name in [e.spec.name for e in entries]:
            raise ControlError(
                "is defined twice",
                code="names-not-unique",
                where=f"control {spec.name!r}",
                action="Choose another name",
                name=spec.name,
            )
        try:
            formula = compile_expression(spec.formula, known)
        except ControlError as error:
            raise ControlError(
                str(error),
                code=error.code,
                where=f"control {spec.name!r}",
                **error.data | {"control": spec.name},
            ) from None
        shaping = spec.shaping
        entries.append(_Entry(spec, formula, OneEuro(shaping.smoothing, shaping.quickness)))
        known.append(spec.name)
    return entries
