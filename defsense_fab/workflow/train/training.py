"""Train models on files, datasets or a simulation, with metadata on their training."""

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
from ...decoding.quantities import COUNTS
from ...decoding.trained_model import TrainedModel
from ...store.build import Build
from ...store.layout import layout_hash
from ...training.data.dataset import Dataset, Recording, recording_fingerprint
from ...training.fitting.errors_by_unit import UnitErrors as UnitErrors
from ...training.fitting.errors_by_unit import errors_to_json as errors_to_json
from ...training.fitting.model_file import MODEL as MODEL
from ...training.fitting.model_file import write_model
from ...training.fitting.pose_signals import first_rest_signals
from ...training.fitting.prepare import prepare, simulated_prior
from ...training.fitting.train_model import CandidateResult, train
from ...training.fitting.train_model import Training as Training
from ...training.recordings.datasets import load_dataset
from ...training.regression.simulated_decoder import fit_simulated_model
from ...training.regression.simulation_prior import Prior
from .options import ClockShift, DataFiles, TrainOptions

#: Units of the numbers in a model.
UNITS = {
    "signals": "(R - R0)/R0, R0 being the resistance at rest",
    "positions": "mm in the device's rest frame",
    "time": "s",
}


@dataclass(frozen=True)
class TrainedFile:
    """A trained model and its file.

    Attributes:
        path: The file of the model.
        model: The model.
        training: The training with the errors of all decoders; None if the model was trained on
            the simulation only.
        notes: What else the user should know.
    """

    path: Path
    model: TrainedModel
    training: Training | None
    notes: tuple[str, ...] = ()


@one_blas_thread()
def train_files(
    files: DataFiles,
    device: Device | None = None,
    options: TrainOptions | None = None,
    *,
    out: Path | None = None,
    is_synchronized: bool = False,
    progress: Progress = silent,
) -> TrainedFile:
    """Train a model on files, or on the simulation of a device without any, and write it.

    Args:
        files: The training data.
        device: The device, if available; without data, its build must be complete.
        options: Options of the training.
        out: File of the model; None for `model.json` of the device or the first session.
        is_synchronized: As in `require_trainable`.
        progress: Called with the stages "data" and "train".

    Raises:
        TrainingError: Training is not possible.
        StorageError: The model cannot be written.
    """
    if files.is_empty and device is None:
        raise TrainingError(
            "there are no data to train on",
            code="sources-missing",
            action="Give sessions, signals with tracks, or a device to use its simulation",
        )
    path = choose_model_path(out, device, [p for p in files.sources if p.is_dir()])
    build = None if device is None else Build(build_folder(device))
    if files.is_empty:
        assert device is not None
        assert build is not None
        progress("train", 0.0, "the simulated states")
        model = simulate_only(device, build)
        write_model(path, model)
        return TrainedFile(path, model, None)
    progress("data", 0.0, "reading")
    training, notes = train_recordings(
        load_dataset(files, device, build=build),
        device,
        options,
        build=build,
        shift=files.shift,
        is_synchronized=is_synchronized,
        progress=progress,
    )
    write_model(path, training.model)
    return TrainedFile(path, training.model, training, notes)


@one_blas_thread()
def train_recordings(
    dataset: Dataset,
    device: Device | None = None,
    options: TrainOptions | None = None,
    *,
    build: Build | None = None,
    shift: ClockShift = DataFiles.shift,
    is_synchronized: bool = False,
    progress: Progress = silent,
) -> tuple[Training, tuple[str, ...]]:
    """Prepare a dataset, and train a model on it.

    Args:
        dataset: The dataset as recorded.
        device: The device, if available.
        options: Options of the training.
        build: The device's build; by default that in its folder.
        shift: Time to add to the times of the samples, s, or "auto" to find it.
        is_synchronized: As in `require_trainable`.
        progress: Called with the stages "data" and "train".

    Returns:
        The training, whose model has metadata, and notes on the data.

    Raises:
        TrainingError: Training is not possible.
    """
    options = options or TrainOptions()
    dataset, prior, notes = prepare(
        dataset,
        device,
        options,
        build=build,
        is_synchronized=is_synchronized,
        shift=shift,
        progress=progress,
    )
    return train_dataset(dataset, options, prior, progress), tuple(notes)


def train_dataset(
    dataset: Dataset,
    options: TrainOptions,
    prior: Prior | None = None,
    progress: Progress = silent,
) -> Training:
    """Train a model on a prepared dataset, with metadata.

    Args:
        dataset: The dataset.
        options: Options of the training.
        prior: Simulated states of the device, to start from.
        progress: Called with the stage "train".

    Returns:
        The training, whose model has metadata.

    Raises:
        TrainingError: There is too little to train on.
    """
    training = train(dataset, options, progress, prior)
    metadata = describe_training(training, dataset, options, prior)
    if dataset.readings is not None or dataset.targets is not None:
        metadata |= {"units": describe_units(dataset), "test": errors_to_json(training.test)}
    return replace(training, model=replace(training.model, metadata=metadata))


def simulate_only(device: Device, build: Build) -> TrainedModel:
    """Make a model of a built device without recordings, for the markers of its design.

    Args:
        device: The device.
        build: Its build, which is complete.

    Returns:
        The model, without intervals.

    Raises:
        StorageError: The layout or the simulation is missing.
    """
    layout, markers = build.layout, build.prediction.markers
    channels = tuple(record.name for record in layout.by_channel())
    prior = simulated_prior(device, channels, markers, build)
    ids = np.arange(len(markers))
    model = fit_simulated_model(device.name, layout_hash(layout), channels, ids, markers, prior)
    metadata = {**_origin(), "trained_on": f"{len(prior.names)} simulated states"}
    return replace(model, metadata=metadata)


def describe_training(
    training: Training, dataset: Dataset, options: TrainOptions, prior: Prior | None
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
        "usefulness": None if training.usefulness is None else training.usefulness.to_json(),
        "first_rest": first_rest_signals(dataset),
        "R0": {r.name: r.rest.tolist() for r in dataset.recordings},
        "sync_error": {r.name: r.sync_error for r in dataset.recordings},
        "provenance": dict(dataset.provenance),
    }


def describe_units(dataset: Dataset) -> dict[str, str]:
    """Return the units of the numbers in the model of any sensor, in words."""
    readings, targets = dataset.readings, dataset.targets
    units = dict(UNITS)
    if readings is not None:
        names = ", ".join(
            f"{channel} {unit}"
            for channel, unit in zip(dataset.channels, readings.units, strict=True)
        )
        units["readings"] = f"{names}; {COUNTS}: no unit given" if COUNTS in names else names
        units["signals"] = f"(reading - reference) / scale; reference: {readings.meaning}"
    if targets is not None:
        units["positions"] = ", ".join(
            f"{name} {unit or '(no unit given)'}"
            for name, unit in zip(targets.names, targets.units, strict=True)
        )
    return units


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


def choose_model_path(
    out: Path | None, device: Device | None = None, sources: Sequence[Path] = ()
) -> Path:
    """Return the file to write a model to.

    Args:
        out: The requested file or folder; None to choose one.
        device: The device, whose folder is the first choice.
        sources: Folders of sessions; the first one is the second choice.

    Returns:
        The file.

    Raises:
        TrainingError: Its folder does not exist, or it is not a .json file.
    """
    path = out or (device.source if device else sources[0] if sources else Path()) / MODEL
    path = path / MODEL if path.is_dir() else path
    if path.suffix != ".json":
        raise TrainingError(
            "is not a .json file",
            code="wrong-file-format",
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
