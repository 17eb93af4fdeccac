"""Which decoder, which memory of the past, and which ridge: by the errors on folds left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.progress import Progress, silent
from ...decoding.input_decoder import InputDecoder, InputFeatures
from ...decoding.signal_history import Past
from ..regression.candidates import AFFINE, FORMS, MEMORY, QUADRATIC, SIMULATED, Candidate
from ..regression.frames import Frames
from ..regression.simulated_decoder import PASTS, SimulatedMap
from ..regression.weighted_ridge import RidgePath, Sums, Whitened, cross_validate, solve, sums

#: Time constants, s, among which memories are looked for; the best is refined between these.
_TIMES = np.logspace(-1, 2, 10)
_WORKED = np.logspace(-0.5, 2, 6)
_FEWEST_FOR_MEMORY = 300  # pictures: fewer do not tell hysteresis from chance
_SHORTEST_TO_BEND = 200.0  # s: less does not tell a bent map from what cords do as they set
_REFINED = 6  # steps of the golden section
_WORTH = 0.99  # of the error, that another memory must bring it under
_SIMPLER = 1.01  # of the least error: a simpler decoder that stays below it is taken


@dataclass(frozen=True)
class Tried:
    """A candidate with its errors: its ridge over the `sums` of `features`, `path` over the ridge's
    weights, on what a `simulated` map leaves. Where there are no `sums`, it is that map alone.
    `scores` (k,) are its errors on folds with the weights of the others, where its own differ."""

    candidate: Candidate
    features: InputFeatures
    path: RidgePath
    whitened: Whitened | None = None
    sums: Sums | None = None
    simulated: SimulatedMap | None = None
    scores: Float | None = None

    @property
    def name(self) -> str:
        """affine, simulated + memory, ..."""
        if self.simulated is None:
            return self.candidate.name
        parts = [SIMULATED, *([] if self.sums is None else [self.candidate.form])]
        return " + ".join([*parts, *([MEMORY] if self.candidate.past.count else [])])

    @property
    def folds(self) -> Float:
        """RMSE (k,) mm of the folds left out."""
        return self.path.folds if self.scores is None else self.scores

    @property
    def rmse(self) -> float:
        """mm, on the folds left out."""
        return float(np.sqrt((self.folds**2).mean()))

    @property
    def count(self) -> int:
        """Numbers that were fitted for each output, or for all together."""
        return self.features.count if self.sums is not None else 0

    def decoder(self, without: int | None = None) -> InputDecoder:
        """Of displacements, besides the simulated map: fitted to all folds or all but one."""
        if self.sums is None or self.whitened is None:
            assert self.simulated is not None
            outputs = len(self.simulated.whole.decoder.constant)
            zeros = np.zeros((self.features.count, outputs))
            return InputDecoder(self.features, zeros, np.zeros(outputs))
        beta, constant = solve(self.sums.without(without), np.array([self.path.noise]))
        return InputDecoder(self.features, *self.whitened.plain(beta[0], constant[0]))

    def displacements(self, inputs: Float, without: int | None = None) -> Float:
        """(t, o) mm of inputs (t, d)."""
        found = self.decoder(without)(inputs)
        return found if self.simulated is None else found + self.simulated.map(without)(inputs)


def try_candidate(
    candidate: Candidate, frames: Frames, channels: Sequence[int], outputs: Float, weights: Float,
    fold: Int, simulated: SimulatedMap | None = None,
) -> Tried:  # fmt: skip
    """With outputs (t, m, 3) mm, weights (t, m) and folds (t,) of the frames, on what a `simulated`
    map leaves of the outputs."""
    z = frames.inputs(candidate.past, channels)
    features = candidate.features(z, len(channels))
    phi = features(z)
    whitened = Whitened.of(phi, features.slopes(z), features.roughness())
    left = outputs
    if simulated is not None:
        left = outputs - simulated.whole(z).reshape(outputs.shape)
    found = sums(whitened(phi), left, weights, fold)
    return Tried(candidate, features, cross_validate(found), whitened, found, simulated)


def _plain(
    candidate: Candidate, frames: Frames, channels: Sequence[int], outputs: Float, weights: Float,
    fold: Int,
) -> Tried:  # fmt: skip
    """Fitted to markers that all weigh the same, and scored as those that do not."""
    found = try_candidate(candidate, frames, channels, outputs, (weights > 0).astype(float), fold)
    z = frames.inputs(candidate.past, channels)
    scores = []
    for k in range(int(fold.max()) + 1):
        test = fold == k
        off = found.displacements(z[test], k).reshape(-1, *outputs.shape[1:]) - outputs[test]
        square = np.where(weights[test] > 0, weights[test] * (off**2).sum(2), 0.0)
        scores.append(np.sqrt(square.sum() / max(float(weights[test].sum()), 1e-300)))
    return replace(found, scores=np.array(scores))


def try_simulated(
    frames: Frames, channels: Sequence[int], outputs: Float, weights: Float, fold: Int,
    decoder: InputDecoder, past: Past,
) -> Tried:  # fmt: skip
    """A simulated `decoder` of displacements behind a memory with the time constants of `past`."""
    z = frames.inputs(past, channels)
    found = SimulatedMap.fitted(decoder, past, z, outputs, weights, fold)
    candidate = Candidate(AFFINE, past)
    path = RidgePath(np.array([np.inf]), found.errors[:, None])
    return Tried(candidate, candidate.features(z, len(channels)), path, simulated=found)


def best_simulated(
    frames: Frames, channels: Sequence[int], outputs: Float, weights: Float, fold: Int,
    decoder: InputDecoder, *, memory: bool = True,
) -> Tried:  # fmt: skip
    """The one with the memory that does best."""
    pasts = PASTS if memory else PASTS[:1]
    tried = [
        try_simulated(frames, channels, outputs, weights, fold, decoder, past) for past in pasts
    ]
    return min(tried, key=lambda t: t.rmse)


def try_all(
    frames: Frames, channels: Sequence[int], outputs: Float, weights: Float, fold: Int,
    forms: Sequence[str] = FORMS, *, memory: bool = True, decoder: InputDecoder | None = None,
    progress: Progress = silent,
) -> list[Tried]:  # fmt: skip
    """All candidates. The affine one comes first, and is the paper's: markers that are seen weigh
    the same. With a simulated `decoder` of displacements there are those that start from it."""
    static = [Candidate(form, Past()) for form in dict.fromkeys((AFFINE, *forms))]
    out = []
    for k, candidate in enumerate(static):
        progress("train", 0.1 + 0.1 * k, f"trying {candidate.name}")
        if candidate.form == AFFINE:
            out.append(_plain(candidate, frames, channels, outputs, weights, fold))
        else:
            out.append(try_candidate(candidate, frames, channels, outputs, weights, fold))
    few = len(frames) < _FEWEST_FOR_MEMORY
    if decoder is not None:
        progress("train", 0.35, "fitting the simulation's map")
        start = best_simulated(frames, channels, outputs, weights, fold, decoder, memory=memory)
        out.append(start)
        short = frames.lasts < _SHORTEST_TO_BEND
        bent = [
            Candidate(f, start.candidate.past) for f in forms if f != AFFINE and not (few or short)
        ]
        out += [
            try_candidate(c, frames, channels, outputs, weights, fold, start.simulated)
            for c in bent
        ]
    if not memory or few:
        return out
    progress("train", 0.4, "fitting time constants")
    found = fit_past(frames, channels, outputs, weights, fold)
    pasts = [Past(found.moved)] * bool(found.moved) + [found] * bool(found.worked)
    for k, past in enumerate(pasts):
        for candidate in [Candidate(c.form, past) for c in static]:
            progress("train", 0.6 + 0.1 * k, f"trying {candidate.name}")
            out.append(try_candidate(candidate, frames, channels, outputs, weights, fold))
    return out


def chosen(tried: Sequence[Tried]) -> Tried:
    """The one with the fewest features among those that are nearly the best."""
    least = min(t.rmse for t in tried)
    near = [t for t in tried if t.rmse <= _SIMPLER * least]
    return min(near, key=lambda t: t.count)


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
