"""Tasks of the Measure mode whose results are reduced to what crosses a process boundary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ....core.progress import Progress
from ....workflow.train.options import DataFiles, TwinOptions

if TYPE_CHECKING:
    from ....workflow.train.evaluation import Measures


@dataclass(frozen=True)
class TrainingResult:
    """A trained model.

    Attributes:
        path: File of the model.
        metadata: Metadata of its training.
        notes: Notes on the training.
    """

    path: str
    metadata: Mapping[str, Any]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class EvaluationResult:
    """Errors of a model on images that were not used for training.

    Attributes:
        page: File of the report.
        total: Errors over all images, mm.
        notes: Notes on the evaluation.
    """

    page: str
    total: Measures
    notes: tuple[str, ...] = ()


def record_twin(folder: Path, options: TwinOptions, progress: Progress) -> list[str]:
    """Record simulated sessions of the device in a folder; return their folders."""
    from ....core.device.device_file import load_device
    from ....workflow.train.twin import simulate_recordings

    written = simulate_recordings(load_device(folder), options, progress=progress)
    return [str(path) for path in written.folders]


def make_tags(folder: Path, progress: Progress) -> list[str]:
    """Write the tags of the device in a folder, as `defsense capture markers` does.

    Returns:
        Notes on the tags.
    """
    from ....core.device.device_file import load_device
    from ....workflow.tags.markers import write_markers

    return list(write_markers(load_device(folder), progress=progress).notes)


def process(sessions: Sequence[Path], progress: Progress) -> list[str]:
    """Process recorded sessions, as `defsense capture process` does.

    Args:
        sessions: Folders of the sessions.
        progress: Called with the progress.

    Returns:
        Lines about each session in markdown.
    """
    from ....workflow.sessions.processing import REPORT, process_session

    lines = []
    for folder in sessions:
        quality = process_session(folder, progress=progress).quality
        lines.append(
            f"`{folder.name}`: {quality['frames']} frames, {quality['aligned_frames']:.0%} of them"
            f" aligned to rest by {quality['aligned_by']}. Report: `{(folder / REPORT).resolve()}`"
        )
        lines += [f"`{folder.name}`: {warning}" for warning in quality["warnings"]]
    return lines


def train(folder: Path, sessions: Sequence[Path], progress: Progress) -> TrainingResult:
    """Train a model of the device in a folder on sessions, or on the simulation without any."""
    from ....core.device.device_file import load_device
    from ....workflow.train.training import train_files

    trained = train_files(DataFiles(tuple(sessions)), load_device(folder), progress=progress)
    return TrainingResult(str(trained.path.resolve()), trained.model.metadata, trained.notes)


def evaluate(
    folder: Path, model: Path, sessions: Sequence[Path], progress: Progress
) -> EvaluationResult:
    """Evaluate a model file of the device in a folder on sessions."""
    from ....core.device.device_file import load_device
    from ....workflow.train.evaluation import evaluate as evaluate_model

    files = DataFiles(tuple(sessions))
    evaluation = evaluate_model(model, files, load_device(folder), progress=progress)
    result = evaluation.result
    total = result.models[0].evaluation.total
    return EvaluationResult(str(evaluation.page.resolve()), total, result.notes)
