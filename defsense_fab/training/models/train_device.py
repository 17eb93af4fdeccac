"""Train models from files or datasets as the command does, with metadata on their training."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.version import __version__
from ...decoding.trained_model import TrainedModel
from ...store.layout import layout_hash, load_layout, load_prediction
from ..data.dataset import Dataset, Recording, recording_fingerprint
from ..fitting.pose_signals import first_rest_signals
from ..fitting.train_model import CandidateResult, Training, TrainingOptions, train
from ..recordings.datasets import DataFiles
from ..regression.simulated_decoder import fit_simulated_model
from ..regression.simulation_prior import Prior
from .model_file import MODEL, write_model
from .prepare import AUTO, prepare, simulated_prior

#: Units of the numbers in a model.
UNITS = {
    "signals": "(R - R0)/R0, R0 being the resistance at rest",
    "positions": "mm in the device's rest frame",
    "time": "s",
}


@dataclass(frozen=True)
class TrainedFiles:
    """A model trained from files.

    Attributes:
        path: The file of the model.
        training: The training.
        notes: What else the user should know.
    """

    path: Path
    training: Training
    notes: tuple[str, ...]


@one_blas_thread()
def train_files(
    files: DataFiles,
    device: Device | None,
    options: TrainingOptions,
    *,
    out: Path | None = None,
    prior_mode: str = AUTO,
    excluded_markers: Sequence[int] = (),
    is_synchronized: bool = False,
    progress: Progress = silent,
) -> TrainedFiles:
    """Train a model from files, and write it.

    Args:
        files: The training data.
        device: The device, if available.
        options: Options of the training.
        out: File of the model; None for `model.json` of the device or the first session.
        prior_mode: Whether to use the device's simulation: "auto", "yes" or "no".
        excluded_markers: Numbers of markers to leave out.
        is_synchronized: As in `require_trainable`.
        progress: Called with the stages "data" and "train".

    Returns:
        The training and the model's file.

    Raises:
        TrainingError: If training is not possible.
        StorageError: If the model cannot be written.
    """
    path = choose_model_path(out, device, [p for p in files.sources if p.is_dir()])
    progress("data", 0.0, "reading")
    dataset, prior, notes = prepare(
        files.load(device),
        device,
        prior_mode=prior_mode,
        excluded_markers=excluded_markers,
        is_synchronized=is_synchronized,
        shift=files.shift,
        progress=progress,
    )
    training = train_dataset(dataset, options, prior, progress)
    write_model(path, training.model)
    return TrainedFiles(path, training, tuple(notes))


def train_dataset(
    dataset: Dataset,
    options: TrainingOptions,
    prior: Prior | None = None,
    progress: Progress = silent,
) -> Training:
    """Train a model from a dataset, with metadata.

    Args:
        dataset: The dataset.
        options: Options of the training.
        prior: Simulated states of the device, to start from.
        progress: Called with the stage "train".

    Returns:
        The training, whose model has metadata.

    Raises:
        TrainingError: If there is too little to train on.
    """
    training = train(dataset, options, progress, prior)
    metadata = describe_training(training, dataset, options, prior)
    return replace(training, model=replace(training.model, metadata=metadata))


def simulate_only(device: Device) -> TrainedModel:
    """Make a model of a built device without recordings, for the markers of its design.

    Args:
        device: The device, whose build is complete.

    Returns:
        The model, without intervals.

    Raises:
        TrainingError: If the layout or the simulation is missing.
    """
    folder = build_folder(device)
    layout, markers = load_layout(folder, TrainingError), load_prediction(folder).markers
    channels = tuple(record.name for record in layout.by_channel())
    prior = simulated_prior(device, channels, markers)
    ids = np.arange(len(markers))
    model = fit_simulated_model(device.name, layout_hash(layout), channels, ids, markers, prior)
    metadata = {**_origin(), "trained_on": f"{len(prior.names)} simulated states, no picture"}
    return replace(model, metadata=metadata)


def describe_training(
    training: Training, dataset: Dataset, options: TrainingOptions, prior: Prior | None
) -> dict[str, Any]:
    """Return the metadata of a training in plain values, for the model's file and `--json`."""
    frames, test_frames = training.training_frames, training.test_frames
    wrong = training.wrong_markers.sum() / max(int(frames.visible.sum()), 1)
    wrong_tested = training.wrong_test_markers.sum() / max(int(test_frames.visible.sum()), 1)
    repeatability = training.repeatability
    return {
        **_origin(),
        "decoder": training.selected,
        "options": asdict(options),
        "pictures": {"trained": len(frames), "tested": len(test_frames)},
        "wrong_markers": float(wrong),
        "wrong_markers_tested": float(wrong_tested),
        "simulated_states": 0 if prior is None else len(prior.names),
        "candidates": [candidate_to_json(c) for c in training.candidates],
        "sessions": sorted({r.session for r in dataset.recordings}),
        "units_trained": sorted({r.unit for r in dataset.recordings}),
        "runs": [r.name for r in dataset.recordings],
        "data": {r.name: recording_hash(r) for r in dataset.recordings},
        "held_out": _held_out(training, dataset),
        "repeatability": None if repeatability is None else asdict(repeatability),
        "first_rest": first_rest_signals(dataset),
        "R0": {r.name: r.rest.tolist() for r in dataset.recordings},
        "sync_error": {r.name: r.sync_error for r in dataset.recordings},
        "provenance": dict(dataset.provenance),
    }


def candidate_to_json(result: CandidateResult) -> Mapping[str, Any]:
    """Return the errors of a candidate in plain values; lengths in mm."""
    test = result.test
    errors = None
    if test is not None:
        errors = {
            "rmse": test.rmse,
            "sd": float(test.per_state.std()),
            "peak": test.peak,
            "average_peak": test.average_peak,
        }
    return {
        "decoder": result.name,
        "features": result.features,
        "lambda": result.lambda_ if np.isfinite(result.lambda_) else None,
        "noise": result.noise if np.isfinite(result.noise) else None,
        "memory": list(result.moved),
        "work": list(result.worked),
        "folds": result.folds.tolist(),
        "cross_validated": result.cross_validated,
        "test": errors,
    }


def recording_hash(r: Recording) -> str:
    """Return a hash of a recording's content that does not depend on the order of its channels."""
    columns = sorted(hashlib.sha256(c.tobytes()).hexdigest() for c in r.ohm.T.copy())
    return hashlib.sha256("".join(columns).encode() + r.time.tobytes()).hexdigest()


def choose_model_path(out: Path | None, device: Device | None, sources: list[Path]) -> Path:
    """Return the file to write a model to.

    Args:
        out: The requested file or folder; None to choose one.
        device: The device, whose folder is the first choice.
        sources: Folders of sessions; the first one is the second choice.

    Returns:
        The file.

    Raises:
        TrainingError: If its folder does not exist, or it is not a .json file.
    """
    path = out or (device.source if device else sources[0] if sources else Path()) / MODEL
    path = path / MODEL if path.is_dir() else path
    if path.suffix != ".json":
        raise TrainingError(
            "is not a .json file",
            code="wrong-file-kind",
            where=path,
            action="Name the model's file with the ending .json",
        )
    if not path.parent.is_dir():
        raise TrainingError(
            f"the folder {path.parent} does not exist",
            code="folder-not-found",
            where=path,
            action="Create it, or choose another",
        )
    return path


def _origin() -> dict[str, Any]:
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "libraries": {name: version(name) for name in ("numpy", "scipy", "numba")},
        "units": UNITS,
    }


def _held_out(training: Training, dataset: Dataset) -> list[Mapping[str, Any]]:
    """Return when the test frames of each recording start, in s after its first frame.

    It is None for a recording all of whose frames were used for training.
    """
    index, time = training.test_frames.recording_index, training.test_frames.time
    return [
        {
            "run": r.name,
            "fingerprint": recording_fingerprint(r),
            "after": float(time[index == k][0] - r.time[0]) if (index == k).any() else None,
        }
        for k, r in enumerate(dataset.recordings)
    ]
