"""Evaluate model files on recordings, and write the report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...capture.sessions.results import QUALITY
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.progress import Progress, silent
from ...decoding.trained_model import TrainedModel
from ...report.evaluation import data_files
from ...report.evaluation.evaluation_report import PAGE, check_folder, verdict, write_evaluation
from ...store.build import Build
from ...training.data.dataset import Dataset
from ...training.data.dataset_assembly import exclude_channels, exclude_uncertain_positions
from ...training.data.dataset_checks import check_dataset
from ...training.data.time_alignment import align_samples
from ...training.evaluation.evaluate import Measures as Measures
from ...training.evaluation.evaluate_models import (
    SessionEvaluation,
    evaluate_models,
    note_changed_cords,
)
from ...training.fitting.model_file import load_model
from ...training.fitting.prepare import describe_uncertain, load_prior, predict_recordings
from ...training.recordings.datasets import describe_files, device_layout, load_dataset
from .options import ClockShift, DataFiles, EvaluateOptions
from .twin_likeness import compare_with_twins

#: Codes of problems that matter for training data, but not for test data.
_TRAINING_CODES = ("too-few-frames", "few-frames", "markers-never-seen")


@dataclass(frozen=True)
class WrittenEvaluation:
    """An evaluation and its report.

    Attributes:
        folder: Folder of the report.
        result: The evaluation.
        expected: How the first model's error compares with the one that its design expects after
            training; empty if the design is unknown.
    """

    folder: Path
    result: SessionEvaluation
    expected: str = ""

    @property
    def page(self) -> Path:
        """The report's page."""
        return self.folder / PAGE

    @property
    def verdict(self) -> str:
        """Whether the models differ, as a sentence; empty for a single model."""
        comparison = self.result.comparison
        return "" if comparison is None else verdict(comparison)

    @property
    def useless(self) -> str:
        """Which models are useless and why, as sentences; empty if all are useful."""
        judged = [(m.name, m.usefulness) for m in self.result.models if m.usefulness is not None]
        return " ".join(f"{name}: {u.message}" for name, u in judged if u.is_useless)

    @property
    def published_errors(self) -> dict[str, Any]:
        """The errors that DefSense's Table 1 states, by name; none for other devices."""
        rows = data_files.published_errors(self.result)
        return {f"paper: {name}": row for name, row in rows.items()}

    @property
    def publication(self) -> str:
        """Where those errors were published."""
        return data_files.SOURCE

    def to_json(self) -> dict[str, Any]:
        """Return all numbers in plain values."""
        numbers = data_files.as_data(self.result)
        return {"folder": str(self.folder), "expected": self.expected or None, **numbers}


def evaluate(
    model: Path,
    files: DataFiles,
    device: Device | None = None,
    options: EvaluateOptions | None = None,
    progress: Progress = silent,
) -> WrittenEvaluation:
    """Evaluate models on data files, and write a report.

    Args:
        model: File of the model, or its folder.
        files: The data. Files that do not name their device count as the model's.
        device: The device to check the data against, if available.
        options: Options of the evaluation.
        progress: Called with the stages "evaluate" and "report".

    Raises:
        TrainingError: A file cannot be read, models and data do not match, or the output folder
            contains something else.
        StorageError: The report cannot be written.
    """
    options = options or EvaluateOptions()
    parent = model if model.is_dir() else model.parent
    folder = options.out or parent / "evaluation"
    check_folder(folder)
    models = (model, *options.against)
    result = evaluate_files(models, files, device, options.last_share, progress)
    expected = "" if device is None else compare_with_design(result, Build(build_folder(device)))
    progress("report", 0.0, "figures and tables")
    write_evaluation(folder, result, expected)
    progress("report", 1.0, "done")
    return WrittenEvaluation(folder, result, expected)


def compare_with_design(result: SessionEvaluation, build: Build) -> str:
    """Return how the first model's error compares with the one expected after training.

    The noise of the cameras is not part of it. Sessions of a twin are compared with the error that
    is expected with its family of cords.

    Args:
        result: The evaluation.
        build: The build of the device.

    Returns:
        A sentence; empty if the model is not of the build's layout.
    """
    first = result.models[0]
    if first.predicted is None or first.predicted.design is None:
        return ""
    evaluation = first.evaluation
    without_noise = evaluation.rmse_without_noise
    measured = evaluation.total.rmse if without_noise is None else without_noise
    if not measured > 0:
        return ""
    return build.layout.band.compare_measured(measured, _twin_family(result.sessions))


def _twin_family(sessions: Sequence[str]) -> str:
    """Return the family of the cords of a twin's sessions; empty of others or of several."""
    families = set()
    for session in sessions:
        path = Path(session) / QUALITY
        twin = json.loads(path.read_text(encoding="utf-8")).get("twin") if path.is_file() else None
        families.add(str(twin["cords"]) if isinstance(twin, dict) and "cords" in twin else "")
    return families.pop() if len(families) == 1 else ""


def evaluate_files(
    models: Sequence[Path],
    files: DataFiles,
    device: Device | None = None,
    last_share: float | None = None,
    progress: Progress = silent,
) -> SessionEvaluation:
    """Evaluate model files on data files.

    Args:
        models: Files of the models, the one of interest first.
        files: The data. Files that do not name their device count as the first model's.
        device: The device to check the data against, if available.
        last_share: As in `evaluate_models`.
        progress: Called with the stage "evaluate".

    Returns:
        The evaluation, with notes on the data.

    Raises:
        TrainingError: A file cannot be read, or models and data do not match.
    """
    if files.is_empty:
        raise TrainingError(
            "there are no data to test on",
            code="sources-missing",
            action="Give sessions, or signals with tracks",
        )
    progress("evaluate", 0.0, "reading")
    loaded = list(zip(short_names(models), map(load_model, models), strict=True))
    build = None if device is None else Build(build_folder(device))
    recorded = load_dataset(files, device, build=build, fallback_device=loaded[0][1].device)
    return evaluate_recordings(
        loaded,
        recorded,
        device,
        last_share,
        build=build,
        shift=files.shift,
        progress=progress,
    )


def evaluate_recordings(
    models: Sequence[tuple[str, TrainedModel]],
    recorded: Dataset,
    device: Device | None = None,
    last_share: float | None = None,
    *,
    build: Build | None = None,
    shift: ClockShift = DataFiles.shift,
    progress: Progress = silent,
) -> SessionEvaluation:
    """Evaluate models on a dataset as recorded.

    Args:
        models: The models by name, the one of interest first.
        recorded: The dataset.
        device: The device to check the data against, if available.
        last_share: As in `evaluate_models`.
        build: The device's build; by default that in its folder.
        shift: Time to add to the times of the samples, s, or "auto" to find it.
        progress: Called with the stage "evaluate".

    Returns:
        The evaluation, with notes on the data.

    Raises:
        TrainingError: Models and data do not match.
    """
    if device is not None and build is None:
        build = Build(build_folder(device))
    recorded = _select_used_channels(recorded, [model for _, model in models])
    dataset, uncertain = exclude_uncertain_positions(recorded)
    dataset, shift_notes = align_samples(dataset, shift)
    progress("evaluate", 0.1, "checking")
    prior, prior_notes = load_prior(dataset, device, "auto", build)
    problems = check_dataset(dataset, predicted=predict_recordings(prior, dataset))
    doubts = [str(p) for p in problems if p.code not in _TRAINING_CODES]
    for name, model in models:
        doubts += note_changed_cords(name, model, dataset)
    layout = device_layout(device, build)
    result = evaluate_models(models, dataset, last_share, progress, layout, prior)
    notes = [
        *result.notes,
        *describe_uncertain(uncertain),
        *describe_files(dataset),
        *shift_notes,
        *prior_notes,
        *doubts,
    ]
    likeness = compare_with_twins(dataset, device)
    return replace(result, notes=tuple(notes), likeness=likeness)


def _select_used_channels(dataset: Dataset, models: Sequence[TrainedModel]) -> Dataset:
    """Return a dataset of any sensor with the channels that a model uses."""
    used = {name for model in models for name in model.channels}
    unused = [name for name in dataset.channels if name not in used]
    if dataset.readings is None or not unused or len(unused) == len(dataset.channels):
        return dataset
    return exclude_channels(dataset, unused)


def short_names(models: Sequence[Path]) -> list[str]:
    """Return short distinct names: of the files, of their folders, or the paths themselves."""
    names = [
        p.resolve().parent.name if p.stem == "model" and not p.is_dir() else p.stem for p in models
    ]
    return names if len(set(names)) == len(names) else [str(p) for p in models]
