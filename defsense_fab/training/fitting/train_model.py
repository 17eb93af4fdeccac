"""From a dataset to a trained model, with what every candidate was worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...core.progress import Progress, silent
from ...decoding.decoders import FOLDS
from ...decoding.expected_errors import ErrorMeasures
from ...decoding.signal_history import Past
from ...decoding.trained_model import Branch, TrainedModel
from ..data.dataset import Dataset
from ..regression.candidates import AFFINE, FORMS
from ..regression.frames import FEWEST, TEST_SHARE, Frames, first_and_last, fold_of
from ..regression.intervals import LEVEL, conformal, trained_range
from ..regression.marker_weights import certainty_weights, wrong_markers
from ..regression.simulated_decoder import simulated_decoder
from ..regression.simulation_prior import Prior
from .decoder_selection import Tried, chosen, try_all, try_candidate, try_simulated
from .fault_limits import fault_limits
from .pose_signals import pose_signals
from .repeatability import Repeatability, repeatability

AUTO = "auto"
_LEAST_FOLD = 2.0  # s


@dataclass(frozen=True)
class TrainingOptions:
    """`decoder`: a form, or the best of all; whether its past is looked at (`memory`); whether
    markers weigh by their certainty, and wrong ones are left out (`weighted`); the `test_share` of
    the pictures, at the end; contiguous `folds`; the `level` of the intervals."""

    decoder: str = AUTO
    memory: bool = True
    weighted: bool = True
    test_share: float = TEST_SHARE
    folds: int = FOLDS
    level: float = LEVEL

    def __post_init__(self) -> None:
        if self.decoder != AUTO and self.decoder not in FORMS:
            raise TrainingError(
                f"no decoder is called {self.decoder}; there are {AUTO}, {', '.join(FORMS)}",
                code="unknown-decoder",
                decoder=self.decoder,
            )
        if self.folds < 2:
            raise TrainingError(
                f"{self.folds} folds: cross-validation needs 2 or more", code="too-few-folds"
            )
        if not 0 < self.level < 1:
            raise TrainingError(
                f"a level of {self.level:g} cannot be; give one between 0 and 1",
                code="level-out-of-range",
            )


@dataclass(frozen=True)
class Attempt:
    """A candidate's row of the table: the ridge's `noise` (of the inputs) and its lambda (Eq. 8),
    for a marker that is seen in every picture; RMSE (mm) of the `folds` (k,) left out, and of all
    of them; errors on the test (None: none); its memory's time constants, s. Where nothing but the
    simulation's map was fitted, noise and lambda are infinite."""

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
    """The model, its rows, which of them it is; pictures trained on and tested on; which markers of
    the training (t, m), and of the test, were wrong; how far what is said of one shape differs from
    show to show, None where none was shown twice."""

    model: TrainedModel
    attempts: tuple[Attempt, ...]
    chosen: str
    trained: Frames
    tested: Frames
    wrong: Bool
    wrong_tested: Bool
    repeats: Repeatability | None = None


def train(
    dataset: Dataset, options: TrainingOptions | None = None, progress: Progress = silent,
    prior: Prior | None = None,
) -> Training:  # fmt: skip
    """With what the simulation says as a `prior`, if given. Raises TrainingError where there is too
    little to train on."""
    options = options or TrainingOptions()
    frames, tested = first_and_last(Frames.all_of(dataset), options.test_share)
    _need_long_folds(frames, options.folds)
    fold = fold_of(len(frames), options.folds)
    outputs = frames.points - dataset.rest_points
    progress("train", 0.0, "looking for wrong markers")
    weights, wrong = _weights(frames, options)
    _need_every_marker(frames, weights)
    channels = tuple(range(len(dataset.channels)))
    forms = FORMS if options.decoder == AUTO else (options.decoder,)
    tried = try_all(
        frames,
        channels,
        outputs,
        weights,
        fold,
        forms,
        memory=options.memory,
        decoder=None if prior is None else simulated_decoder(prior),
        progress=progress,
    )
    among = tried if options.decoder == AUTO else [t for t in tried if t.candidate.form in forms]
    best = chosen(among)
    progress("train", 0.8, "intervals, and decoders without each channel")
    main = branch(best, frames, channels, outputs, weights, fold, options.level)
    without = {
        name: _without(k, best, frames, outputs, weights, options, prior)
        for k, name in enumerate(dataset.channels)
        if len(channels) > 1
    }
    rows = tuple(_attempt(t, frames, tested, channels) for t in tried)
    poses = pose_signals(dataset.recordings)
    model = TrainedModel(
        dataset.device, dataset.layout, best.name, dataset.channels, dataset.ids,
        dataset.rest_points, np.ones(len(channels)), np.zeros(len(channels)), main, without,
        fault_limits(dataset), {n: p.signals for n, p in poses.items()},
        {n: p.spread for n, p in poses.items()},
    )  # fmt: skip
    progress("train", 1.0, "done")
    wrong_tested = np.zeros_like(tested.visible)
    if options.weighted and len(tested) >= FEWEST:
        wrong_tested = _weights(tested, options)[1]
    said, _ = _left_out(best, frames, channels, outputs, fold)
    repeats = repeatability(_without_wrong(frames, weights), said)
    return Training(model, rows, best.name, frames, tested, wrong, wrong_tested, repeats)


def _clock(frames: Frames) -> Float:
    """(t,) s, far apart between recordings."""
    return frames.time + 1e6 * frames.of


def _weights(frames: Frames, options: TrainingOptions) -> tuple[Float, Bool]:
    seen = frames.visible
    if not options.weighted:
        return seen.astype(float), np.zeros_like(seen)
    signals = frames.inputs(Past(), range(len(frames.dataset.channels)))
    wrong, scale = wrong_markers(signals, frames.points, _clock(frames))
    return certainty_weights(frames.sigma, seen & ~wrong, scale), wrong


def _need_long_folds(frames: Frames, folds: int) -> None:
    """Raises TrainingError for too few pictures, and for folds so short that each is told by its
    neighbours."""
    if len(frames) < FEWEST:
        raise TrainingError(
            f"{len(frames)} pictures are left to train on, and training needs {FEWEST}; test on a"
            " smaller share (--test-share), or record for longer",
            code="too-few-frames",
            count=len(frames),
            needed=FEWEST,
        )
    lasts = frames.lasts
    if folds > FOLDS and lasts / folds < _LEAST_FOLD:
        raise TrainingError(
            f"{folds} folds of {lasts / folds:.1f} s each are told by their neighbours; take"
            f" {max(int(lasts / _LEAST_FOLD), FOLDS)} or fewer (--folds)",
            code="folds-too-short",
            fold_s=lasts / folds,
            largest=max(int(lasts / _LEAST_FOLD), FOLDS),
        )


def _need_every_marker(frames: Frames, weights: Float) -> None:
    """Raises TrainingError for markers that are hardly ever known."""
    few = (weights > 0).sum(0) < 20
    if few.any():
        ids = ", ".join(map(str, frames.dataset.ids[few].tolist()))
        raise TrainingError(
            f"{frames.dataset.device}: marker {ids} was seen in fewer than 20 of the"
            f" {len(frames)} pictures to train on; record with a camera that sees it, or leave it"
            f" out (--without-markers {ids.replace(' ', '')})",
            code="marker-rarely-seen",
            markers=tuple(frames.dataset.ids[few].tolist()),
        )


def branch(
    tried: Tried, frames: Frames, channels: Sequence[int], outputs: Float, weights: Float,
    fold: Int, level: float,
) -> Branch:  # fmt: skip
    """The candidate fitted to all of the frames, with its range, and intervals from errors on the
    folds that were left out."""
    z = frames.inputs(tried.candidate.past, channels)
    range_ = trained_range(z, z[:, : len(channels)])
    guess, away = _left_out(tried, frames, channels, outputs, fold)
    errors = np.linalg.norm(guess - outputs, axis=2)
    errors[weights <= 0] = np.nan
    intervals = conformal(errors, away, _clock(frames), level)
    found = tried.decoder()
    decoder = replace(found, constant=found.constant + frames.dataset.rest_points.ravel())
    simulated = None if tried.simulated is None else tried.simulated.whole
    return Branch(tuple(channels), tried.candidate.past, decoder, range_, intervals, simulated)


def _left_out(
    tried: Tried, frames: Frames, channels: Sequence[int], outputs: Float, fold: Int
) -> tuple[Float, Float]:
    """Displacements (t, m, 3) mm by decoders of the other folds, and how far (t,) each picture lies
    from a training that it was not part of."""
    z = frames.inputs(tried.candidate.past, channels)
    guess, away = np.empty(outputs.shape), np.empty(len(frames))
    for k in range(int(fold.max()) + 1):
        left = fold == k
        guess[left] = tried.displacements(z[left], k).reshape(-1, *outputs.shape[1:])
        away[left] = trained_range(z[~left], z[~left, : len(channels)]).distance(z[left])
    return guess, away


def _without_wrong(frames: Frames, weights: Float) -> Frames:
    """As if markers that do not count had not been seen."""
    return replace(frames, points=np.where(weights[..., None] > 0, frames.points, np.nan))


def _without(
    lost: int, best: Tried, frames: Frames, outputs: Float, weights: Float,
    options: TrainingOptions, prior: Prior | None,
) -> Branch:  # fmt: skip
    """The same form and past from the other channels."""
    others = [k for k in range(len(frames.dataset.channels)) if k != lost]
    fold = fold_of(len(frames), options.folds)
    simulated = None
    if best.candidate.form == AFFINE and best.simulated is None:
        weights = (weights > 0).astype(float)
    if best.simulated is not None and prior is not None:
        decoder, past = simulated_decoder(prior, others), best.candidate.past
        start = try_simulated(frames, others, outputs, weights, fold, decoder, past)
        if best.sums is None:
            return branch(start, frames, others, outputs, weights, fold, options.level)
        simulated = start.simulated
    tried = try_candidate(best.candidate, frames, others, outputs, weights, fold, simulated)
    return branch(tried, frames, others, outputs, weights, fold, options.level)


def _attempt(tried: Tried, frames: Frames, tested: Frames, channels: Sequence[int]) -> Attempt:
    noise, test = tried.path.noise, None
    if len(tested):
        z = tested.inputs(tried.candidate.past, channels)
        guess = tried.displacements(z).reshape(tested.points.shape)
        test = errors_of(guess + frames.dataset.rest_points, tested.points)
    return Attempt(
        tried.name, tried.count, noise,
        float(noise * np.sqrt(len(frames))), tried.folds, tried.rmse, test,
        tried.candidate.past.moved, tried.candidate.past.worked,
    )  # fmt: skip


def errors_of(guess: Float, points: Float) -> ErrorMeasures:
    """Of positions (t, m, 3) mm against those seen, NaN in gaps; every marker that was seen counts
    the same."""
    distance = np.linalg.norm(guess - points, axis=2)
    with np.errstate(all="ignore"):
        per_state = np.sqrt(np.nanmean(distance**2, axis=1))
    return ErrorMeasures(
        rmse=float(np.sqrt(np.nanmean(distance**2))),
        peak=float(np.nanmax(distance)),
        average_peak=float(np.nanmean(np.nanmax(distance, axis=1))),
        per_state=per_state,
    )
