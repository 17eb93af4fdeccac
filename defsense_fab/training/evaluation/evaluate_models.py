"""Evaluate trained models on recorded data: errors, their causes, and whether models differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.errors import TrainingError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...decoding.trained_model import TrainedModel
from ...store.layout import LayoutRecord
from ..data.dataset import Dataset, Recording, is_same_recording, recording_fingerprint
from ..fitting.errors_by_unit import UnitErrors, unit_errors
from ..fitting.usefulness import Usefulness
from ..fitting.useless_causes import judge_model
from ..regression.frames import MIN_FRAMES, Frames
from ..regression.simulation_prior import Prior
from .cord_character import TwinLikeness
from .decoded_frames import match_channels, match_to_model
from .error_budget import ErrorBudget, error_budget
from .evaluate import Evaluation, evaluate
from .model_comparison import Comparison, compare
from .predicted_error import PredictedError, predict_model_error
from .twin_truth import budget_of_truth

_MIN_FRAMES = 200  # fewer are noted
_MIN_LEFT_OUT_SHARE = 0.01  # of the frames; a smaller share is not noted
_MIN_BEYOND_SHARE = 0.1  # of the frames beyond the trained range; a smaller share is not noted
_MIN_BEYOND_RATIO = 1.25  # of the errors beyond and within the range; a smaller one is not noted
_TIME_ROUNDING_S = 1e-3  # by which times differ in other files
_MAX_REST_CHANGE = 0.15  # of R0, by which the same cord changes at most


@dataclass(frozen=True)
class Evaluated:
    """An evaluated model.

    Attributes:
        name: Name of the model.
        model: The model.
        evaluation: Its errors.
        budget: Its errors by cause.
        predicted: Its predicted error; None if its training did not measure repeatability.
        by_truth: Its errors by cause from the truth of a twin's sessions; None for other data.
        usefulness: Its error compared with the movement; None for few frames.
        errors: Errors and coverage of its targets. A model of targets in several units is evaluated
            once for each unit.
    """

    name: str
    model: TrainedModel
    evaluation: Evaluation
    budget: ErrorBudget
    predicted: PredictedError | None = None
    by_truth: ErrorBudget | None = None
    usefulness: Usefulness | None = None
    errors: UnitErrors | None = None

    @property
    def grade(self) -> str:
        """Its error with its share of the movement and its grade, in words; empty for a useless
        model and for targets.
        """
        if self.usefulness is None:
            return ""
        return self.usefulness.error_in_words(self.evaluation.total.rmse)

    @property
    def unit(self) -> str:
        """Unit of its targets, "mm" for markers; empty if it is unknown."""
        return self.model.units[0]

    @property
    def unit_text(self) -> str:
        """The unit in words."""
        return self.unit or "(no unit given)"

    @property
    def noun(self) -> str:
        """What the model decodes, in the singular."""
        return "marker" if self.model.targets is None else "target"


@dataclass(frozen=True)
class SessionEvaluation:
    """Models evaluated on the same data.

    Attributes:
        device: Name of the device.
        sessions: Names of the sessions.
        last_share: Share of the frames that were tested, at the end of all runs.
        models: The models, the one of interest first.
        comparison: Comparison of the models; None for a single one.
        notes: What else the user should know.
        likeness: How the cords respond, next to twins; None if it was not measured.
    """

    device: str
    sessions: tuple[str, ...]
    last_share: float
    models: tuple[Evaluated, ...]
    comparison: Comparison | None
    notes: tuple[str, ...]
    likeness: TwinLikeness | None = None


@one_blas_thread()
def evaluate_models(
    models: Sequence[tuple[str, TrainedModel]],
    dataset: Dataset,
    last_share: float | None = None,
    progress: Progress = silent,
    layout: LayoutRecord | None = None,
    prior: Prior | None = None,
) -> SessionEvaluation:
    """Evaluate models on a dataset.

    Args:
        models: The models by name, the one of interest first.
        dataset: The dataset.
        last_share: Share of the frames to test on, at the end of all runs; None for all frames
            that no model was trained on.
        progress: Called with the stage "evaluate".
        layout: Layout of the device, to predict errors, if available.
        prior: Simulated states of the device, to find causes of large errors, if available.

    Returns:
        The evaluation.

    Raises:
        TrainingError: If names repeat, models and data do not match, or no frame can be tested.
    """
    names = [name for name, _ in models]
    if len(set(names)) < len(names):
        raise TrainingError(
            f"a model is given twice: {', '.join(names)}",
            code="name-repeated",
            action="Give each model once",
        )
    frame_count, notes = dataset.frame_count, list[str]()
    if last_share is None:
        dataset = _exclude_trained([model for _, model in models], dataset)
        share, stated_share = 1.0, dataset.frame_count / max(frame_count, 1)
    else:
        share = stated_share = last_share
        notes += [note for name, model in models for note in _note_training(name, model, dataset)]
    evaluated = []
    by_unit = [part for name, model in models for part in _by_unit(name, model)]
    for k, (name, model) in enumerate(by_unit):
        progress("evaluate", (k + 0.2) / len(by_unit), f"{name}: errors")
        evaluation = evaluate(model, dataset, share)
        progress("evaluate", (k + 0.4) / len(by_unit), f"{name}: causes of errors")
        budget = error_budget(model, dataset, share)
        predicted = None
        if model.targets is None:
            predicted = predict_model_error(model, evaluation.frames, layout)
        truth = budget_of_truth(model, dataset, share)
        usefulness = _judge(model, dataset, share, prior)
        f = evaluation.frames
        errors = unit_errors(model, f.measured, f.predicted, f.radius)[0]
        evaluated.append(
            Evaluated(name, model, evaluation, budget, predicted, truth, usefulness, errors)
        )
    notes += _describe_frames(evaluated[0])
    progress("evaluate", 0.95, "comparing")
    comparison = None
    compared = [e for e in evaluated if e.unit == evaluated[0].unit]
    if len(compared) > 1:
        comparison = compare([(e.name, e.evaluation.frames) for e in compared])
    progress("evaluate", 1.0, "done")
    return SessionEvaluation(
        device=dataset.device,
        sessions=tuple(dict.fromkeys(r.session for r in dataset.recordings)),
        last_share=stated_share,
        models=tuple(evaluated),
        comparison=comparison,
        notes=tuple(notes),
    )


def _by_unit(name: str, model: TrainedModel) -> list[tuple[str, TrainedModel]]:
    """Return the models of the targets in each unit, with their names."""
    units = tuple(dict.fromkeys(model.units))
    if len(units) == 1:
        return [(name, model)]
    return [
        (
            f"{name} ({unit or 'no unit given'})",
            model.select_targets(np.array([u == unit for u in model.units])),
        )
        for unit in units
    ]


def _judge(
    model: TrainedModel, dataset: Dataset, share: float, prior: Prior | None
) -> Usefulness | None:
    """Judge a model on the last frames of a dataset; None for too few frames."""
    data = match_to_model(model, dataset)
    try:
        frames = Frames.from_dataset(data)
    except TrainingError:  # the evaluation itself notes few frames
        return None
    frames = frames.select(slice(len(frames) - round(share * len(frames)), None))
    is_same_order = tuple(dataset.channels) == tuple(model.channels)
    if len(frames) < MIN_FRAMES:
        return None
    judgment = judge_model(model, frames, prior if is_same_order else None)
    return replace(judgment, unit=model.units[0])


def note_changed_cords(name: str, model: TrainedModel, dataset: Dataset) -> list[str]:
    """Note channels whose R0 has changed since the model's training, relative to the others.

    There are no notes for models of several built devices, for other devices, or where an R0 is
    unknown: signals without resistances are in units of R0.

    Args:
        name: Name of the model.
        model: The model.
        dataset: The dataset.

    Returns:
        A note for each changed channel of each session.
    """
    trained = np.array([r for r in model.metadata.get("R0", {}).values() if None not in r], float)
    if trained.ndim != 2 or trained.shape[1] != len(model.channels) or (trained == 1).all():
        return []
    units = model.metadata.get("units_trained", [])
    notes = []
    for session in dict.fromkeys(r.session for r in dataset.recordings):
        runs = [r for r in dataset.recordings if r.session == session]
        if set(dataset.channels) != set(model.channels) or {r.unit for r in runs} != set(units):
            continue
        order = [dataset.channels.index(c) for c in model.channels]
        R0 = np.median([r.rest[order] for r in runs], axis=0)
        if not np.isfinite(R0).all() or (R0 <= 0).any() or (R0 == 1).all():
            continue
        change = np.log(R0) - np.log(np.median(trained, axis=0))
        change -= np.median(change)
        for channel, log_ratio in zip(model.channels, change.tolist(), strict=True):
            if abs(log_ratio) > np.log1p(_MAX_REST_CHANGE):
                notes.append(
                    f"{session}: R0 of {channel} is {np.exp(log_ratio):.2f} times that of the"
                    f" training of {name}; its cord may have been replaced: correct the model with"
                    " defsense recalibrate, or train again"
                )
    return notes


def _test_starts(model: TrainedModel, r: Recording) -> list[float]:
    """Return from when on, in s, a training of the model held out frames of a recording.

    It is infinite for a training that held none out; the list is empty if the model was not trained
    on the recording.
    """
    fingerprint = recording_fingerprint(r)
    return [
        np.inf if entry["after"] is None else r.time[0] + entry["after"]
        for entry in model.metadata.get("held_out", ())
        if is_same_recording(fingerprint, entry["fingerprint"])
    ]


def _as_trained(model: TrainedModel, dataset: Dataset) -> Dataset:
    """Return a dataset with the channels of a model, by which its recordings are recognized."""
    is_same = set(model.channels) == set(dataset.channels) and model.readings is None
    if is_same or not set(model.channels) <= set(dataset.channels):
        return dataset
    return match_channels(model, dataset)


def _note_training(name: str, model: TrainedModel, dataset: Dataset) -> list[str]:
    """Return a note if a model was trained on recordings of the dataset."""
    known = [r.name for r in _as_trained(model, dataset).recordings if _test_starts(model, r)]
    if not known:
        return []
    return [
        f"{name} was trained on frames of {', '.join(known)}, so its error seems smaller than it"
        " is: test on all frames it was not trained on, or on another session"
    ]


def _exclude_trained(models: Sequence[TrainedModel], dataset: Dataset) -> Dataset:
    """Return the dataset without frames that a model was trained on."""
    recordings = []
    recognized = [_as_trained(model, dataset).recordings for model in models]
    for k, r in enumerate(dataset.recordings):
        starts = [
            start
            for model, trained in zip(models, recognized, strict=True)
            for start in _test_starts(model, trained[k])
        ]
        keep = r.time >= max(starts, default=-np.inf) - _TIME_ROUNDING_S
        if keep.any():
            kept = replace(r, time=r.time[keep], points=r.points[keep], sigma=r.sigma[keep])
            recordings.append(kept if starts else r)
    if not recordings:
        raise TrainingError(
            "the model was trained on all of these frames",
            code="no-test-frames",
            where=dataset.device,
            action="Record another session to test it on",
        )
    return replace(dataset, recordings=tuple(recordings))


def _describe_frames(evaluated: Evaluated) -> list[str]:
    """Return notes on the test frames."""
    evaluation, notes = evaluated.evaluation, list[str]()
    frames, truth, never = evaluation.frames, "markers", "markers were never visible"
    if evaluated.model.targets is not None:
        truth, never = "targets", "targets have no value"
    count = len(frames.time)
    omitted = frames.omitted
    if omitted.without_samples > _MIN_LEFT_OUT_SHARE * count:
        notes.append(
            f"{omitted.without_samples} frames without samples of all channels were left out"
        )
    if omitted.without_markers > _MIN_LEFT_OUT_SHARE * count:
        notes.append(f"{omitted.without_markers} frames without {truth} were left out")
    if not frames.visible.any(axis=0).all():
        notes.append(f"{int((~frames.visible.any(axis=0)).sum())} {never}")
    if count < _MIN_FRAMES:
        notes.append(f"{count} frames are few: record for longer")
    total, inside, outside = evaluation.total, evaluation.inside, evaluation.outside
    if outside is None or outside.frames <= _MIN_BEYOND_SHARE * total.frames:
        return notes
    beyond = f"{outside.frames / total.frames:.0%} of the frames are beyond what the model was"
    if inside is None:
        notes.append(f"{beyond} trained on")
    elif outside.rmse > _MIN_BEYOND_RATIO * inside.rmse:
        notes.append(
            f"{beyond} trained on: their RMSE is {outside.rmse:.2f} {evaluated.unit_text}, that of"
            f" the others {inside.rmse:.2f} {evaluated.unit_text}"
        )
    return notes
