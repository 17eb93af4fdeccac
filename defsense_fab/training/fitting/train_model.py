"""Train a model from a dataset, and report the errors of every candidate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...core.progress import Progress, silent
from ...decoding.expected_errors import ErrorMeasures
from ...decoding.signal_history import Past
from ...decoding.trained_model import Branch, TrainedModel
from ..data.dataset import Dataset
from ..options import TrainOptions
from ..regression.candidates import AFFINE, FORMS, Candidate
from ..regression.frames import MIN_FRAMES, Frames, assign_folds, split_frames
from ..regression.intervals import fit_intervals, fit_trained_range
from ..regression.marker_weights import find_wrong_markers, weight_by_certainty
from ..regression.simulated_decoder import fit_simulated_decoder
from ..regression.simulation_prior import Prior
from .decoder_selection import (
    FitData,
    FittedCandidate,
    fit_all_candidates,
    fit_candidate,
    fit_simulated_candidate,
    select_simplest,
)
from .errors_by_unit import UnitErrors, measure_test, select_unit, target_scale
from .fault_limits import fit_fault_limits
from .pose_signals import extract_pose_signals
from .repeatability import Repeatability, measure_repeatability
from .usefulness import Usefulness
from .useless_causes import judge_model

_MANY_CHANNELS = 16
_MAX_FRAMES_OF_MANY = 3000  # to which decoders without one of many channels are fitted
_MIN_FOLD_S = 2.0
_MIN_MARKER_FRAMES = 20  # in which a marker must be visible
_RECORDING_GAP_S = 1e6  # between recordings on the common clock


@dataclass(frozen=True)
class CandidateResult:
    """Errors of one candidate.

    Attributes:
        name: Name of the kind of decoder.
        features: Number of coefficients for each output.
        noise: Assumed noise of the inputs in the ridge regression; infinite if only the
            simulation's map was fitted.
        lambda_: The same as lambda of DefSense's Eq. 8, for a marker visible in every frame.
        folds: Root mean squared errors on the folds left out, shape (k,), mm.
        cross_validated: Root mean squared error over all folds, mm.
        test: Errors on the test frames; None if there are none. Of targets in several units, those
            in the first unit; errors of the folds are then shares of each unit's spread.
        moved: Time constants of the memory of where signals were, s.
        worked: Time constants of the memory of how much signals moved, s.
    """

    name: str
    features: int
    noise: float
    lambda_: float
    folds: Float
    cross_validated: float
    test: ErrorMeasures | None
    moved: tuple[float, ...]
    worked: tuple[float, ...]


@dataclass(frozen=True)
class Training:
    """Result of a training.

    Attributes:
        model: The trained model.
        candidates: Errors of all candidates.
        selected: Name of the candidate that the model uses.
        training_frames: The frames that the model was trained on.
        test_frames: The frames that it was tested on.
        wrong_markers: Which markers of the training frames are wrong, shape (t, m).
        wrong_test_markers: Which markers of the test frames are wrong.
        repeatability: Repeatability of decoded shapes; None if no shape was shown twice.
        usefulness: Error on the test frames compared with the movement; None without test frames.
            Of targets in several units, that of the unit in which the model is least useful.
        test: Errors and coverage on the test frames, for each unit of the targets.
    """

    model: TrainedModel
    candidates: tuple[CandidateResult, ...]
    selected: str
    training_frames: Frames
    test_frames: Frames
    wrong_markers: Bool
    wrong_test_markers: Bool
    repeatability: Repeatability | None = None
    usefulness: Usefulness | None = None
    test: tuple[UnitErrors, ...] = ()


def train(
    dataset: Dataset,
    options: TrainOptions | None = None,
    progress: Progress = silent,
    prior: Prior | None = None,
) -> Training:
    """Train a model.

    Args:
        dataset: The dataset.
        options: Options of the training.
        progress: Called with the stage "train".
        prior: Simulated states of the device, to start from.

    Returns:
        The model, with the errors of all candidates.

    Raises:
        TrainingError: If there is too little to train on.
    """
    options = options or TrainOptions()
    frames, test_frames = split_frames(
        Frames.from_dataset(dataset), options.test_share, options.leave_out
    )
    _require_long_folds(frames, options.folds)
    progress("train", 0.0, "looking for wrong markers")
    weights, wrong_markers = _weight_markers(frames, options)
    _require_all_markers(frames, weights)
    scale = target_scale(frames)
    data = FitData(
        frames,
        tuple(range(len(dataset.channels))),
        (frames.points - dataset.rest_points) / scale[:, None],
        weights,
        assign_folds(len(frames), options.folds),
    )
    forms = FORMS if options.decoder == "auto" else (options.decoder,)
    fitted = fit_all_candidates(
        data,
        forms,
        use_memory=options.memory,
        decoder=None if prior is None else fit_simulated_decoder(prior),
        progress=progress,
    )
    is_free = options.decoder == "auto"
    best = select_simplest(fitted if is_free else [c for c in fitted if c.candidate.form in forms])
    progress("train", 0.8, "intervals, and decoders without each channel")
    main = _make_branch(best, data, options.level, scale)
    names = dataset.channels if len(data.channels) > 1 else ()
    without = {
        n: _branch_without(k, best, data, options, prior, scale) for k, n in enumerate(names)
    }
    candidates = tuple(
        _summarize(c, data, test_frames, scale, main if c is best else None) for c in fitted
    )
    model = _make_model(dataset, best.name, main, without)
    progress("train", 1.0, "done")
    decoded, _ = _decode_left_out(best, data)
    repeatability = None
    if len(set(dataset.units)) == 1:
        repeatability = measure_repeatability(_hide_unweighted(frames, weights), decoded)
    return Training(
        model,
        candidates,
        best.name,
        frames,
        test_frames,
        wrong_markers,
        _find_wrong_test_markers(test_frames, options),
        repeatability,
        _judge(model, test_frames, prior) if len(test_frames) else None,
        measure_test(model, test_frames),
    )


def measure_errors(predicted: Float, points: Float) -> ErrorMeasures:
    """Measure the errors of predicted marker positions.

    Args:
        predicted: Predicted positions, shape (t, m, 3), mm.
        points: Measured positions, shape (t, m, 3), mm; NaN in gaps.

    Returns:
        The errors; all visible markers count alike.
    """
    distance = np.linalg.norm(predicted - points, axis=2)
    with np.errstate(all="ignore"):
        per_state = np.sqrt(np.nanmean(distance**2, axis=1))
    return ErrorMeasures(
        rmse=float(np.sqrt(np.nanmean(distance**2))),
        peak=float(np.nanmax(distance)),
        average_peak=float(np.nanmean(np.nanmax(distance, axis=1))),
        per_state=per_state,
    )


def _judge(model: TrainedModel, test_frames: Frames, prior: Prior | None) -> Usefulness:
    """Judge whether the model is useful in each unit; return the worst judgment."""
    units = tuple(dict.fromkeys(model.units))
    judgments = [
        replace(judge_model(*select_unit(model, test_frames, unit), prior), unit=unit)
        for unit in units
    ]
    return max(judgments, key=lambda u: u.error / max(u.movement, 1e-300))


def _make_model(
    dataset: Dataset, kind: str, main: Branch, without: dict[str, Branch]
) -> TrainedModel:
    c = len(dataset.channels)
    poses = extract_pose_signals(dataset.recordings)
    return TrainedModel(
        dataset.device,
        dataset.layout,
        kind,
        dataset.channels,
        dataset.ids,
        dataset.rest_points,
        np.ones(c),
        np.zeros(c),
        main,
        without,
        fit_fault_limits(dataset),
        {name: p.signals for name, p in poses.items()},
        {name: p.spread for name, p in poses.items()},
        targets=dataset.targets,
        readings=dataset.readings,
    )


def _common_time(frames: Frames) -> Float:
    """Return times (t,) in s on one clock, with large gaps between recordings."""
    return frames.time + _RECORDING_GAP_S * frames.recording_index


def _weight_markers(frames: Frames, options: TrainOptions) -> tuple[Float, Bool]:
    """Return weights of the markers (t, m), and which are wrong (t, m).

    Other targets than markers are neither weighted nor found wrong: a frame has too few of them to
    compare, and hysteresis of a sensor looks alike.
    """
    visible = frames.visible
    if not options.weighted or frames.dataset.targets is not None:
        return visible.astype(float), np.zeros_like(visible)
    signals = frames.inputs(Past(), range(len(frames.dataset.channels)))
    is_wrong, scale = find_wrong_markers(signals, frames.points, _common_time(frames))
    return weight_by_certainty(frames.sigma, visible & ~is_wrong, scale), is_wrong


def _find_wrong_test_markers(frames: Frames, options: TrainOptions) -> Bool:
    """Return which markers (t, m) are wrong; none if there are too few frames to know."""
    if options.weighted and len(frames) >= MIN_FRAMES:
        return _weight_markers(frames, options)[1]
    return np.zeros_like(frames.visible)


def _require_long_folds(frames: Frames, folds: int) -> None:
    """Raise an error for too few frames, and for folds that their neighbors predict."""
    if len(frames) < MIN_FRAMES:
        raise TrainingError(
            f"{len(frames)} frames are left to train on, but training needs {MIN_FRAMES}",
            code="too-few-frames",
            action="Test on a smaller share, or record for longer",
            count=len(frames),
            needed=MIN_FRAMES,
        )
    duration = frames.duration_s
    if folds > TrainOptions.folds and duration / folds < _MIN_FOLD_S:
        largest = max(int(duration / _MIN_FOLD_S), TrainOptions.folds)
        raise TrainingError(
            f"{folds} folds of {duration / folds:.1f} s each are too short: they are predicted by"
            " their neighbors",
            code="folds-too-short",
            where="folds",
            action=f"Use {largest} folds or fewer",
            fold_s=duration / folds,
            largest=largest,
        )


def _require_all_markers(frames: Frames, weights: Float) -> None:
    """Raise an error for markers that are hardly ever known."""
    is_rare = (weights > 0).sum(0) < _MIN_MARKER_FRAMES
    if is_rare.any():
        markers = tuple(frames.dataset.ids[is_rare].tolist())
        if (targets := frames.dataset.targets) is not None:
            names = tuple(np.array(targets.names)[is_rare].tolist())
            raise TrainingError(
                f"{', '.join(names)} has fewer than {_MIN_MARKER_FRAMES} values at the"
                f" {len(frames)} times to train on",
                code="target-rarely-known",
                where=frames.dataset.device,
                action="Delete the column, or test on another part (--leave-out, --test-share)",
                targets=names,
            )
        raise TrainingError(
            f"marker {', '.join(map(str, markers))} was visible in fewer than {_MIN_MARKER_FRAMES}"
            f" of the {len(frames)} frames to train on",
            code="marker-rarely-seen",
            where=frames.dataset.device,
            action="Record with a camera that sees it, or leave it out",
            markers=markers,
        )


def _make_branch(fitted: FittedCandidate, data: FitData, level: float, scale: Float) -> Branch:
    """Return the decoder fitted to all frames, with its range and intervals.

    Targets (m,) in the data are divided by `scale`, those of the decoder are not.
    """
    frames, past = data.frames, fitted.candidate.past
    z = data.inputs(past)
    trained_range = fit_trained_range(z, z[:, : len(data.channels)])
    decoded, distance = _decode_left_out(fitted, data)
    errors = np.linalg.norm(decoded - data.outputs, axis=2) * scale
    errors[data.weights <= 0] = np.nan
    intervals = fit_intervals(errors, distance, level)
    factor = np.repeat(scale, data.outputs.shape[2])
    rest = frames.dataset.rest_points.ravel()
    simulated = None if fitted.simulated is None else fitted.simulated.whole
    outside = None
    if simulated is None and fitted.candidate.form != AFFINE:
        affine = fit_candidate(Candidate(AFFINE, Past()), data)
        outside = affine.decoder().scale(factor, rest)
    return Branch(
        tuple(data.channels),
        past,
        fitted.decoder().scale(factor, rest),
        trained_range,
        intervals,
        simulated,
        outside,
    )


def _decode_left_out(fitted: FittedCandidate, data: FitData) -> tuple[Float, Float]:
    """Decode each fold by decoders of the other folds.

    Returns displacements (t, m, 3) mm, and the distance (t,) of each frame from the range of the
    training that it was not part of.
    """
    z = data.inputs(fitted.candidate.past)
    c = len(data.channels)
    decoded, distance = np.empty(data.outputs.shape), np.empty(len(data.frames))
    for k in range(data.fold_count):
        test = data.fold == k
        decoded[test] = fitted.displacements(z[test], k).reshape(-1, *data.outputs.shape[1:])
        distance[test] = fit_trained_range(z[~test], z[~test, :c]).distance(z[test])
    return decoded, distance


def _hide_unweighted(frames: Frames, weights: Float) -> Frames:
    """Return the frames with markers of weight 0 set to NaN."""
    return replace(frames, points=np.where(weights[..., None] > 0, frames.points, np.nan))


def _branch_without(
    lost: int,
    best: FittedCandidate,
    data: FitData,
    options: TrainOptions,
    prior: Prior | None,
    scale: Float,
) -> Branch:
    """Return a branch of the same form and memory from the channels other than `lost`."""
    others = [k for k in range(len(data.frames.dataset.channels)) if k != lost]
    data = replace(data, channels=others)
    if len(others) > _MANY_CHANNELS:
        data = data.thin(_MAX_FRAMES_OF_MANY)
    simulated = None
    if best.candidate.form == AFFINE and best.simulated is None:
        data = replace(data, weights=(data.weights > 0).astype(float))
    if best.simulated is not None and prior is not None:
        decoder = fit_simulated_decoder(prior, others)
        start = fit_simulated_candidate(data, decoder, best.candidate.past)
        if best.sums is None:
            return _make_branch(start, data, options.level, scale)
        simulated = start.simulated
    fitted = fit_candidate(best.candidate, data, simulated, np.array([best.path.noise]))
    return _make_branch(fitted, data, options.level, scale)


def _summarize(
    fitted: FittedCandidate,
    data: FitData,
    test_frames: Frames,
    scale: Float,
    branch: Branch | None,
) -> CandidateResult:
    """Return a candidate's errors, with those on the test frames; the chosen one has a branch."""
    noise, test = fitted.path.noise, None
    if len(test_frames):
        z = test_frames.inputs(fitted.candidate.past, data.channels)
        if branch is None:
            decoded = fitted.displacements(z).reshape(test_frames.points.shape) * scale[:, None]
            predicted = decoded + data.frames.dataset.rest_points
        else:
            predicted = branch.positions(z).reshape(test_frames.points.shape)
        units = test_frames.dataset.units
        is_first = np.array([unit == units[0] for unit in units])
        is_known = np.isfinite(test_frames.points[:, is_first, 0]).any(axis=1)
        if is_known.any():
            shown = test_frames.points[:, is_first][is_known]
            test = measure_errors(predicted[:, is_first][is_known], shown)
    return CandidateResult(
        name=fitted.name,
        features=fitted.count,
        noise=noise,
        lambda_=float(noise * np.sqrt(len(data.frames))),
        folds=fitted.folds,
        cross_validated=fitted.rmse,
        test=test,
        moved=fitted.candidate.past.moved,
        worked=fitted.candidate.past.worked,
    )
