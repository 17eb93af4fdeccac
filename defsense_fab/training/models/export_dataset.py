"""Data as datasets in files of their own: for training elsewhere, or later."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Device
from ...core.progress import Progress, silent
from ..data.dataset import Dataset
from ..data.dataset_checks import check_dataset
from ..data.problems import Problem
from ..recordings import dataset_parquet, lerobot_export
from ..recordings.data_files import DataFiles, told_files
from .prepare import AUTO, foretold, found_prior


@dataclass(frozen=True)
class Exported:
    """What was written, what is wrong with it, those problems first that forbid training; and what
    else is worth a word."""

    dataset: Dataset
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]


def export_dataset(
    files: DataFiles, device: Device | None = None, *, parquet: Path | None = None,
    lerobot: Path | None = None, rate: int | None = None, progress: Progress = silent,
) -> Exported:  # fmt: skip
    """The data of `files`, checked against the `device` if it is given, into folders `parquet` and
    `lerobot`, that one at `rate` frames a second. Nothing is left out: problems are told, and
    training decides. Raises TrainingError, StorageError, and what the readers raise."""
    if parquet is not None:
        dataset_parquet.check_folder(parquet)
    if lerobot is not None:
        lerobot_export.check_free(lerobot)
    progress("data", 0.0, "reading")
    dataset, notes = files.in_step(files.load(device))
    progress("data", 0.5, "checking")
    prior, why = found_prior(dataset, device, AUTO)
    problems = check_dataset(dataset, predicted=foretold(prior, dataset))
    progress("data", 0.8, "writing")
    if parquet is not None:
        dataset_parquet.write_dataset(parquet, dataset)
    if lerobot is not None:
        lerobot_export.write_lerobot(lerobot, dataset, rate)
    progress("data", 1.0, "done")
    return Exported(dataset, problems, (*told_files(dataset), *notes, *why))
