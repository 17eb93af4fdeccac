"""Trained models on recorded sessions: each one's errors and their causes, and whether they
differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.storage.files import digest
from ...decoding.trained_model import TrainedModel
from ...store.layout import LayoutRecord
from ..data.dataset import Dataset, Recording, is_same_recording, recording_fingerprint
from ..data.dataset_assembly import exclude_uncertain_positions
from ..data.dataset_checks import check_dataset
from ..recordings.datasets import DataFiles, told_files
from ..recordings.session_dataset import device_layout
from .error_budget import ErrorBudget, error_budget
from .evaluate import Evaluation, evaluate
from .model_comparison import Comparison, FrameErrors, compare
from .predicted_error import PredictedError, predict_model_error
from .twin_truth import budget_of_truth

# Whether a device has the cords that a model was trained on, by their resistances at rest.

_DRIFT = 0.15  # of R0, by which a cord that is the same changes at most


def other_cords(name: str, model: TrainedModel, dataset: Dataset) -> list[str]:
    """Notes on channels whose R0 has changed since the model's training by more than the others'.
    Nothing is said of models of more than one built device, of other ones, or where an R0 is not
    known: signals without resistances are in units of R0."""
    before = np.array([r for r in model.told.get("R0", {}).values() if None not in r], float)
    if before.ndim != 2 or before.shape[1] != len(model.channels) or (before == 1).all():
        return []
    units = model.told.get("units_trained", [])
    out = []
    for session in dict.fromkeys(r.session for r in dataset.recordings):
        own = [r for r in dataset.recordings if r.session == session]
        if set(dataset.channels) != set(model.channels) or {r.unit for r in own} != set(units):
            continue
        order = [dataset.channels.index(c) for c in model.channels]
        R0 = np.median([r.rest[order] for r in own], axis=0)
        if not np.isfinite(R0).all() or (R0 <= 0).any() or (R0 == 1).all():
            continue
        change = np.log(R0) - np.log(np.median(before, axis=0))
        change -= np.median(change)
        for channel, off in zip(model.channels, change.tolist(), strict=True):
            if abs(off) > np.log1p(_DRIFT):
                out.append(
                    f"{session}: R0 of {channel} is {np.exp(off):.2f} times that which {name} was"
                    " trained with: was the cord replaced? 'defsense recalibrate' corrects the"
                    " model, or train again"
                )
    return out


_FEW = 200  # frames
#: Problems of data that is to be trained on, which say nothing of a test.
_TRAINING = ("too-few-frames", "few-frames", "markers-never-seen")
_TOLD = 0.01  # of the frames, that are worth a word
_ROUNDING = 1e-3  # s, by which times differ in other files


@dataclass(frozen=True)
class Evaluated:
    """A model by name, its errors, and what they come from; what was predicted of them, None where
    the model's training tells too little; what they come from by the truth that a twin's sessions
    have, None of others."""

    name: str
    model: TrainedModel
    evaluation: Evaluation
    budget: ErrorBudget
    predicted: PredictedError | None = None
    by_truth: ErrorBudget | None = None


@dataclass(frozen=True)
class SessionEvaluation:
    """Of `sessions` (names) the last share of the pictures; the model that was asked about first,
    those that it is compared with after it; `comparison` is None of one alone."""

    device: str
    sessions: tuple[str, ...]
    last_share: float
    models: tuple[Evaluated, ...]
    comparison: Comparison | None
    notes: tuple[str, ...]


def evaluate_files(
    models: Sequence[Path], files: DataFiles, device: Device | None = None,
    last_share: float | None = None, progress: Progress = silent,
) -> SessionEvaluation:  # fmt: skip
    """Of files of models, and of data, which is checked against the `device`, if it is given. Files
    of others that do not say of which device they are count as of the first model's. Raises
    TrainingError, and what the readers raise."""
    from ..models.model_file import load_model
    from ..models.prepare import AUTO, foretold, found_prior, told_uncertain

    progress("evaluate", 0.0, "reading")
    loaded = list(zip(_names(models), map(load_model, models), strict=True))
    dataset, uncertain = exclude_uncertain_positions(files.load(device, loaded[0][1].device))
    dataset, shifts = files.in_step(dataset)
    progress("evaluate", 0.1, "checking")
    prior, why = found_prior(dataset, device, AUTO)
    problems = check_dataset(dataset, predicted=foretold(prior, dataset))
    doubts = [str(p) for p in problems if p.code not in _TRAINING]
    for name, model in loaded:
        doubts += other_cords(name, model, dataset)
    found = evaluate_models(loaded, dataset, last_share, progress, device_layout(device))
    notes = [*found.notes, *told_uncertain(uncertain), *told_files(dataset), *shifts, *why, *doubts]
    return replace(found, notes=tuple(notes))


@one_blas_thread()
def evaluate_models(
    models: Sequence[tuple[str, TrainedModel]], dataset: Dataset, last_share: float | None = None,
    progress: Progress = silent, layout: LayoutRecord | None = None,
) -> SessionEvaluation:  # fmt: skip
    """Of models by name. Without a share, all pictures that none of them was trained on. With what
    the device's `layout` promises, if it is given. Raises TrainingError."""
    names = [name for name, _ in models]
    if len(set(names)) < len(names):
        raise TrainingError(f"{', '.join(names)}: give each model once")
    pictures, notes = dataset.frame_count, list[str]()
    if last_share is None:
        dataset = _not_trained_on([model for _, model in models], dataset)
        share, told = 1.0, dataset.frame_count / max(pictures, 1)
    else:
        share = told = last_share
        for name, model in models:
            own = [r.name for r in dataset.recordings if _held_out(model, r)]
            if own:
                notes.append(
                    f"{name} was trained on pictures of {', '.join(own)}, which makes it look"
                    " better than it is: leave --last-share out, or give another session"
                )
    found = []
    for k, (name, model) in enumerate(models):
        progress("evaluate", (k + 0.2) / len(models), f"{name}: errors")
        result = evaluate(model, dataset, share)
        progress("evaluate", (k + 0.4) / len(models), f"{name}: causes of errors")
        budget = error_budget(model, dataset, share)
        told_of = predict_model_error(model, result.frames, layout)
        truth = budget_of_truth(model, dataset, share)
        found.append(Evaluated(name, model, result, budget, told_of, truth))
    notes += _notes(found[0].evaluation)
    progress("evaluate", 0.95, "comparing")
    comparison = None
    if len(found) > 1:
        try:
            comparison = compare([_frame_errors(f) for f in found])
        except TrainingError as problem:  # the models' errors are worth telling without it
            notes.append(str(problem))
    if comparison is not None and comparison.by_block is None and not comparison.paired:
        notes.append(
            f"errors go on for so long (blocks of {comparison.block_frames} frames) that these sessions"
            " are too short to tell the models apart; record for longer"
        )
    progress("evaluate", 1.0, "done")
    sessions = tuple(dict.fromkeys(r.session for r in dataset.recordings))
    return SessionEvaluation(dataset.device, sessions, told, tuple(found), comparison, tuple(notes))


def _held_out(model: TrainedModel, r: Recording) -> list[float]:
    """Since when, s, a training of the model held its pictures out, infinite where it held none
    out; empty where it was not trained on the recording."""
    own = recording_fingerprint(r)
    return [
        np.inf if known["after"] is None else r.time[0] + known["after"]
        for known in model.told.get("held_out", ())
        if is_same_recording(own, known["fingerprint"])
    ]


def _not_trained_on(models: Sequence[TrainedModel], dataset: Dataset) -> Dataset:
    """Without pictures that one of the models was trained on. Raises TrainingError where none are
    left."""
    out = []
    for r in dataset.recordings:
        held = [since for model in models for since in _held_out(model, r)]
        begin = max(held, default=-np.inf) - _ROUNDING
        keep = r.time >= begin
        if keep.any():
            out.append(
                replace(r, time=r.time[keep], points=r.points[keep], sigma=r.sigma[keep])
                if held else r
            )  # fmt: skip
    if not out:
        raise TrainingError(
            f"{dataset.device}: the model was trained on all of these pictures; record another"
            " session to test it on"
        )
    return replace(dataset, recordings=tuple(out))


def _frame_errors(found: Evaluated) -> FrameErrors:
    frames = found.evaluation.frames
    test = digest(frames.run.tolist(), frames.time.tolist())
    return FrameErrors(found.name, frames.frame_error, frames.run, test)


def _notes(found: Evaluation) -> list[str]:
    frames, out = found.frames, []
    if frames.without_samples > _TOLD * len(frames.time):
        out.append(f"{frames.without_samples} pictures without samples of all channels were left"
                   " out")  # fmt: skip
    if frames.without_markers > _TOLD * len(frames.time):
        out.append(f"{frames.without_markers} pictures without markers were left out")
    if not frames.visible.any(axis=0).all():
        out.append(f"{int((~frames.visible.any(axis=0)).sum())} markers were never seen")
    if len(frames.time) < _FEW:
        out.append(f"{len(frames.time)} frames are few: record for longer")
    if found.outside is not None and found.outside.frames > 0.1 * found.total.frames:
        out.append(
            f"{found.outside.frames / found.total.frames:.0%} of the frames lie beyond what the"
            " model was trained on"
        )
    return out


def _names(models: Sequence[Path]) -> list[str]:
    """Short ones that differ: of the files, of their folders, or the paths as they are."""
    stems = [p.resolve().parent.name if p.stem == "model" and not p.is_dir() else p.stem
             for p in models]  # fmt: skip
    return stems if len(set(stems)) == len(stems) else [str(p) for p in models]
