"""What a layout's prediction hangs by, in words for its maker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.curves.path_sampling import sample_path
from ...core.device.device import Sensor
from ...core.prediction import Prediction
from ..problem.problem import Problem

#: Signals that change less than this tell nothing, (R - R0)/R0.
_SILENT = 1e-6
#: An error is for want of cords where so much of it is left without noise, no affine map of so many
#: signals has less than such a share of it, and one of a signal more might.
_WITHOUT_NOISE, _FLOOR = 0.7, 0.5


def risks(problem: Problem, sensors: Sequence[Sensor]) -> list[str]:
    """Warnings: cords whose signals do not change, or drown in noise; more features than states."""
    out = []
    for sensor in sensors:
        change = round(float(np.ptp(problem.signals(sample_path(sensor)))), 9)
        if change < max(problem.noise, _SILENT):
            out.append(
                f"cord {sensor.name!r}: its signal changes by {change:.2g} over all states, less"
                f" than the noise of {problem.noise:g}: it carries no information; free its path"
                " and plane"
            )
    if problem.decoder == "kernel":
        return out  # its features are as many as it is trained on
    count, states = len(problem.features(len(sensors)).linear), len(problem.markers)
    if count >= states - 1:
        out.append(
            f"the {problem.decoder} decoder of {len(sensors)} cords has {count} features for"
            f" {states} states, rest included: it can fit them exactly and still be wrong in"
            " between; add mixtures and held_out states to [states], or choose another [design]"
            " decoder"
        )
    return out


def too_few(problem: Problem, prediction: Prediction) -> list[str]:
    """A warning where more cords might tell the states of a `problem` far better, by the floors of
    affine maps."""
    count, error = len(prediction.noise), prediction.unseen
    now, then = prediction.floor, problem.floor(count + 1)
    limited = prediction.unseen_noise_free > _WITHOUT_NOISE * error and now > _FLOOR * error
    if not limited or then > _FLOOR * error:
        return []
    return [
        f"{count} cord{'s' * (count > 1)} can hardly tell these states apart: an affine map of so"
        f" many signals misses by {now:.2g} mm at least, and of one more by {then:.2g} mm: try"
        f" [design] sensors = {count + 1}, or `defsense study`, which looks at several numbers"
    ]
