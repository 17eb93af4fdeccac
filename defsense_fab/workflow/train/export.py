"""Export recordings as datasets for other programs."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.progress import Progress, silent
from ...store.build import Build
from ...training.data.dataset import Dataset
from ...training.data.dataset_checks import check_dataset
from ...training.data.problems import Problem
from ...training.data.time_alignment import align_samples
from ...training.fitting.prepare import load_prior, predict_recordings
from ...training.recordings import dataset_parquet, lerobot_export
from ...training.recordings.datasets import describe_files, load_dataset
from .options import ClockShift, DataFiles, ExportOptions


@dataclass(frozen=True)
class ExportedDataset:
    """A dataset that was written.

    Attributes:
        dataset: The dataset.
        problems: Its problems; those that forbid training come first.
        notes: What else the user should know.
    """

    dataset: Dataset
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]


def export_files(
    files: DataFiles,
    device: Device | None,
    options: ExportOptions,
    progress: Progress = silent,
) -> ExportedDataset:
    """Write data files as datasets; see `export_dataset`.

    Args:
        files: The data.
        device: The device to check against, if available.
        options: Formats and folders.
        progress: Called with the stage "data".

    Raises:
        TrainingError: Data cannot be read, or a folder exists and is not a dataset.
        StorageError: A folder cannot be written.
    """
    if files.is_empty:
        raise TrainingError(
            "there are no data to export",
            code="sources-missing",
            action="Give sessions, or signals with tracks",
        )
    _check_folders(options)
    progress("data", 0.0, "reading")
    build = None if device is None else Build(build_folder(device))
    dataset = load_dataset(files, device, build=build)
    return export_dataset(
        dataset, device, options, build=build, shift=files.shift, progress=progress
    )


def export_dataset(
    recorded: Dataset,
    device: Device | None,
    options: ExportOptions,
    *,
    build: Build | None = None,
    shift: ClockShift = DataFiles.shift,
    progress: Progress = silent,
) -> ExportedDataset:
    """Write a dataset into folders, for training elsewhere or later.

    Nothing is left out: problems are reported, and training decides.

    Args:
        recorded: The dataset as recorded.
        device: The device to check against, if available.
        options: Formats and folders.
        build: The device's build; by default that in its folder.
        shift: Time to add to the times of the samples, s, or "auto" to find it.
        progress: Called with the stage "data".

    Raises:
        TrainingError: A folder exists and is not a dataset.
        StorageError: A folder cannot be written.
    """
    _check_folders(options)
    if device is not None and build is None:
        build = Build(build_folder(device))
    dataset, shift_notes = align_samples(recorded, shift)
    progress("data", 0.5, "checking")
    prior, prior_notes = load_prior(dataset, device, "auto", build)
    problems = check_dataset(dataset, predicted=predict_recordings(prior, dataset))
    progress("data", 0.8, "writing")
    if options.out is not None:
        dataset_parquet.write_dataset(options.out, dataset)
    if options.lerobot is not None:
        lerobot_export.write_lerobot(options.lerobot, dataset, options.rate)
    progress("data", 1.0, "done")
    notes = (*describe_files(dataset), *shift_notes, *prior_notes)
    return ExportedDataset(dataset, problems, notes)


def _check_folders(options: ExportOptions) -> None:
    """Raise TrainingError if there is no output folder, or if one cannot be used."""
    if options.out is None and options.lerobot is None:
        raise TrainingError(
            "there is no output folder",
            code="output-missing",
            where="out",
            action="Give a folder for Parquet, one for LeRobot's format, or both",
        )
    if options.out is not None:
        dataset_parquet.check_folder(options.out)
    if options.lerobot is not None:
        lerobot_export.check_free(options.lerobot)
