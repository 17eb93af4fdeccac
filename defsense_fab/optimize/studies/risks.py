"""What a layout's prediction hangs by, in words for its maker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.curve import sample_path
from ...core.device.device import Sensor
from ...decoding.expected_errors import NONE
from ...core.prediction import Prediction
from ..problem.problem import Problem

#: Signals that change less than this tell nothing, (R - R0)/R0.
_MIN_SIGNAL_CHANGE = 1e-6
#: An error is for want of cords where so much of it is left without noise, no decoder is below such
#: a share of the floor of so many signals, and the floor of more is below such a share of it.
_NOISE_FREE_FRACTION, _FLOOR_FRACTION, _BETTER_FLOOR_FRACTION = 0.7, 0.8, 0.5


@dataclass(frozen=True)
class LayoutRisk:
    """A reason why a layout may sense worse than predicted.

    Attributes:
        code: Stable identifier of the kind of risk, such as `"cord-silent"`.
        message: One sentence for people, with a remedy.
        cord: Name of the cord at risk, empty where it is the layout as a whole.
        count: The number that is too large or too small: features of the decoder, or the number of
            cords to try; None for a cord.

    """

    code: str
    message: str
    cord: str = ""
    count: int | None = None

    def __str__(self) -> str:
        return self.message


def find_risks(problem: Problem, sensors: Sequence[Sensor]) -> list[LayoutRisk]:
    """Warnings: cords whose signals do not change, or drown in noise; more features than states."""
    out: list[LayoutRisk] = []
    for sensor in sensors:
        change = round(float(np.ptp(problem.signals(sample_path(sensor)))), 9)
        if change < max(problem.noise, _MIN_SIGNAL_CHANGE):
            message = (
                f"cord {sensor.name!r}: its signal changes by {change:.2g} over all states, less"
                f" than the noise of {problem.noise:g}: it carries no information; free its path"
                " and plane"
            )
            out.append(LayoutRisk("cord-silent", message, sensor.name))
    if problem.decoder == "kernel":
        return out  # its features are as many as it is trained on
    count, states = len(problem.features(len(sensors)).linear), len(problem.markers)
    if count >= states - 1:
        message = (
            f"the {problem.decoder} decoder of {len(sensors)} cords has {count} features for"
            f" {states} states, rest included: it can fit them exactly and still be wrong in"
            " between; add mixtures and held_out states to [states], or choose another [design]"
            " decoder"
        )
        out.append(LayoutRisk("features-exceed-states", message, count=count))
    return out


def check_cord_count(problem: Problem, prediction: Prediction, free: float) -> list[LayoutRisk]:
    """A warning where more cords might tell the states of a `problem` far better, by the floors of
    affine maps; `free` is what the best of all decoders misses by on unseen states without noise,
    mm. Floors of nearly as many signals as there are states say nothing, nor do they where a
    decoder is below that of so many cords, or the error is of the states fitted alone."""
    count, error = len(prediction.noise), prediction.unseen
    now, floors = prediction.floor, range(count + 1, len(problem.markers) - 2)
    limited = (
        free > _NOISE_FREE_FRACTION * error
        and free > _FLOOR_FRACTION * now > _FLOOR_FRACTION * _BETTER_FLOOR_FRACTION * error
    )
    more = next((n for n in floors if problem.floor(n) < _BETTER_FLOOR_FRACTION * error), None)
    if prediction.how == NONE or not limited or more is None:
        return []
    message = (
        f"{count} cord{'s' * (count > 1)} can hardly tell these states apart: an affine map of so"
        f" many signals misses by {now:.2f} mm at least, one of {more} by {problem.floor(more):.2f}"
        f" mm: try [design] sensors = {more}, or `defsense study`, which looks at several numbers"
    )
    return [LayoutRisk("too-few-cords", message, count=more)]
