"""Long tasks of the Measure mode, which run in a child process; each does what a command does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.progress import Progress

#: Lengths of the simulated specimens, mm.
SPECIMEN_LENGTHS_MM = (150.0, 200.0)
#: Start of the names of their sessions' folders.
SIMULATED_PREFIX = "specimen-twin"
_SPECIMEN_SPREAD = 0.02  # relative, of the simulated cords
_FIRST_SPECIMEN_SEED = 1000


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
        rmse: Root mean square error of the markers, mm.
        deviation: Its standard deviation, mm.
        peak: Largest error, mm.
        average_peak: Average of the largest errors of the frames, mm.
        frames: Number of frames.
        notes: Notes on the evaluation.
    """

    page: str
    rmse: float
    deviation: float
    peak: float
    average_peak: float
    frames: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class FitResult:
    """A fitted response of the cord.

    Attributes:
        path: File of the response.
        page: File of the report.
        data: Content of the response's file.
    """

    path: str
    page: str
    data: Mapping[str, Any]


def record_twin(
    folder: Path, minutes: float, unit: int, seed: int, progress: Progress
) -> list[str]:
    """Record simulated sessions, as `defsense twin` does.

    Args:
        folder: Folder of the device.
        minutes: Duration of the movement, minutes.
        unit: Number of the simulated built device.
        seed: Seed of the movement.
        progress: Called with the progress.

    Returns:
        Folders of the sessions.
    """
    from ...core.device.device_file import load_device
    from ...twin.recordings.twin_recordings import simulate_runs
    from ...workflow.sessions.twin_sessions import check_free, session_folder, write_sessions

    device = load_device(folder)
    out = session_folder(device, unit, seed)
    check_free(out, 1)
    runs = simulate_runs(device, seconds=60 * minutes, seed=seed, unit=unit, progress=progress)
    return [str(path) for path in write_sessions(out, device, runs, progress)]


def process(sessions: Sequence[Path], progress: Progress) -> list[str]:
    """Process recorded sessions, as `defsense capture process` does.

    Args:
        sessions: Folders of the sessions.
        progress: Called with the progress.

    Returns:
        Lines about each session in markdown.
    """
    from ...capture.sessions.results import REPORT
    from ...workflow.sessions.processing import process_session

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
    """Train a model on sessions, as `defsense train` does.

    Args:
        folder: Folder of the device.
        sessions: Folders of the sessions.
        progress: Called with the progress.
    """
    from ...core.device.device_file import load_device
    from ...training.fitting.train_model import TrainingOptions
    from ...training.models.train_device import train_files
    from ...training.recordings.datasets import DataFiles

    files = DataFiles(tuple(sessions))
    trained = train_files(files, load_device(folder), TrainingOptions(), progress=progress)
    return TrainingResult(
        str(trained.path.resolve()), trained.training.model.metadata, tuple(trained.notes)
    )


def train_on_simulation(folder: Path, progress: Progress) -> TrainingResult:
    """Train a model on the simulated states alone, as `defsense train` does without a session.

    Args:
        folder: Folder of the device.
        progress: Called with the progress.
    """
    from ...core.device.device_file import load_device
    from ...training.models.model_file import write_model
    from ...training.models.train_device import choose_model_path, simulate_only

    device = load_device(folder)
    progress("train", 0.0, "the simulated states")
    path, model = choose_model_path(None, device, []), simulate_only(device)
    write_model(path, model)
    return TrainingResult(str(path.resolve()), model.metadata)


def evaluate(
    folder: Path, model: Path, sessions: Sequence[Path], progress: Progress
) -> EvaluationResult:
    """Evaluate a model on sessions, as `defsense evaluate` does.

    Args:
        folder: Folder of the device.
        model: File of the model.
        sessions: Folders of the sessions.
        progress: Called with the progress.
    """
    from ...core.device.device_file import load_device
    from ...report.evaluation.evaluation_report import PAGE, check_folder, write_evaluation
    from ...training.evaluation.evaluate_models import evaluate_files
    from ...training.recordings.datasets import DataFiles

    out = model.parent / "evaluation"
    check_folder(out)
    evaluation = evaluate_files(
        [model], DataFiles(tuple(sessions)), load_device(folder), progress=progress
    )
    progress("report", 0.0, "figures and tables")
    write_evaluation(out, evaluation)
    total = evaluation.models[0].evaluation.total
    return EvaluationResult(
        page=str((out / PAGE).resolve()),
        rmse=total.rmse,
        deviation=total.deviation,
        peak=total.peak,
        average_peak=total.average_peak,
        frames=total.frames,
        notes=tuple(evaluation.notes),
    )


def simulate_specimens(folder: Path, progress: Progress) -> list[str]:
    """Record simulated specimens of the device's cord, as `defsense calibrate twin` does.

    Args:
        folder: Folder of the device.
        progress: Called with the progress.

    Returns:
        Names of the sessions' folders.
    """
    from ...core.device.device_file import load_device
    from ...sensing.response import build_response
    from ...twin.calibration_session import record_twin
    from ...twin.electronics.cords import CordTraits

    response = build_response(load_device(folder).cord.response)
    traits = CordTraits(response, spread=_SPECIMEN_SPREAD)
    names = []
    for n, length in enumerate(SPECIMEN_LENGTHS_MM):
        progress("specimen", n / len(SPECIMEN_LENGTHS_MM), f"{length:g} mm long")
        session = folder / f"{SIMULATED_PREFIX}-{length:g}"
        record_twin(session, traits, seed=_FIRST_SPECIMEN_SEED + n, length=length)
        names.append(session.name)
    return names


def fit(sessions: Sequence[Path], out: Path, progress: Progress) -> FitResult:
    """Fit the response of the cord to sessions on specimens, as `defsense calibrate fit` does.

    Args:
        sessions: Folders of the sessions.
        out: File of the response.
        progress: Called with the progress.
    """
    from ...workflow.calibrate.fit_response import fit_response

    fitted = fit_response(sessions, out=out, progress=progress)
    return FitResult(str(out), str(out.with_suffix(".html").resolve()), fitted.data)
