"""Record and process sessions, and get datasets from sessions, arrays and simulated devices."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.device.device_file import load_device
from ..core.errors import CaptureError, TrainingError
from ..core.guided_run import GuidedView, Screen
from ..core.markers import read_markers
from ..core.progress import Progress, silent
from ..training.data.dataset import Dataset, Recording
from ..training.data.dataset_assembly import join_datasets
from ..training.recordings.datasets import load_dataset
from ..twin.recordings.twin_recordings import simulate_runs
from . import arguments
from .arguments import array, called, each_of, of_kind, path
from .layout import Layout
from .sessions.options import ProcessOptions, RecordOptions
from .train import export
from .train.export import ExportedDataset
from .train.options import DataFiles, ExportOptions, TwinOptions

if TYPE_CHECKING:
    from .sessions.processing import ProcessedSession
    from .sessions.recording import RecordedSession

UNNAMED = "device"  # name of a device without a name


def record(
    device: str | Path,
    cameras: Sequence[str],
    port: str,
    *,
    screen: Screen | None = None,
    **options: Any,
) -> RecordedSession:
    """Record a session step by step, or resume it, as `defsense capture record` does.

    Args:
        device: Folder of the built device, in which the session is recorded.
        cameras: Addresses of the cameras in the order of the calibration, `["none"]`, or one
            address of simulated cameras, such as `["twin:webcam"]`.
        port: Port of the read-out board, "none" or "twin".
        screen: Shows what to do and returns the keys of the user. Without one, each step starts
            automatically.
        **options: Fields of `RecordOptions`, such as `rounds=3` and `out="session-2"`.

    Returns:
        The session, for `process`, as `session.folder`, and whether it `is_complete`.

    Raises:
        DeviceError: The device or an argument is invalid.
        CaptureError: The session cannot be resumed, or a camera or the board fails.
        StorageError: Files cannot be written.
    """
    from .sessions.recording import record_session

    folder = path(device, "device")
    addresses = each_of(cameras, "cameras", str)
    of_kind(port, "port", str)
    record_options = arguments.options(options, RecordOptions, CaptureError)
    return record_session(
        load_device(folder),
        addresses,
        port,
        record_options,
        open_screen=lambda _: nullcontext(_NoScreen() if screen is None else screen),
        auto=screen is None,
    )


class _NoScreen:
    """Shows nothing, and has no keys."""

    def show(self, view: GuidedView) -> None:
        """Ignore the state of the run."""

    def key(self, timeout: float) -> None:
        """Wait, as if no key were pressed."""
        time.sleep(timeout)


def process(session: str | Path, progress: Progress = silent, **options: Any) -> ProcessedSession:
    """Compute the tracks and signals of a recorded session, as `defsense capture process` does.

    Args:
        session: Folder of the session, which receives the results; `load_sessions` loads them.
        progress: Receives each stage's name, completed fraction and a message.
        **options: Fields of `ProcessOptions`, such as `from_video=True`.

    Returns:
        The tracks and signals; `quality` has the values of `quality.json`.

    Raises:
        CaptureError: Nothing was recorded, no run can be used, or an argument is invalid.
        StorageError: A file cannot be written.
    """
    from .sessions.processing import process_session

    folder = path(session, "session", CaptureError)
    called(progress, CaptureError)
    return process_session(
        folder, arguments.options(options, ProcessOptions, CaptureError), progress
    )


def load_sessions(*sessions: str | Path) -> Dataset:
    """Load recordings as one dataset.

    Args:
        sessions: Folders of processed sessions or datasets, and XDF files.

    Raises:
        TrainingError: A path is not a recording, or the recordings do not go together.
    """
    return load_dataset(DataFiles(session_paths(sessions)))


def read_tables(
    signals: str | Path | Sequence[str | Path],
    targets: str | Path | Sequence[str | Path],
    *,
    offset: float = 0.0,
) -> Dataset:
    """Read tables of signals and targets of any sensor as one dataset, a run for each pair.

    Units are in the headers, such as `left_kohm`, `angle_deg` or `force [N]`.

    Args:
        signals: Tables (.csv) of signals, one for each run.
        targets: Tables (.csv) of targets, in the same order.
        offset: Time in s by which the targets' clock is ahead.

    Raises:
        TrainingError: A file is not such a table, or the runs do not match each other.
    """
    shift = arguments.number(offset, "offset", TrainingError)
    files = DataFiles(
        signals=_paths(signals, "signals"), targets=_paths(targets, "targets"), offset=shift
    )
    return load_dataset(files)


def _paths(value: str | Path | Sequence[str | Path], name: str) -> tuple[Path, ...]:
    items = [value] if isinstance(value, str | Path) else list(value)
    return tuple(path(p, f"{name}[{k}]", TrainingError) for k, p in enumerate(items))


def join(*datasets: Dataset) -> Dataset:
    """Join datasets of one device or sensor.

    Channels and targets are matched by name. The name of a run that repeats gets a number.

    Args:
        datasets: The datasets, at least one.

    Raises:
        TrainingError: There is none, or devices, layouts, channels, targets or units differ.
    """
    parts = each_of(datasets, "datasets", Dataset, TrainingError)
    names, renamed = set[str](), list[Dataset]()
    for part in parts:
        runs = []
        for r in part.recordings:
            name, number = r.name, 2
            while name in names:
                name, number = f"{r.name}-{number}", number + 1
            names.add(name)
            runs.append(r if name == r.name else replace(r, name=name))
        renamed.append(replace(part, recordings=tuple(runs)))
    return join_datasets(renamed)


def session_paths(sessions: Sequence[object]) -> tuple[Path, ...]:
    """Return the paths of sessions that are given as arguments, at least one.

    Raises:
        TrainingError: There is none, or one is not a path.
    """
    if not sessions:
        raise TrainingError(
            "must not be empty",
            code="sessions-missing",
            where="sessions",
            action="Give at least one folder of a session",
            argument="sessions",
        )
    return tuple(path(s, f"sessions[{k}]", TrainingError) for k, s in enumerate(sessions))


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


def record_twin(layout: Layout, *, progress: Progress = silent, **options: Any) -> Dataset:
    """Record training sessions of a simulated device as built (docs/twin.md).

    Args:
        layout: Layout of the device.
        progress: Receives each stage's name, completed fraction and a message.
        **options: Fields of `TwinOptions`, such as `minutes=2` and `seed=3`; no cameras, whose
            pictures are files.

    Raises:
        CaptureError: The device cannot be simulated, or an option is invalid.
    """
    of_kind(layout, "layout", Layout, CaptureError)
    called(progress, CaptureError)
    record = arguments.options(options, TwinOptions, CaptureError)
    if record.cameras is not None:
        raise CaptureError(
            "rendered cameras write files",
            code="options-conflict",
            where="cameras",
            action="Use 'defsense twin' and load_sessions",
            argument="cameras",
        )
    markers = None if record.markers is None else read_markers(record.markers)
    device = layout.simulation.device.record
    return simulate_runs(device, record, markers=markers, progress=progress).dataset


def export_dataset(
    data: Dataset, layout: Layout | None = None, *, progress: Progress = silent, **options: Any
) -> ExportedDataset:
    """Write a dataset into folders for other programs, as `defsense dataset` does.

    Args:
        data: The dataset.
        layout: Layout of the device, to check the data against.
        progress: Receives each stage's name, completed fraction and a message.
        **options: Fields of `ExportOptions`: `out="data"` for Parquet, `lerobot="data-lerobot"` for
            LeRobot's format, or both.

    Returns:
        The dataset, its `problems` and `notes`.

    Raises:
        TrainingError: A folder exists and is not a dataset, or an argument is invalid.
        StorageError: A folder cannot be written.
    """
    of_kind(data, "data", Dataset, TrainingError)
    called(progress, TrainingError)
    device = None
    if layout is not None:
        device = of_kind(layout, "layout", Layout, TrainingError).simulation.device.record
    record_options = arguments.options(options, ExportOptions, TrainingError)
    return export.export_dataset(data, device, record_options, progress=progress)


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
