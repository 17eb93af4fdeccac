"""What a layout is predicted to sense: the error of the best decoder for its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.prediction import Prediction
from ...decoding.decoders import AnyDecoder, fit_decoder
from ...decoding.expected_errors import UnseenStates, choose_unseen_states, measure_errors
from ...sensing.built_cord import BuiltCord
from ..problem.problem import Problem
from .design_task import DesignTask


def left_out_error(task: DesignTask, cords: Sequence[BuiltCord]) -> float:
    """Cross-validated RMSE (mm): on states that the cords are designed for, each left out of the
    decoder's training in turn."""
    signals, noise = read(task, cords)
    states = [w for w, held in zip(task.weights, task.held_out, strict=True) if not held]
    left_out = choose_unseen_states(states, np.zeros(len(states), bool))
    flat = task.design.markers.reshape(len(states), -1)
    return _on_unseen(task.design, left_out, signals[~task.held_out], noise, flat)[0]


def read(task: DesignTask, cords: Sequence[BuiltCord]) -> tuple[Float, Float]:
    """Signals (n, c) of the cords in all states of the device, and their noise (c,)."""
    columns = [
        np.append(0.0, task.reading.signals(c, task.everything.deform(c.path))) for c in cords
    ]
    return np.stack(columns, axis=1), np.array([task.reading.noise(c) for c in cords])


@dataclass(frozen=True)
class Scored:
    """The prediction for `cords`; of all n states signals (n, c) and marker errors (n, k) mm
    without noise; the decoder that was fitted."""

    prediction: Prediction
    cords: tuple[BuiltCord, ...]
    signals: Float
    errors: Float
    decoder: AnyDecoder


def predict(task: DesignTask, cords: Sequence[BuiltCord]) -> Scored:
    """Fit on the states not held out and score all, for these cords."""
    problem, names, held = task.everything, task.names, task.held_out
    signals, noise = read(task, cords)
    n, k = problem.markers.shape[:2]
    flat = problem.markers.reshape(n, -1)
    seen_by = ~held
    decoder = fit_decoder(problem.decoder, signals[seen_by], flat[seen_by], noise)
    guess = decoder(signals).reshape(n, k, 3)
    noisy = decoder.noise_variance(signals, noise).reshape(n, k, 3).sum(2)
    variance = noisy @ problem.marker_weights
    seen = measure_errors(guess[seen_by], problem.markers[seen_by], problem.marker_weights)
    every = measure_errors(guess, problem.markers, problem.marker_weights)
    expected = np.sqrt(every.per_state**2 + variance)
    rmse = dict(zip(names, expected.tolist(), strict=True))
    unseen = task.unseen
    off, free = _on_unseen(problem, unseen, signals, noise, flat)
    prediction = Prediction(
        decoder=problem.decoder,
        noise=tuple(noise.tolist()),
        unseen=off,
        unseen_noise_free=free,
        tested=len(unseen.tested),
        how=unseen.how,
        rmse=float(np.sqrt((expected[seen_by] ** 2).mean())),
        rmse_noise_free=seen.rmse,
        peak=seen.peak,
        average_peak=seen.average_peak,
        floor=problem.floor(len(cords)),
        per_state={m: rmse[m] for m, h in zip(names, held, strict=True) if not h},
        held_out={m: rmse[m] for m, h in zip(names, held, strict=True) if h},
    )
    errors = np.linalg.norm(guess - problem.markers, axis=2)
    return Scored(prediction, tuple(cords), signals, errors, decoder)


def _on_unseen(
    problem: Problem, unseen: UnseenStates, signals: Float, noise: Float, flat: Float
) -> tuple[float, float]:
    """RMSE (mm) with noise and without on the states tested, by decoders trained on the others."""
    square = noisy = 0.0
    shape = (-1, *problem.markers.shape[1:])
    for seen, test in unseen.folds:
        decoder = fit_decoder(problem.decoder, signals[seen], flat[seen], noise)
        guess = decoder(signals[test]).reshape(shape)
        found = measure_errors(guess, problem.markers[test], problem.marker_weights)
        variance = decoder.noise_variance(signals[test], noise).reshape(shape).sum(2)
        square += float((found.per_state**2).sum())
        noisy += float((variance @ problem.marker_weights).sum())
    count = sum(len(test) for _, test in unseen.folds)
    return float(np.sqrt((square + noisy) / count)), float(np.sqrt(square / count))
