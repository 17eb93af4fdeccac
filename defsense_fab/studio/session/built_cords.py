"""The cords of the last build, and whether a build would move the drawn ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import sample_path
from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...workflow.build.results import Build, has_layout

_SAME_PATH_MM = 0.02  # files round positions to less than this


@dataclass(frozen=True)
class BuiltCords:
    """The cords of the last build or search.

    Attributes:
        sensors: The cords.
        error: Their expected error, mm.
        in_use: Their error in use, mm: its median, and the limits of 90 % of built devices.
        parts: Number of parts; None if they were not made on trial.
        is_moved: Whether a search has moved or added them.
    """

    sensors: tuple[Sensor, ...]
    error: float
    in_use: tuple[float, float, float]
    parts: int | None
    is_moved: bool


def built_cords(results: Build) -> BuiltCords | None:
    """Return the cords of a build; None without them."""
    if not has_layout(results):
        return None
    try:
        layout = results.layout
    except (DefsenseError, OSError):  # a build replaces it, or it is damaged
        return None
    trained = layout.band.trained
    parts = next((record.parts for record in layout.weighed if record.chosen), None)
    sensors = tuple(record.sensor() for record in layout.sensors)
    return BuiltCords(
        sensors,
        layout.prediction.unseen,
        (trained.median, trained.low, trained.high),
        parts,
        layout.proposed or not _are_paths(sensors, layout.drawn),
    )


def can_move_cords(device: Device) -> bool:
    """Return whether a search may move or add cords."""
    return device.propose > 0 or any(sensor.free for sensor in device.sensors)


def _are_paths(sensors: Sequence[Sensor], paths: Sequence[Float]) -> bool:
    """Return whether the paths of cords are paths of points (p, 3), mm."""
    if len(sensors) != len(paths):
        return False
    own = [sample_path(sensor) for sensor in sensors]
    return all(
        a.shape == np.shape(b) and np.abs(a - b).max() < _SAME_PATH_MM
        for a, b in zip(own, paths, strict=True)
    )
