"""Read datasets from any data: sessions, folders of datasets, XDF files, or two files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.markers import FILE as MARKERS
from ...core.markers import Markers, read_markers
from ...core.storage.session_manifest import manifest_path
from ...store.layout import layout_hash
from ..data.dataset import Dataset
from ..data.dataset_assembly import join_datasets, select_channels
from ..data.time_alignment import align_samples
from .dataset_parquet import is_dataset, read_dataset
from .pair_dataset import Offset, RecordingInfo, pair_dataset
from .session_dataset import device_layout, session_dataset
from .xdf_dataset import xdf_dataset

_XDF_SUFFIXES = (".xdf", ".xdfz")


@dataclass(frozen=True)
class DataFiles:
    """Data to train or test on.

    Attributes:
        sources: Folders of processed sessions and of datasets, and .xdf files; the kind is detected
            from the content.
        signals: A table of signals of another system; `tracks` is needed too.
        tracks: A file of tracks of another system.
        markers: The markers.json of XDF files and of `tracks`; None for the device's own.
        offset: Seconds that the tracks' clock is ahead of the signals', or "auto" to find it.
        shift: Seconds to add to the times of all samples, or "auto" to find them.
        unit: Name of the built device of XDF files and of `signals`.
    """

    sources: tuple[Path, ...] = ()
    signals: Path | None = None
    tracks: Path | None = None
    markers: Path | None = None
    offset: Offset = 0.0
    shift: Offset = 0.0
    unit: str = ""

    def load(self, device: Device | None = None, fallback_device: str = "") -> Dataset:
        """Load all data as one dataset, not shifted.

        Args:
            device: The device, if available; its order of the channels is used.
            fallback_device: Name of the device for files that do not state it.

        Returns:
            The dataset.

        Raises:
            TrainingError: If a source is of no known kind, is damaged, is given twice, or does not
                match the others or the device.
        """
        if (self.signals is None) != (self.tracks is None):
            given, missing = ("signals", "tracks") if self.tracks is None else ("tracks", "signals")
            raise TrainingError(
                f"a file of {given} needs one of {missing}",
                code="file-missing",
                where=missing,
                action="Give both",
                missing=missing,
            )
        layout = device_layout(device)
        info = RecordingInfo(
            device=None if device is None else device.name,
            layout="" if layout is None else layout_hash(layout),
            unit=self.unit,
            markers=_load_markers(device, self.markers),
            offset=self.offset,
            fallback_device=fallback_device,
        )
        parts = [_load_source(source, device, info) for source in self.sources]
        if self.signals is not None and self.tracks is not None:
            parts.append(pair_dataset(self.signals, self.tracks, info))
        names = [r.name for part in parts for r in part.recordings]
        duplicates = [name for k, name in enumerate(names) if name in names[:k]]
        if duplicates:
            raise TrainingError(
                "is given twice",
                code="duplicate-recording",
                where=duplicates[0],
                action="Give each recording once",
                recording=duplicates[0],
            )
        return match_to_device(join_datasets(parts), device)

    def align(self, dataset: Dataset) -> tuple[Dataset, list[str]]:
        """Shift the samples of a dataset as requested, and return notes; see `align_samples`."""
        return align_samples(dataset, self.shift)


def describe_files(dataset: Dataset) -> list[str]:
    """Return notes on runs that were left out, and on how files of other systems were read."""
    notes = []
    for session in dataset.provenance.get("sessions", ()):
        name = session.get("folder", dataset.device)
        notes += [f"{name}: {run}; it is left out" for run in session.get("skipped", ())]
        notes += [f"{name}: {note}" for note in session.get("notes", ())]
        if " by motion" in (offset := str(session.get("offset", ""))):
            notes.append(f"{name}: the tracks' clock is ahead by {offset}")
    return notes


def match_to_device(dataset: Dataset, device: Device | None) -> Dataset:
    """Put the channels into the order of a device's cords, if it is built.

    Args:
        dataset: The dataset.
        device: The device, if available.

    Returns:
        The dataset.

    Raises:
        TrainingError: If the recordings are of another device, layout or other channels.
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
    layout = device_layout(device)
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


def _load_source(source: Path, device: Device | None, info: RecordingInfo) -> Dataset:
    if source.suffix.lower() in _XDF_SUFFIXES:
        return xdf_dataset(source, info)
    if is_dataset(source):
        return read_dataset(source)
    if source.is_dir() and manifest_path(source) is not None:
        return session_dataset([source], device)
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
