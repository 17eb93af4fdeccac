"""Training as the command runs it: models with what there is to tell of them."""

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
from .model_file import write_model
from .prepare import AUTO, prepare, simulated_prior

# A model of files, from reading them to writing it.


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


#: In which units the numbers of a model are.
UNITS = {
    "signals": "(R - R0)/R0, R0 being the resistance at rest",
    "positions": "mm in the device's rest frame",
    "time": "s",
}


def train_dataset(
    dataset: Dataset, options: TrainingOptions, prior: Prior | None = None,
    progress: Progress = silent,
) -> Training:  # fmt: skip
    """The training, its model with what there is to tell of it. Raises TrainingError."""
    result = train(dataset, options, progress, prior)
    told = told_of(result, dataset, options, prior)
    return replace(result, model=replace(result.model, told=told))


def simulate_only(device: Device) -> TrainedModel:
    """A model of a built device before the first picture, for its design's own markers. Raises
    TrainingError."""
    folder = build_folder(device)
    layout, markers = load_layout(folder, TrainingError), load_prediction(folder).markers
    channels = tuple(record.name for record in layout.by_channel())
    prior = simulated_prior(device, channels, markers)
    ids = np.arange(len(markers))
    model = fit_simulated_model(device.name, layout_hash(layout), channels, ids, markers, prior)
    told = {**_origin(), "trained_on": f"{len(prior.names)} simulated states, no picture"}
    return replace(model, told=told)


def _origin() -> dict[str, Any]:
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "libraries": {name: version(name) for name in ("numpy", "scipy", "numba")},
        "units": UNITS,
    }


def told_of(
    result: Training, dataset: Dataset, options: TrainingOptions, prior: Prior | None
) -> dict[str, Any]:
    """What there is to know of a training, in plain values: for the model's file and `--json`."""
    trained = result.training_frames
    return {
        **_origin(),
        "decoder": result.selected,
        "options": asdict(options),
        "pictures": {"trained": len(trained), "tested": len(result.test_frames)},
        "wrong_markers": float(result.wrong_markers.sum() / max(int(trained.visible.sum()), 1)),
        "wrong_markers_tested": float(
            result.wrong_test_markers.sum() / max(int(result.test_frames.visible.sum()), 1)
        ),
        "simulated_states": 0 if prior is None else len(prior.names),
        "candidates": [row(a) for a in result.candidates],
        "sessions": sorted({r.session for r in dataset.recordings}),
        "units_trained": sorted({r.unit for r in dataset.recordings}),
        "runs": [r.name for r in dataset.recordings],
        "data": {r.name: recording_hash(r) for r in dataset.recordings},
        "held_out": _held_out(result, dataset),
        "repeatability": None if result.repeatability is None else asdict(result.repeatability),
        "first_rest": first_rest_signals(dataset),
        "R0": {r.name: r.rest.tolist() for r in dataset.recordings},
        "sync_error": {r.name: r.sync_error for r in dataset.recordings},
        "provenance": dict(dataset.provenance),
    }


def recording_hash(r: Recording) -> str:
    """Of what is in it, whatever order its channels are in."""
    columns = sorted(hashlib.sha256(c.tobytes()).hexdigest() for c in r.ohm.T.copy())
    return hashlib.sha256("".join(columns).encode() + r.time.tobytes()).hexdigest()


def _held_out(result: Training, dataset: Dataset) -> list[Mapping[str, Any]]:
    """Of each recording how long after its first picture, s, pictures were held out; None: all
    were trained on."""
    tested, time = result.test_frames.recording_index, result.test_frames.time
    return [
        {
            "run": r.name,
            "fingerprint": recording_fingerprint(r),
            "after": float(time[tested == k][0] - r.time[0]) if (tested == k).any() else None,
        }
        for k, r in enumerate(dataset.recordings)
    ]


def row(attempt: CandidateResult) -> Mapping[str, Any]:
    """A candidate, in plain values; lengths in mm."""
    test = attempt.test
    return {
        "decoder": attempt.name,
        "features": attempt.features,
        "lambda": attempt.lambda_ if np.isfinite(attempt.lambda_) else None,
        "noise": attempt.noise if np.isfinite(attempt.noise) else None,
        "memory": list(attempt.moved),
        "work": list(attempt.worked),
        "folds": attempt.folds.tolist(),
        "cross_validated": attempt.cross_validated,
        "test": None
        if test is None
        else {
            "rmse": test.rmse,
            "sd": float(test.per_state.std()),
            "peak": test.peak,
            "average_peak": test.average_peak,
        },
    }


def model_path(out: Path | None, device: Device | None, sources: list[Path]) -> Path:
    """Where the model goes: where it was asked for, or into the device's folder, or the session's.
    Raises TrainingError where its folder is not there."""
    from .model_file import MODEL

    path = out or (device.source if device else sources[0] if sources else Path()) / MODEL
    path = path / MODEL if path.is_dir() else path
    if path.suffix != ".json":
        raise TrainingError(f"{path}: a model is a .json file")
    if not path.parent.is_dir():
        raise TrainingError(f"{path}: there is no folder {path.parent}; make it, or choose another")
    return path
