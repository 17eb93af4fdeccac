"""Read datasets from any data: sessions, folders of datasets, XDF files, or pairs of files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.markers import FILE as MARKERS
from ...core.markers import Markers, read_markers
from ...core.storage.session_manifest import manifest_path
from ...store.build import Build
from ...store.layout import LAYOUT, LayoutRecord, layout_hash
from ..data.dataset import Dataset
from ..data.dataset_assembly import join_datasets, select_channels
from ..options import XDF_SUFFIXES, DataFiles
from .dataset_parquet import is_dataset, read_dataset
from .pair_dataset import RecordingInfo, pair_dataset
from .session_dataset import session_dataset
from .table_dataset import table_dataset
from .xdf_dataset import xdf_dataset


def load_dataset(
    files: DataFiles,
    device: Device | None = None,
    *,
    build: Build | None = None,
    fallback_device: str = "",
) -> Dataset:
    """Load data as one dataset, not shifted.

    Args:
        files: The data.
        device: The device, if available; its order of the channels is used.
        build: The device's build; by default that in its folder.
        fallback_device: Name of the device for files that do not state it.

    Returns:
        The dataset.

    Raises:
        TrainingError: A source is of no known kind, is damaged, is given twice, or does not match
            the others or the device.
        StorageError: The layout of the device's build cannot be read.
    """
    layout = device_layout(device, build)
    info = RecordingInfo(
        device=None if device is None else device.name,
        layout="" if layout is None else layout_hash(layout),
        unit=files.unit,
        markers=_load_markers(device, files.markers),
        offset=files.offset,
        tracks_unit=files.tracks_unit,
        fallback_device=fallback_device,
    )
    parts = [_load_source(source, files, info) for source in files.sources]
    if files.targets:
        parts.append(table_dataset(files.signals, files.targets, info))
    else:
        pairs = zip(files.signals, files.tracks, strict=True)
        parts += [pair_dataset(signals, tracks, info) for signals, tracks in pairs]
    names = [r.name for part in parts for r in part.recordings]
    duplicates = [name for k, name in enumerate(names) if name in names[:k]]
    if duplicates:
        raise TrainingError(
            "is given twice",
            code="recording-repeated",
            where=duplicates[0],
            action="Give each recording once",
            recording=duplicates[0],
        )
    return match_to_device(join_datasets(parts), device, build)


def describe_files(dataset: Dataset) -> list[str]:
    """Return notes on runs that were left out, and on how files of other systems were read."""
    notes = []
    for session in dataset.provenance.get("sessions", ()):
        name = session.get("folder", dataset.device)
        notes += [f"{name}: {run}; it is left out" for run in session.get("skipped", ())]
        notes += [f"{name}: {note}" for note in session.get("notes", ())]
        if session.get("offset_by") == "motion":
            notes.append(f"{name}: the tracks' clock is ahead by {session['offset']}")
    return notes


def device_layout(device: Device | None, build: Build | None = None) -> LayoutRecord | None:
    """Return the layout of a device's build; None if it is not built.

    Args:
        device: The device, if available.
        build: Its build; by default that in its folder.
    """
    if device is None:
        return None
    build = build or Build(build_folder(device))
    return build.layout if (build.folder / LAYOUT).exists() else None


def match_to_device(dataset: Dataset, device: Device | None, build: Build | None = None) -> Dataset:
    """Put the channels into the order of a device's cords, if it is built.

    Args:
        dataset: The dataset.
        device: The device, if available.
        build: The device's build; by default that in its folder.

    Returns:
        The dataset.

    Raises:
        TrainingError: The recordings are of another device, layout or other channels.
        StorageError: The layout of the device's build cannot be read.
    """
    if device is None:
        return dataset
    if dataset.device != device.name:
        raise TrainingError(
            f"the recordings are of {dataset.device}, not of {device.name}",
            code="devices-differ",
            action=f"Give recordings of {device.name}",
            devices=(device.name, dataset.device),
        )
    layout = device_layout(device, build)
    if layout is None:
        return dataset
    built = layout_hash(layout)
    if dataset.layout and dataset.layout != built:
        raise TrainingError(
            f"the recordings have another layout of cords ({dataset.layout}) than {device.name} is"
            f" built with ({built})",
            code="layouts-differ",
            action="Train with the build that they were recorded with",
            layouts=(built, dataset.layout),
        )
    ordered = select_channels(dataset, [cord.name for cord in layout.by_channel()])
    return replace(ordered, layout=built)


def _load_source(source: Path, files: DataFiles, info: RecordingInfo) -> Dataset:
    if source.suffix.lower() in XDF_SUFFIXES:
        return xdf_dataset(source, info, signals=files.signals_stream, tracks=files.tracks_stream)
    if is_dataset(source):
        return read_dataset(source)
    if source.is_dir() and manifest_path(source) is not None:
        return session_dataset(source)
    if not source.exists():
        raise TrainingError(
            "the file or folder does not exist",
            code="file-not-found",
            where=source,
            action="Check the path",
        )
    if source.is_dir():
        raise TrainingError(
            "is neither a session nor a dataset (samples.parquet, frames.parquet)",
            code="not-a-dataset",
            where=source,
            action="Record a session with defsense capture record, or give another folder",
        )
    raise TrainingError(
        "is neither an .xdf file nor a folder",
        code="unknown-format",
        where=source,
        action="Give tables of signals and tracks as a pair of files",
    )


def _load_markers(device: Device | None, path: Path | None) -> Markers | None:
    """Return the markers of a file, or of the device's folder, if there are any."""
    if path is not None:
        return read_markers(path)
    if device is None or not (device.source / "markers" / MARKERS).exists():
        return None
    return read_markers(device.source / "markers")
