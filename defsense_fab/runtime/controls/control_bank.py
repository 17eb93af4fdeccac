"""Compute named controls from marker positions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.errors import ControlError
from .control_spec import ControlSpec, default_specs, plain_name
from .expressions import Expression, compile_expression
from .pose_amplitudes import Amplitudes, PoseAmplitudes, PoseBasis


class OneEuro:
    """The One Euro filter: smooth while a value is nearly at rest, quick while it moves.

    It is a first-order low pass whose cutoff grows with the speed of the value.

    Args:
        cutoff: Cutoff of a value at rest, Hz; lower is less jitter. 0 leaves values as they are.
        speed: Increase of the cutoff with the speed, Hz per unit/s (the paper's beta); higher is
            less lag.
        slope_cutoff: Cutoff of the filter of the speed, Hz.

    References:
        Casiez, Roussel, Vogel: 1€ Filter: A Simple Speed-based Low-pass Filter for Noisy Input in
        Interactive Systems, CHI 2012.
    """

    def __init__(self, cutoff: float, speed: float = 0.0, slope_cutoff: float = 1.0) -> None:
        self._cutoff, self._speed, self._slope_cutoff = cutoff, speed, slope_cutoff
        self._time: float | None = None
        self._value = self._slope = 0.0

    def __call__(self, value: float, time: float) -> float:
        """Return the smoothed value at `time` (s).

        The filter restarts if the clock goes back (another board, or one that was reset) or if the
        value is not finite.
        """
        if self._cutoff <= 0 or not math.isfinite(value):
            self._time = None
            return value
        if self._time is None or time < self._time:
            self._time, self._value, self._slope = time, value, 0.0
            return value
        step = time - self._time
        if step > 0:
            slope = (value - self._value) / step
            self._slope += _low_pass_weight(self._slope_cutoff, step) * (slope - self._slope)
            cutoff = self._cutoff + self._speed * abs(self._slope)
            self._value += _low_pass_weight(cutoff, step) * (value - self._value)
            self._time = time
        return self._value


def _low_pass_weight(cutoff: float, step: float) -> float:
    """Return the weight 1 / (1 + tau / step) of a new value, by cutoff (Hz) and step (s)."""
    turn = 2 * math.pi * cutoff * step
    return turn / (turn + 1)


@dataclass(frozen=True)
class Controls:
    """The controls at one frame.

    Attributes:
        values: Values by the controls' names.
        confidence: Confidences by the controls' names, 0..1.
        amplitudes: The amplitudes of poses that they were computed from.
    """

    values: Mapping[str, float]
    confidence: Mapping[str, float]
    amplitudes: Amplitudes


class ControlBank:
    """The controls of a device.

    Args:
        basis: The poses of the device.
        rest: Marker positions at rest (m, 3), mm.
        specs: The controls; by default, one for each pose.
        independent: Number of independent measurements, as of `PoseAmplitudes`: the number of cords
            if markers are decoded from them.

    Raises:
        ControlError: The markers at rest are not those of the poses, two controls have the same
            name, or a formula is invalid.
    """

    def __init__(
        self,
        basis: PoseBasis,
        rest: Float,
        specs: Sequence[ControlSpec] = (),
        independent: int | None = None,
    ) -> None:
        self._rest = np.asarray(rest, float)
        if self._rest.shape != (basis.markers, 3):
            raise ControlError(
                f"there are {self._rest.shape[0]} markers at rest and poses of"
                f" {basis.markers} markers",
                code="markers-differ",
                count=self._rest.shape[0],
                expected=basis.markers,
            )
        self._poses = PoseAmplitudes(basis, independent)
        self._pose_names = [plain_name(name) for name in basis.names]
        self._entries = _compile(self._pose_names, specs or default_specs(basis.names))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the controls."""
        return tuple(entry.spec.name for entry in self._entries)

    def update(self, markers: Float, sd: Float, time: float) -> Controls:
        """Return the controls at a frame.

        Args:
            markers: Marker positions (m, 3), mm, in the rest frame.
            sd: Standard deviation of each coordinate of the markers (m,), mm: the radius of their
                90 % interval over `RADIUS_90`.
            time: Time of the frame, s.
        """
        amplitudes = self._poses(markers - self._rest, sd)
        poses = self._pose_names
        known = dict(zip(poses, amplitudes.values.tolist(), strict=True))
        known_confidence = dict(zip(poses, amplitudes.confidence.tolist(), strict=True))
        values: dict[str, float] = {}
        confidence: dict[str, float] = {}
        for entry in self._entries:
            name = entry.spec.name
            smooth = entry.smooth(entry.formula(known), time)
            values[name] = entry.spec.shaping(smooth)
            confidence[name] = min((known_confidence[n] for n in entry.formula.names), default=1.0)
            # A control named like a pose does not hide the pose from later formulas.
            known.setdefault(name, values[name])
            known_confidence.setdefault(name, confidence[name])
        return Controls(values, confidence, amplitudes)


@dataclass(frozen=True)
class _Entry:
    spec: ControlSpec
    formula: Expression
    smooth: OneEuro


def _compile(poses: Sequence[str], specs: Sequence[ControlSpec]) -> list[_Entry]:
    known, entries = list(poses), list[_Entry]()
    for spec in specs:
        where = f"control {spec.name!r}"
        if spec.name in [e.spec.name for e in entries]:
            raise ControlError(
                "is defined twice",
                code="name-repeated",
                where=where,
                action="Choose another name",
                name=spec.name,
            )
        try:
            formula = compile_expression(spec.formula, known)
        except ControlError as error:
            located = ControlError(str(error), code=error.code, where=where)
            located.data = error.data | {"control": spec.name}
            raise located from None
        shaping = spec.shaping
        entries.append(_Entry(spec, formula, OneEuro(shaping.smoothing, shaping.quickness)))
        known.append(spec.name)
    return entries
