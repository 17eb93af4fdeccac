"""A model of files, from reading them to writing it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Device
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ..fitting.train_model import Training, TrainingOptions
from ..recordings.data_files import DataFiles
from .model_file import write_model
from .prepare import AUTO, prepare
from .train_device import model_path, train_dataset


@dataclass(frozen=True)
class TrainedFiles:
    """The model's file, the training, and what else is worth a word."""

    path: Path
    training: Training
    notes: tuple[str, ...]


@one_blas_thread()
def train_files(
    files: DataFiles, device: Device | None, how: TrainingOptions, *, out: Path | None = None,
    wanted: str = AUTO, without: Sequence[int] = (), in_step: bool = False,
    progress: Progress = silent,
) -> TrainedFiles:  # fmt: skip
    """Train on the `files`, `without` some markers, with the device's simulation if it is `wanted`
    and checked (`in_step` as in `dataset_checks.checked`), and write the model: to `out`, or as
    model.json of the device or the first session. Raises TrainingError, StorageError, and what the
    readers raise."""
    path = model_path(out, device, [p for p in files.sources if p.is_dir()])
    progress("data", 0.0, "reading")
    dataset, prior, notes = prepare(
        files.load(device), device, wanted=wanted, without=without, in_step=in_step,
        shift=files.shift, progress=progress,
    )  # fmt: skip
    training = train_dataset(dataset, how, prior, progress)
    write_model(path, training.model)
    return TrainedFiles(path, training, tuple(notes))
