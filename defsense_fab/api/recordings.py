"""What a device said while it was moved: from sessions, from arrays, from its twin."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.errors import TrainingError
from ..core.progress import Progress, silent
from ..pipeline.train.data.datasets import load_datasets
from ..pipeline.twin.recordings.twin_recordings import simulate_recordings
from ..training.data.dataset import Dataset, Recording
from .layout import Layout

UNNAMED = "device"  # the name of one that was given none


def load_sessions(*sessions: str | Path) -> Dataset:
    """Processed sessions, folders of datasets and XDF files as one dataset. Raises TrainingError
    for what is none of these, or does not go together."""
    if not sessions:
        raise TrainingError("sessions: give at least one folder of a processed session")
    return load_datasets([Path(s) for s in sessions])


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
    when, ohm = _array("time", time, 1), _array("resistances", resistances, 2)
    points, rest = (
        _array("positions", positions, 3),
        _array("rest_resistances", rest_resistances, 1),
    )
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
    return Dataset(device, "", tuple(channels), np.arange(len(places)), places, (run,))


def record_twin(
    layout: Layout,
    *,
    seconds: float = 300.0,
    sessions: int = 1,
    seed: int = 1,
    unit: int = 1,
    progress: Progress = silent,
) -> Dataset:
    """Training sessions of so many `seconds` of a simulated built device (docs/twin.md): `unit`
    says which one of those that differ in how they were made, `seed` how the hand moves it. Raises
    CaptureError."""
    if not (np.isfinite(seconds) and seconds > 0) or sessions < 1:
        raise TrainingError(f"seconds {seconds!r}, sessions {sessions!r}: must be above 0")
    return simulate_recordings(
        layout.poses.device.record, seconds=seconds, sessions=sessions, seed=seed, unit=unit,
        progress=progress,
    )  # fmt: skip


def _array(name: str, values: ArrayLike, dimensions: int) -> Float:
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError):
        raise TrainingError(f"{name}: must be an array of numbers") from None
    if found.ndim != dimensions:
        raise TrainingError(f"{name}: must have {dimensions} dimensions, not shape {found.shape}")
    return found
