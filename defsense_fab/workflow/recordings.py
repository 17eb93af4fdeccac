"""Datasets from sessions, arrays and simulated devices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.errors import TrainingError
from ..core.progress import Progress, silent
from ..training.data.dataset import Dataset, Recording
from ..training.recordings.datasets import DataFiles
from ..twin.recordings.twin_recordings import simulate_recordings
from .arguments import array, called, each_of, number, of_kind, path, whole
from .layout import Layout

_MAX_TWIN_SESSION_S = 86400.0  # a day
UNNAMED = "device"  # name of a device without a name


def load_sessions(*sessions: str | Path) -> Dataset:
    """Load recordings as one dataset.

    Args:
        sessions: Folders of processed sessions or datasets, and XDF files.

    Raises:
        TrainingError: A path is not a recording, or the recordings do not go together.
    """
    if not sessions:
        raise TrainingError(
            "must not be empty",
            code="sessions-missing",
            where="sessions",
            action="Give at least one folder of a processed session",
            argument="sessions",
        )
    folders = tuple(path(s, f"sessions[{k}]", TrainingError) for k, s in enumerate(sessions))
    return DataFiles(folders).load()


def dataset(
    time: ArrayLike,
    resistances: ArrayLike,
    positions: ArrayLike,
    *,
    rest_resistances: ArrayLike,
    rest_positions: ArrayLike,
    channels: Sequence[str],
    device: str = UNNAMED,
) -> Dataset:
    """Return arrays that were sampled at the same times as a dataset of one recording.

    Args:
        time: Times (t,) s, increasing.
        resistances: Resistances (t, c) ohm; NaN where a channel has no value.
        positions: Positions (t, m, 3) mm of the markers in the device's rest frame; NaN where a
            marker was not visible.
        rest_resistances: Resistances (c,) ohm at rest.
        rest_positions: Positions (m, 3) mm of the markers at rest.
        channels: Names of the c channels.
        device: Name of the device; by default that of the layout that a model is trained with.

    Raises:
        TrainingError: Shapes do not go together, times do not increase, or a value is invalid.
    """
    of_kind(device, "device", str, TrainingError)
    names = each_of(channels, "channels", str, TrainingError)
    times, ohm = _array("time", time, 1), _array("resistances", resistances, 2)
    points = _array("positions", positions, 3)
    rest = validate_rest_resistances(_array("rest_resistances", rest_resistances, 1))
    rest_points = _array("rest_positions", rest_positions, 2)
    if not np.isfinite(rest_points).all():
        raise TrainingError(
            "must be finite, in mm",
            code="not-finite",
            where="rest_positions",
            argument="rest_positions",
        )
    for name, values in (("resistances", ohm), ("positions", points)):
        if np.isinf(values).any():
            raise TrainingError(
                "must not be infinite",
                code="not-finite",
                where=name,
                action="Use NaN where there is no value",
                argument=name,
            )
    sigma = np.full(points.shape, np.nan)
    run = Recording("run", "session", "unit", times, ohm, rest, times, points, sigma)
    return Dataset(device, "", names, np.arange(len(rest_points)), rest_points, (run,))


def validate_rest_resistances(rest: Float) -> Float:
    """Return resistances at rest if they are finite and above 0.

    Raises:
        TrainingError: One is not.
    """
    if np.isfinite(rest).all() and (rest > 0).all():
        return rest
    raise TrainingError(
        "must be numbers above 0, in ohm, without NaN",
        code="not-positive",
        where="rest_resistances",
        argument="rest_resistances",
    )


def record_twin(
    layout: Layout,
    *,
    seconds: float = 300.0,
    sessions: int = 1,
    seed: int = 1,
    unit: int = 1,
    progress: Progress = silent,
) -> Dataset:
    """Record training sessions of a simulated device as built (docs/twin.md).

    Args:
        layout: Layout of the device.
        seconds: Duration of each session, s; at most a day.
        sessions: Number of sessions.
        seed: Selects how the device is moved, from 0.
        unit: Selects one of the units of the device, from 0; units differ by tolerances of their
            fabrication.
        progress: Receives each stage's name, completed fraction and a message.

    Raises:
        TrainingError: An argument is invalid.
        CaptureError: The device cannot be simulated.
    """
    of_kind(layout, "layout", Layout, TrainingError)
    called(progress, TrainingError)
    return simulate_recordings(
        layout.simulation.device.record,
        seconds=number(seconds, "seconds", TrainingError, above=0, most=_MAX_TWIN_SESSION_S),
        sessions=whole(sessions, "sessions", TrainingError),
        seed=whole(seed, "seed", TrainingError, least=0),
        unit=whole(unit, "unit", TrainingError, least=0),
        progress=progress,
    )


def _array(name: str, values: ArrayLike, dimensions: int) -> Float:
    converted = array(values, name, TrainingError)
    if converted.ndim != dimensions:
        raise TrainingError(
            f"must have {dimensions} dimensions, not shape {converted.shape}",
            code="wrong-shape",
            where=name,
            argument=name,
            shape=converted.shape,
        )
    return converted
