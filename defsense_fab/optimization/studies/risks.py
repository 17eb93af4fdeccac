"""Warn about layouts that may sense worse than predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.curve import sample_path
from ...core.device.device import Sensor
from ...core.progress import Notice
from ...decoding.expected_errors import NONE
from ...store.layout import Prediction
from ..problem.problem import Problem

#: Smallest change of a signal that carries information, (R - R0)/R0.
_MIN_SIGNAL_CHANGE = 1e-6
#: More cords are advised if the error without noise is at least this share of the error, if it is
#: above this share of the floor of the present cords, and if the floor of more cords is below this
#: share of the error.
_NOISE_FREE_FRACTION, _FLOOR_FRACTION, _BETTER_FLOOR_FRACTION = 0.7, 0.8, 0.5


def find_risks(problem: Problem, sensors: Sequence[Sensor]) -> list[Notice]:
    """Find cords whose signals are below the noise, and decoders with more features than states.

    Args:
        problem: The problem.
        sensors: The cords of the layout.
    """
    out: list[Notice] = []
    noun = problem.limits.noun
    for sensor in sensors:
        change = round(float(np.ptp(problem.signals(sample_path(sensor)))), 9)
        if change < max(problem.noise, _MIN_SIGNAL_CHANGE):
            message = (
                f"{noun} {sensor.name!r}: its signal changes by {change:.2g} over all states, less"
                f" than the noise of {problem.noise:g}: it carries no information. Remove it"
                " (if it was proposed, with fewer sensors in [design]), free its path and plane, or"
                " let wires leave at more places ([wires] exit)"
            )
            out.append(Notice("cord-silent", message, sensor.name))
    if problem.decoder == "kernel":
        return out  # it has as many features as training frames
    count, states = len(problem.features(len(sensors)).linear), len(problem.markers)
    if count >= states - 1:
        message = (
            f"the {problem.decoder} decoder of {len(sensors)} signals has {count} features for"
            f" {states} states, rest included: it can fit them exactly and still be wrong in"
            " between. Add mixtures and held_out states to [states], or choose another [design]"
            " decoder"
        )
        out.append(Notice("features-exceed-states", message, data={"features": count}))
    return out


def check_cord_count(problem: Problem, prediction: Prediction, free: float) -> list[Notice]:
    """Warn if more cords would distinguish the states much better, judged by floors of affine maps.

    Floors of nearly as many signals as states carry no information. There is no warning either if
    a decoder is already better than the floor, or if the error is that of fitted states.

    Args:
        problem: The problem with all states.
        prediction: The prediction of the layout.
        free: Error of the best decoder on unseen states without noise, mm.
    """
    count, error = len(prediction.noise), prediction.unseen
    floor, floors = prediction.floor, range(count + 1, len(problem.markers) - 2)
    is_limited = (
        free > _NOISE_FREE_FRACTION * error
        and free > _FLOOR_FRACTION * floor > _FLOOR_FRACTION * _BETTER_FLOOR_FRACTION * error
    )
    more = next((n for n in floors if problem.floor(n) < _BETTER_FLOOR_FRACTION * error), None)
    if prediction.how == NONE or not is_limited or more is None:
        return []
    message = (
        f"{count} signal{'s' * (count > 1)} cannot distinguish these states well: the error of an"
        f" affine map of so many signals is {floor:.2f} mm or more, of {more} signals"
        f" {problem.floor(more):.2f} mm or more. Try [design] sensors = {more}, or compare several"
        " numbers in a parameter study"
    )
    return [Notice("too-few-cords", message, data={"cords": more})]
