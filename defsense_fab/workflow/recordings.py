"""What a device said while it was moved: from sessions, from arrays, from its twin."""

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

_DAY = 86400.0  # s
UNNAMED = "device"  # the name of one that was given none


def load_sessions(*sessions: str | Path) -> Dataset:
    """Processed sessions, folders of datasets and XDF files as one dataset: each an argument.
    Raises TrainingError for what is none of these, or does not go together."""
    if not sessions:
        raise TrainingError("sessions: give at least one folder of a processed session")
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
    """A recording of arrays, all taken at the same times.

    `time` (t,) s, increasing; `resistances` (t, c) ohm, NaN where a channel gave none; `positions`
    (t, m, 3) mm of m markers in the device's rest frame, NaN where one was not seen; those at rest,
    (c,) ohm and (m, 3) mm; the names of the c `channels`, and of the `device`, which is that of the
    layout that a model is trained with where none is given. Raises TrainingError for shapes that do
    not go together, times that do not increase, and numbers that are none.
    """
    of_kind(device, "device", str, TrainingError)
    names = each_of(channels, "channels", str, TrainingError)
    when, ohm = _array("time", time, 1), _array("resistances", resistances, 2)
    points = _array("positions", positions, 3)
    rest = _array("rest_resistances", rest_resistances, 1)
    places = _array("rest_positions", rest_positions, 2)
    if not (np.isfinite(rest).all() and (rest > 0).all()):
        raise TrainingError("rest_resistances: must be above 0, in ohm, and none NaN")
    if not np.isfinite(places).all():
        raise TrainingError("rest_positions: must be finite, in mm")
    for name, values in (("resistances", ohm), ("positions", points)):
        if np.isinf(values).any():
            raise TrainingError(f"{name}: must not be infinite; NaN is where there is none")
    sigma = np.full(points.shape, np.nan)
    run = Recording("run", "session", "unit", when, ohm, rest, when, points, sigma)
    return Dataset(device, "", names, np.arange(len(places)), places, (run,))


def record_twin(
    layout: Layout,
    *,
    seconds: float = 300.0,
    sessions: int = 1,
    seed: int = 1,
    unit: int = 1,
    progress: Progress = silent,
) -> Dataset:
    """Training sessions of so many `seconds`, a day at most, of a simulated built device
    (docs/twin.md): `unit` says which one of those that differ in how they were made, `seed` how the
    hand moves it, both from 0 on. Raises TrainingError for what cannot be, CaptureError for a
    device that no twin is made of."""
    of_kind(layout, "layout", Layout, TrainingError)
    called(progress, TrainingError)
    return simulate_recordings(
        layout.poses.device.record,
        seconds=number(seconds, "seconds", TrainingError, above=0, most=_DAY),
        sessions=whole(sessions, "sessions", TrainingError),
        seed=whole(seed, "seed", TrainingError, least=0),
        unit=whole(unit, "unit", TrainingError, least=0),
        progress=progress,
    )


def _array(name: str, values: ArrayLike, dimensions: int) -> Float:
    found = array(values, name, TrainingError)
    if found.ndim != dimensions:
        raise TrainingError(f"{name}: must have {dimensions} dimensions, not shape {found.shape}")
    return found
