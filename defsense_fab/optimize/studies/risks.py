"""What a layout's prediction hangs by, in words for its maker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.curves.path_sampling import sample_path
from ...core.device.device import Sensor
from ..problem.problem import Problem

#: Signals that change less than this tell nothing, (R - R0)/R0.
_SILENT = 1e-6


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
