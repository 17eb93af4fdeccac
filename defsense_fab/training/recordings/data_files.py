"""What data is taken from, as the commands that train, evaluate and export are told it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Device
from ..data.dataset import Dataset
from ..data.time_alignment import align_samples
from .datasets import load_datasets
from .pair_dataset import Offset


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

    def in_step(self, dataset: Dataset) -> tuple[Dataset, list[str]]:
        """The dataset with its samples shifted as asked for: see `align_samples`."""
        return align_samples(dataset, self.shift)


def told_files(dataset: Dataset) -> list[str]:
    """What was left out of its sessions, and how files of others were read."""
    out = []
    for told in dataset.provenance.get("sessions", ()):
        where = told.get("folder", dataset.device)
        out += [f"{where}: {run}; it is left out" for run in told.get("skipped", ())]
        out += [f"{where}: {note}" for note in told.get("notes", ())]
        if " by motion" in (how := str(told.get("offset", ""))):
            out.append(f"{where}: the tracks' clock is ahead by {how}")
    return out
