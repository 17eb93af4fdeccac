"""Which decoder, which memory of the past, and which ridge: by the errors on folds left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.progress import Progress, silent
from ...decoding.input_features import InputDecoder, InputFeatures
from ...decoding.past import Past
from ..ridge.candidates import AFFINE, FORMS, QUADRATIC, Candidate
from ..ridge.frames import Frames
from ..ridge.weighted_ridge import RidgePath, Sums, Whitened, cross_validate, solve, sums
from ..simulation.prior import WORTHS, Prior

#: Time constants, s, among which memories are looked for; the best is refined between these.
_TIMES = np.logspace(-1, 2, 10)
_WORKED = np.logspace(-0.5, 2, 6)
_FEWEST_FOR_MEMORY = 300  # pictures: fewer do not tell hysteresis from chance
_REFINED = 6  # steps of the golden section
_WORTH = 0.99  # of the error, that another memory must bring it under
_SIMPLER = 1.01  # of the least error: a simpler decoder that stays below it is taken


@dataclass(frozen=True)
class Tried:
    """A candidate with its features and its errors: `path` over the ridge's weights; sums over the
    states of a `prior`, and how many pictures they are `worth`."""

    candidate: Candidate
    features: InputFeatures
    whitened: Whitened
    sums: Sums
    path: RidgePath
    prior: Sums | None = None
    worth: float = 0.0

    @property
    def rmse(self) -> float:
        """mm, on the folds left out."""
        return self.path.rmse

    def decoder(self, without: int | None = None) -> InputDecoder:
        """Of displacements: fitted to all folds or all but one, and to what the prior is worth."""
        total = self.sums.without(without).plus(self.prior, self.worth)
        beta, constant = solve(total, np.array([self.path.noise]))
        return InputDecoder(self.features, *self.whitened.plain(beta[0], constant[0]))


def try_candidate(
    candidate: Candidate, frames: Frames, channels: Sequence[int], outputs: Float, weights: Float,
    fold: Int, prior: Prior | None = None,
) -> Tried:  # fmt: skip
    """With outputs (t, m, 3) mm, weights (t, m) and folds (t,) of the frames."""
    z = frames.inputs(candidate.past, channels)
    states = prior.inputs(candidate.past, list(channels)) if prior else z[:0]
    every = np.concatenate([z, states])
    features = candidate.features(every, len(channels))
    phi = features(every)
    whitened = Whitened.of(phi, features.slopes(every), features.roughness())
    found = sums(whitened(phi[: len(z)]), outputs, weights, fold)
    if prior is None:
        return Tried(candidate, features, whitened, found, cross_validate(found))
    told = prior.sums(phi[len(z) :], whitened)
    paths = {worth: cross_validate(found, told, worth) for worth in WORTHS}
    worth = _worth(paths)
    return Tried(candidate, features, whitened, found, paths[worth], told, worth)


def _worth(paths: Mapping[float, RidgePath]) -> float:
    """The most that a prior may be worth without errors on folds that are larger than the least by
    more than chance: the standard error of the folds' differences. Few pictures prove little."""
    least = min(paths.values(), key=lambda path: path.rmse)

    def as_good(path: RidgePath) -> bool:
        more = path.folds - least.folds
        return bool(more.mean() <= more.std(ddof=1) / np.sqrt(len(more)))

    return max(worth for worth, path in paths.items() if path is least or as_good(path))


def try_all(
    frames: Frames, channels: Sequence[int], outputs: Float, weights: Float, fold: Int,
    forms: Sequence[str] = FORMS, *, memory: bool = True, prior: Prior | None = None,
    progress: Progress = silent,
) -> list[Tried]:  # fmt: skip
    """All candidates. The affine one comes first, and is the paper's: it knows of no prior, and
    markers that are seen weigh the same."""
    static = [Candidate(form, Past()) for form in dict.fromkeys((AFFINE, *forms))]
    out = []
    for k, candidate in enumerate(static):
        progress("train", 0.1 + 0.1 * k, f"trying {candidate.name}")
        plain = candidate.form == AFFINE
        w, p = ((weights > 0).astype(float), None) if plain else (weights, prior)
        out.append(try_candidate(candidate, frames, channels, outputs, w, fold, p))
    if not memory or len(frames) < _FEWEST_FOR_MEMORY:
        return out
    progress("train", 0.4, "fitting time constants")
    found = fit_past(frames, channels, outputs, weights, fold)
    pasts = [Past(found.moved)] * bool(found.moved) + [found] * bool(found.worked)
    for k, past in enumerate(pasts):
        for candidate in [Candidate(c.form, past) for c in static]:
            progress("train", 0.6 + 0.1 * k, f"trying {candidate.name}")
            out.append(try_candidate(candidate, frames, channels, outputs, weights, fold, prior))
    return out


def chosen(tried: Sequence[Tried]) -> Tried:
    """The one with the fewest features among those that are nearly the best."""
    least = min(t.rmse for t in tried)
    near = [t for t in tried if t.rmse <= _SIMPLER * least]
    return min(near, key=lambda t: t.features.count)


def fit_past(
    frames: Frames, channels: Sequence[int], outputs: Float, weights: Float, fold: Int
) -> Past:
    """The time constants with which a quadratic decoder has the least error on folds left out: up
    to two of where signals were, then one of how much they moved, each only if it is worth it."""
    few = _principal(outputs, weights)

    def error(past: Past) -> float:
        candidate = Candidate(QUADRATIC, past)
        shared = np.ones((len(few), 1))
        return try_candidate(candidate, frames, channels, few[:, None], shared, fold).rmse

    best, at = Past(), error(Past())
    for _ in range(2):
        moved, now = _least(lambda t, b=best: error(Past((*b.moved, t))), _TIMES)
        if now > _WORTH * at:
            break
        best, at = Past((*best.moved, moved)), now
    worked, now = _least(lambda t: error(Past(best.moved, (t,))), _WORKED)
    return Past(best.moved, (worked,)) if now <= _WORTH * at else best


def _least(error, times: Float) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """The time constant, s, with the least error: the best of a list, and then the golden section
    between its neighbours (Kiefer 1953)."""
    errors = [error(float(t)) for t in times]
    k = int(np.argmin(errors))
    low, high = np.log(times[max(k - 1, 0)]), np.log(times[min(k + 1, len(times) - 1)])
    best, at = float(times[k]), errors[k]
    ratio = (np.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    fa, fb = error(float(np.exp(a))), error(float(np.exp(b)))
    for _ in range(_REFINED):
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - ratio * (high - low)
            fa = error(float(np.exp(a)))
        else:
            low, a, fa = a, b, fb
            b = low + ratio * (high - low)
            fb = error(float(np.exp(b)))
    for t, e in ((np.exp(a), fa), (np.exp(b), fb)):
        if e < at:
            best, at = float(t), e
    return best, at


def _principal(outputs: Float, weights: Float, count: int = 6) -> Float:
    """The outputs (t, m, 3) by their principal components (t, k): what is not known is filled with
    its mean. For comparing time constants that suffices."""
    known = weights > 0
    mean = np.array(
        [o[k].mean(0) if k.any() else np.zeros(3)
         for o, k in zip(np.moveaxis(outputs, 1, 0), known.T, strict=True)]
    )  # fmt: skip
    flat = np.where(known[..., None], outputs - mean, 0.0).reshape(len(outputs), -1)
    values, vectors = np.linalg.eigh(flat.T @ flat)
    top = np.argsort(values)[::-1][:count]
    return np.asarray(flat @ vectors[:, top])
