"""Datasets of whatever is given: sessions, folders of datasets, XDF files, or two files."""

from __future__ import annotations

from collections.abc import Sequence
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
from .pair_dataset import QUIET, Offset, pair_dataset
from .session_dataset import device_layout, session_dataset
from .xdf_dataset import xdf_dataset

# What data is taken from, as the commands that train, evaluate and export are told it.


@dataclass(frozen=True)
class DataFiles:
    """`sources`: sessions, datasets, XDF files; `signals` with `tracks`: two files of others, with
    the `markers` at rest, the tracks' clock `offset` s ahead, or "auto". `shift` s are added to the
    times of all samples, or what is found, "auto"."""

    sources: tuple[Path, ...] = ()
    signals: Path | None = None
    tracks: Path | None = None
    markers: Path | None = None
    offset: Offset = 0.0
    shift: Offset = 0.0

    def load(self, device: Device | None = None, called: str = "") -> Dataset:
        """As recorded, not shifted. Of files that do not say so, `called` is the device's name.
        Raises TrainingError, and what the readers raise."""
        return load_datasets(
            self.sources, device, signals=self.signals, tracks=self.tracks, markers=self.markers,
            offset=self.offset, called=called,
        )  # fmt: skip

    def align(self, dataset: Dataset) -> tuple[Dataset, list[str]]:
        """The dataset with its samples shifted as asked for: see `align_samples`."""
        return align_samples(dataset, self.shift)


def describe_files(dataset: Dataset) -> list[str]:
    """What was left out of its sessions, and how files of others were read."""
    out = []
    for told in dataset.provenance.get("sessions", ()):
        where = told.get("folder", dataset.device)
        out += [f"{where}: {run}; it is left out" for run in told.get("skipped", ())]
        out += [f"{where}: {note}" for note in told.get("notes", ())]
        if " by motion" in (how := str(told.get("offset", ""))):
            out.append(f"{where}: the tracks' clock is ahead by {how}")
    return out


_XDF = (".xdf", ".xdfz")


def load_datasets(
    sources: Sequence[Path], device: Device | None = None, *, signals: Path | None = None,
    tracks: Path | None = None, markers: Path | None = None, offset: Offset = 0.0,
    unit: str = "", quiet: float = QUIET, called: str = "",
) -> Dataset:  # fmt: skip
    """All that is given, as one dataset with the channels in the device's order.

    `sources`: folders of processed sessions and of datasets, and .xdf files, recognised by what is
    there. `signals` with `tracks`: two files. Of those and of XDF files, `markers` is the
    markers.json (the device's own, where it has one), `offset` s what the tracks' clock is ahead
    by, or "auto", `unit` which built device it is, `quiet` s the rest at the beginning, and
    `called` the device's name where neither it nor its markers are given.

    Raises TrainingError for what is nothing of that or does not go together, and what the readers
    raise."""
    if (signals is None) != (tracks is None):
        given, lacking = ("signals", "tracks") if tracks is None else ("tracks", "signals")
        raise TrainingError(f"a file of {given} needs one of {lacking} with it; give both")
    layout = device_layout(device)
    placed = _markers(device, markers)
    name = None if device is None else device.name
    known = "" if layout is None else layout_hash(layout)
    parts = []
    for source in sources:
        if source.suffix.lower() in _XDF:
            parts.append(
                xdf_dataset(
                    source, device=name, layout=known, unit=unit, markers=placed, offset=offset,
                    quiet=quiet, called=called,
                )
            )  # fmt: skip
        elif is_dataset(source):
            parts.append(read_dataset(source))
        elif source.is_dir() and manifest_path(source) is not None:
            parts.append(session_dataset([source], device))
        else:
            raise TrainingError(_unknown(source))
    if signals is not None and tracks is not None:
        parts.append(
            pair_dataset(
                signals, tracks, device=name, layout=known, unit=unit, markers=placed,
                offset=offset, quiet=quiet, called=called,
            )
        )  # fmt: skip
    names = [r.name for part in parts for r in part.recordings]
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise TrainingError(f"{twice[0]} is given twice; give each recording once")
    return match_to_device(join_datasets(parts), device)


def match_to_device(dataset: Dataset, device: Device | None) -> Dataset:
    """The dataset with its channels in the order of the device's cords, where it is built. Raises
    TrainingError for recordings of another device, or of other cords."""
    if device is None:
        return dataset
    if dataset.device != device.name:
        raise TrainingError(
            f"the recordings are of {dataset.device}, not of {device.name}; give this one's"
        )
    layout = device_layout(device)
    if layout is None:
        return dataset
    known = layout_hash(layout)
    if dataset.layout and dataset.layout != known:
        raise TrainingError(
            f"the recordings are of other cords ({dataset.layout}) than {device.name} is built with"
            f" ({known}); train with the build that they were recorded with"
        )
    ordered = select_channels(dataset, [cord.name for cord in layout.by_channel()])
    return replace(ordered, layout=known)


def _markers(device: Device | None, path: Path | None) -> Markers | None:
    """Those of the file, or of the device's folder."""
    if path is not None:
        return read_markers(path)
    if device is None or not (device.source / "markers" / MARKERS).exists():
        return None
    return read_markers(device.source / "markers")


def _unknown(source: Path) -> str:
    """What a source that is none is."""
    if not source.exists():
        return f"{source}: there is no such file or folder; check the path"
    if source.is_dir():
        return (
            f"{source}: is neither a session ('defsense capture record' makes sessions) nor a"
            " dataset (samples.parquet, frames.parquet)"
        )
    return (
        f"{source}: is no .xdf file and no folder; give tables of signals with --signals and tracks"
        " with --tracks"
    )
