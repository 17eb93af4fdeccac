"""Select a decoder, its memory and its ridge by the errors on folds that are left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.progress import Progress, silent
from ...decoding.input_decoder import InputDecoder, InputFeatures
from ...decoding.signal_history import Past
from ..regression.candidates import (
    AFFINE,
    FORMS,
    KERNEL,
    KERNEL_WIDTHS,
    MEMORY,
    QUADRATIC,
    SIMULATED,
    Candidate,
    has_few_products,
)
from ..regression.frames import Frames
from ..regression.simulated_decoder import SHARED_MEMORIES, SimulatedMap
from ..regression.weighted_ridge import (
    INPUT_NOISES,
    RidgePath,
    Sums,
    Whitening,
    accumulate_sums,
    cross_validate,
    solve_ridge,
)

# Time constants among which memories are searched; the best is refined between its neighbors.
_MOVED_TIMES_S = np.logspace(-1, 2, 10)
_WORKED_TIMES_S = np.logspace(-0.5, 2, 6)
_MIN_TIMES_RATIO = 2.0  # between two time constants of a memory
# Memories that kernel decoders try, next to the fitted one.
_KERNEL_PASTS = (
    Past((1.0,)),
    Past((0.3, 1.0, 3.0)),
    Past((0.2, 0.6, 2.0, 6.0)),
    Past((0.3, 1.0, 3.0), (1.0,)),
    Past((0.3, 1.0, 3.0), (1.0, 5.0)),
    Past((0.3, 1.0, 3.0, 10.0, 30.0), (1.0, 10.0)),
)
_MAX_SEARCH_FRAMES = 4000  # with which memories and widths are compared
_MIN_FRAMES_FOR_MEMORY = 300  # fewer frames do not distinguish hysteresis from chance
# Shorter recordings do not distinguish a nonlinear map from cords that settle.
_MIN_NONLINEAR_DURATION_S = 200.0
_REFINEMENT_STEPS = 6  # of the golden section
_MEMORY_ERROR_RATIO = 0.99  # of the error, below which another memory must bring it
_SIMPLER_ERROR_RATIO = 1.01  # of the smallest error; the simplest decoder below it is selected
_PRINCIPAL_COUNT = 6  # principal components of the outputs, for comparing time constants


@dataclass(frozen=True)
class FitData:
    """Data that candidates are fitted to and tested on.

    Attributes:
        frames: The t frames.
        channels: Indices of the channels to use.
        outputs: Displacements of the markers, shape (t, m, 3), mm; of scalars, shape (t, m, 1).
            Targets of several units are divided by the spread of their unit.
        weights: Weights of the markers, shape (t, m); 0 where unknown.
        fold: Fold of each frame, shape (t,).
    """

    frames: Frames
    channels: Sequence[int]
    outputs: Float
    weights: Float
    fold: Int

    def inputs(self, past: Past) -> Float:
        """Return signals and their memories at the frames, shape (t, d)."""
        return self.frames.inputs(past, self.channels)

    def thin(self, count: int) -> FitData:
        """Return the data of about `count` evenly spaced frames; all if there are fewer."""
        which = slice(None, None, max(len(self.frames) // count, 1))
        return replace(
            self,
            frames=self.frames.select(which),
            outputs=self.outputs[which],
            weights=self.weights[which],
            fold=self.fold[which],
        )

    @property
    def fold_count(self) -> int:
        """Number of folds."""
        return int(self.fold.max()) + 1


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate with its cross-validated errors.

    Attributes:
        candidate: The form and the memory.
        features: The features of its inputs.
        path: Errors for each noise of the inputs.
        whitening: Transform of the features; None if `sums` is None.
        sums: Sums for the ridge regression on what a simulated map does not explain; None if the
            candidate is that map alone.
        simulated: The simulated map; None if the candidate does not use one.
        scores: Errors on the folds with the weights of the other candidates, shape (k,), mm; None
            if its own weights are the same.
    """

    candidate: Candidate
    features: InputFeatures
    path: RidgePath
    whitening: Whitening | None = None
    sums: Sums | None = None
    simulated: SimulatedMap | None = None
    scores: Float | None = None

    @property
    def name(self) -> str:
        """Name of the kind of decoder, such as "affine" or "simulated + memory"."""
        if self.simulated is None:
            return self.candidate.name
        parts = [SIMULATED, *([] if self.sums is None else [self.candidate.form])]
        return " + ".join([*parts, *([MEMORY] if self.candidate.past.count else [])])

    @property
    def folds(self) -> Float:
        """Root mean squared errors on the folds left out, shape (k,), mm."""
        return self.path.folds if self.scores is None else self.scores

    @property
    def rmse(self) -> float:
        """Root mean squared error over the folds left out, mm."""
        return float(np.sqrt((self.folds**2).mean()))

    @property
    def count(self) -> int:
        """Number of coefficients that were fitted for each output."""
        return self.features.count if self.sums is not None else 0

    def decoder(self, without: int | None = None) -> InputDecoder:
        """Return the decoder of displacements, in addition to the simulated map.

        Args:
            without: The fold to leave out; None to fit all.

        Returns:
            The decoder; its outputs are zero if the candidate is the simulated map alone.
        """
        if self.sums is None or self.whitening is None:
            assert self.simulated is not None
            outputs = len(self.simulated.whole.decoder.constant)
            zeros = np.zeros((self.features.count, outputs))
            return InputDecoder(self.features, zeros, np.zeros(outputs))
        beta, constant = solve_ridge(self.sums.without(without), np.array([self.path.noise]))
        return InputDecoder(self.features, *self.whitening.undo(beta[0], constant[0]))

    def displacements(self, inputs: Float, without: int | None = None) -> Float:
        """Decode displacements.

        Args:
            inputs: Inputs of the decoder, shape (t, d).
            without: The fold to leave out; None to fit all.

        Returns:
            Displacements, shape (t, o), mm.
        """
        out = self.decoder(without)(inputs)
        if self.simulated is None:
            return out
        return out + self.simulated.without_fold(without)(inputs)


def fit_candidate(
    candidate: Candidate,
    data: FitData,
    simulated: SimulatedMap | None = None,
    noises: Float = INPUT_NOISES,
) -> FittedCandidate:
    """Fit a candidate, and compute its errors on the folds left out.

    Args:
        candidate: The form and the memory.
        data: The data to fit.
        simulated: A simulated map; the candidate is fitted to what it does not explain.
        noises: Noises of the inputs, shape (s,), from which the best is chosen.

    Returns:
        The fitted candidate.
    """
    z = data.inputs(candidate.past)
    features = candidate.features(z, len(data.channels))
    whitening, x = Whitening.fit(features, z)
    outputs = data.outputs
    if simulated is not None:
        outputs = outputs - simulated.whole(z).reshape(outputs.shape)
    sums = accumulate_sums(x, outputs, data.weights, data.fold)
    path = cross_validate(sums, noises)
    return FittedCandidate(candidate, features, path, whitening, sums, simulated)


def fit_simulated_candidate(data: FitData, decoder: InputDecoder, past: Past) -> FittedCandidate:
    """Fit a memory in front of a simulated decoder.

    Args:
        data: The data to fit.
        decoder: The simulated decoder of displacements.
        past: The memory.

    Returns:
        The fitted candidate, which is the simulated map alone.
    """
    z = data.inputs(past)
    simulated = SimulatedMap.fit(decoder, past, z, data.outputs, data.weights, data.fold)
    candidate = Candidate(AFFINE, past)
    path = RidgePath(np.array([np.inf]), simulated.errors[:, None])
    features = candidate.features(z, len(data.channels))
    return FittedCandidate(candidate, features, path, simulated=simulated)


def fit_all_candidates(
    data: FitData,
    forms: Sequence[str] = FORMS,
    *,
    use_memory: bool = True,
    decoder: InputDecoder | None = None,
    progress: Progress = silent,
) -> list[FittedCandidate]:
    """Fit all candidates.

    The affine candidate comes first and is the paper's: all visible markers have the same weight.

    Args:
        data: The data to fit.
        forms: Forms to fit in addition to the affine one.
        use_memory: Whether to try memories.
        decoder: A simulated decoder of displacements; candidates that start from it are added.
        progress: Called with the stage "train".

    Returns:
        The fitted candidates.
    """
    polynomials = [form for form in dict.fromkeys((AFFINE, *forms)) if form != KERNEL]
    if QUADRATIC in polynomials and not has_few_products(len(data.channels), len(data.frames)):
        polynomials.remove(QUADRATIC)
    fitted = []
    for k, form in enumerate(polynomials):
        progress("train", 0.1 + 0.1 * k, f"trying {form}")
        candidate = Candidate(form, Past())
        if form == AFFINE:
            fitted.append(_fit_unweighted(candidate, data))
        else:
            fitted.append(fit_candidate(candidate, data))
    has_few_frames = len(data.frames) < _MIN_FRAMES_FOR_MEMORY
    if decoder is not None:
        progress("train", 0.35, "fitting the simulation's map")
        start = _fit_best_simulated(data, decoder, use_memory)
        fitted.append(start)
        is_short = data.frames.duration_s < _MIN_NONLINEAR_DURATION_S
        fitted += [
            fit_candidate(Candidate(form, start.candidate.past), data, start.simulated)
            for form in polynomials
            if form != AFFINE and not (has_few_frames or is_short)
        ]
    pasts: list[Past] = []
    best = Past()
    if use_memory and not has_few_frames:
        progress("train", 0.4, "fitting time constants")
        best = _fit_time_constants(data)
        pasts = [Past(best.moved)] * bool(best.moved) + [best] * bool(best.worked)
    if KERNEL in forms:
        progress("train", 0.5, "trying radial functions")
        fitted += _fit_kernels(data, [best, *_KERNEL_PASTS] if use_memory else [])
    for k, past in enumerate(pasts):
        for form in polynomials:
            progress("train", 0.6 + 0.1 * k, f"trying {form} with memory")
            fitted.append(fit_candidate(Candidate(form, past), data))
    return fitted


def _fit_kernels(data: FitData, pasts: Sequence[Past]) -> list[FittedCandidate]:
    """Fit the best kernel decoder without memory, and the best one with a memory."""
    reduced = _reduce(data)
    longest = _longest_time_constant(data)
    with_memory = [
        past for past in dict.fromkeys(_shorten(p, longest) for p in pasts) if past.count
    ]
    groups = [[Past()], with_memory if len(data.frames) >= _MIN_FRAMES_FOR_MEMORY else []]
    best = []
    for group in groups:
        candidates = [Candidate(KERNEL, past, width) for past in group for width in KERNEL_WIDTHS]
        if candidates:
            best.append(min(candidates, key=lambda c: fit_candidate(c, reduced).rmse))
    return [fit_candidate(candidate, data) for candidate in best]


def _reduce(data: FitData) -> FitData:
    """Return the main movements, weighted by frame, at no more frames than a search needs."""
    principal = _principal_outputs(data.outputs, data.weights)[:, None]
    reduced = replace(data, outputs=principal, weights=data.weights.mean(axis=1, keepdims=True))
    return reduced.thin(_MAX_SEARCH_FRAMES)


def _longest_time_constant(data: FitData) -> float:
    """Return the duration of a typical recording, s: longer memories cannot be distinguished."""
    time, index = data.frames.time, data.frames.recording_index
    return float(np.median([np.ptp(time[index == k]) for k in np.unique(index)]))


def _shorten(past: Past, longest: float) -> Past:
    """Return a memory whose time constants are `longest` at most, s."""

    def shorten(times: Sequence[float]) -> tuple[float, ...]:
        kept = [t for t in times if t <= longest]
        if len(kept) < len(times) and _are_distinct([*kept, longest]):
            kept.append(longest)
        return tuple(kept)

    return Past(shorten(past.moved), shorten(past.worked))


def select_simplest(fitted: Sequence[FittedCandidate]) -> FittedCandidate:
    """Return the candidate with the fewest coefficients among those that are nearly the best."""
    smallest = min(c.rmse for c in fitted)
    nearly_best = [c for c in fitted if c.rmse <= _SIMPLER_ERROR_RATIO * smallest]
    return min(nearly_best, key=lambda c: c.count)


def _fit_time_constants(data: FitData) -> Past:
    """Find the time constants with which a quadratic decoder has the smallest error.

    Up to two memories of where the signals were are added, then one of how much they moved; each
    only if it reduces the error on the folds left out by 1 %.
    """
    reduced = _reduce(data)
    few = has_few_products(len(data.channels), len(reduced.frames))
    form = QUADRATIC if few else AFFINE
    longest = _longest_time_constant(data)

    def error_of(past: Past) -> float:
        if not all(_are_distinct(times) for times in (past.moved, past.worked)):
            return np.inf
        return fit_candidate(Candidate(form, past), reduced).rmse

    best, best_error = Past(), error_of(Past())
    times = _MOVED_TIMES_S[longest >= _MOVED_TIMES_S]
    for _ in range(2 if len(times) else 0):
        moved, error = _minimize_time_constant(
            lambda t, b=best: error_of(Past((*b.moved, t))),  # type: ignore[misc]
            times,
        )
        if error > _MEMORY_ERROR_RATIO * best_error:
            break
        best, best_error = Past((*best.moved, moved)), error
    times = _WORKED_TIMES_S[longest >= _WORKED_TIMES_S]
    if not len(times):
        return best
    worked, error = _minimize_time_constant(lambda t: error_of(Past(best.moved, (t,))), times)
    if error <= _MEMORY_ERROR_RATIO * best_error:
        return Past(best.moved, (worked,))
    return best


def _are_distinct(times: Sequence[float]) -> bool:
    """Return whether time constants differ by enough to be distinguished."""
    ratios = np.diff(np.log(np.sort(times)))
    return bool((ratios >= np.log(_MIN_TIMES_RATIO)).all())


def _fit_unweighted(candidate: Candidate, data: FitData) -> FittedCandidate:
    """Fit with equal weights of the visible markers, and score with the data's weights."""
    equal = replace(data, weights=(data.weights > 0).astype(float))
    fitted = fit_candidate(candidate, equal)
    z = data.inputs(candidate.past)
    scores = []
    for k in range(data.fold_count):
        test = data.fold == k
        predicted = fitted.displacements(z[test], k).reshape(-1, *data.outputs.shape[1:])
        difference = predicted - data.outputs[test]
        weights = data.weights[test]
        square = np.where(weights > 0, weights * (difference**2).sum(2), 0.0)
        scores.append(np.sqrt(square.sum() / max(float(weights.sum()), 1e-300)))
    return replace(fitted, scores=np.array(scores))


def _fit_best_simulated(data: FitData, decoder: InputDecoder, use_memory: bool) -> FittedCandidate:
    """Return the simulated candidate with the best memory."""
    pasts = SHARED_MEMORIES if use_memory else SHARED_MEMORIES[:1]
    fitted = [fit_simulated_candidate(data, decoder, past) for past in pasts]
    return min(fitted, key=lambda c: c.rmse)


def _minimize_time_constant(
    error_of: Callable[[float], float], times: Float
) -> tuple[float, float]:
    """Return the time constant in s with the smallest error, and that error.

    The best of a list is refined between its neighbors by the golden section (Kiefer 1953,
    Sequential minimax search for a maximum).
    """
    errors = [error_of(float(t)) for t in times]
    k = int(np.argmin(errors))
    low, high = np.log(times[max(k - 1, 0)]), np.log(times[min(k + 1, len(times) - 1)])
    best, best_error = float(times[k]), errors[k]
    ratio = (np.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa, fb = error_of(float(np.exp(a))), error_of(float(np.exp(b)))
    for _ in range(_REFINEMENT_STEPS):
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = error_of(float(np.exp(a)))
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = error_of(float(np.exp(b)))
    for t, error in ((np.exp(a), fa), (np.exp(b), fb)):
        if error < best_error:
            best, best_error = float(t), error
    return best, best_error


def _principal_outputs(outputs: Float, weights: Float) -> Float:
    """Return the principal components (t, k) of the outputs (t, m, 3).

    Unknown outputs are filled with their mean, which suffices for comparing time constants.
    """
    is_known = weights > 0
    mean = np.array(
        [
            o[k].mean(0) if k.any() else np.zeros(outputs.shape[2])
            for o, k in zip(np.moveaxis(outputs, 1, 0), is_known.T, strict=True)
        ]
    )
    flat = np.where(is_known[..., None], outputs - mean, 0.0).reshape(len(outputs), -1)
    values, vectors = np.linalg.eigh(flat.T @ flat)
    top = np.argsort(values)[::-1][:_PRINCIPAL_COUNT]
    return np.asarray(flat @ vectors[:, top])
