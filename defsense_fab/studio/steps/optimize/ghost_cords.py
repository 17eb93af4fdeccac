"""Cords that are shown next to the drawn ones, and whether two layouts are the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....core.curve import sample_path
from ....core.device.device import Sensor
from ...messages.optimize import GhostCord
from ...session.cord_states import rounded

_MAX_POINTS = 80  # of a path that is shown
_SAME_PATH_MM = 0.02  # files round positions to less than this


def ghost_cords(sensors: Sequence[Sensor]) -> list[GhostCord]:
    """Return cords as the page shows them."""
    return [GhostCord(name=sensor.name, path=_shown_path(sensor)) for sensor in sensors]


def are_same(first: Sequence[Sensor], second: Sequence[Sensor]) -> bool:
    """Return whether two layouts have the same cords, by name and path."""
    if len(first) != len(second):
        return False
    others = {sensor.name: sensor for sensor in second}
    return all(s.name in others and _is_same_path(s, others[s.name]) for s in first)


def _is_same_path(first: Sensor, second: Sensor) -> bool:
    a, b = sample_path(first), sample_path(second)
    return a.shape == b.shape and bool(np.abs(a - b).max() < _SAME_PATH_MM)


def _shown_path(sensor: Sensor) -> list[list[float]]:
    path = sample_path(sensor)
    kept = np.unique(np.linspace(0, len(path) - 1, min(_MAX_POINTS, len(path))).astype(int))
    return rounded(path[kept])
