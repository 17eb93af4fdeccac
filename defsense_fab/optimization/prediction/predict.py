"""Predict what a layout senses: the error of the best decoder for its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...decoding.decoders import AnyDecoder, fit_decoder
from ...decoding.expected_errors import UnseenStates, choose_unseen_states, measure_errors
from ...sensing.built_cord import BuiltCord
from ...store.layout import Prediction
from ..problem.problem import Problem
from .design_task import DesignTask


def left_out_error(task: DesignTask, cords: Sequence[BuiltCord]) -> float:
    """Return the cross-validated RMSE (mm) on the designed states.

    Each state is left out of the decoder's training in turn.

    Args:
        task: The design task.
        cords: The cords as built in.
    """
    signals, noise = read_cords(task, cords)
    states = [w for w, held in zip(task.weights, task.held_out, strict=True) if not held]
    left_out = choose_unseen_states(states, np.zeros(len(states), bool))
    flat = task.design.markers.reshape(len(states), -1)
    return _unseen_errors(task.design, left_out, signals[~task.held_out], noise, flat)[0]


def read_cords(task: DesignTask, cords: Sequence[BuiltCord]) -> tuple[Float, Float]:
    """Return the signals (n, c) of cords in all states, and their noise (c,).

    Args:
        task: The design task.
        cords: The cords as built in.
    """
    columns = [
        np.append(0.0, task.reading.signals(c, task.everything.deform(c.path))) for c in cords
    ]
    return np.stack(columns, axis=1), np.array([task.reading.noise(c) for c in cords])


@dataclass(frozen=True)
class ScoredLayout:
    """A layout with its prediction.

    Attributes:
        prediction: The prediction.
        cords: The cords as built in.
        signals: (n, c) signals in all states.
        errors: (n, k) mm, errors of the markers without noise.
        decoder: The fitted decoder.
    """

    prediction: Prediction
    cords: tuple[BuiltCord, ...]
    signals: Float
    errors: Float
    decoder: AnyDecoder


def predict(task: DesignTask, cords: Sequence[BuiltCord]) -> ScoredLayout:
    """Fit the decoder on the designed states and predict the errors of all states.

    Args:
        task: The design task.
        cords: The cords as built in.
    """
    return _score(task, cords, *read_cords(task, cords))


def predict_with_best_decoder(
    tasks: Sequence[DesignTask], cords: Sequence[BuiltCord]
) -> tuple[DesignTask, ScoredLayout]:
    """Predict with each decoder, and return the task and prediction of the smallest unseen error.

    Args:
        tasks: Design tasks that differ in their decoder only; the signals are read once.
        cords: The cords as built in.
    """
    signals, noise = read_cords(tasks[0], cords)
    scored = [(task, _score(task, cords, signals, noise)) for task in tasks]
    return min(scored, key=lambda pair: pair[1].prediction.unseen)


def _score(
    task: DesignTask, cords: Sequence[BuiltCord], signals: Float, noise: Float
) -> ScoredLayout:
    problem, names, held = task.everything, task.names, task.held_out
    n, k = problem.markers.shape[:2]
    flat = problem.markers.reshape(n, -1)
    is_designed = ~held
    decoder = fit_decoder(problem.decoder, signals[is_designed], flat[is_designed], noise)
    predicted = decoder(signals).reshape(n, k, 3)
    noisy = decoder.noise_variance(signals, noise).reshape(n, k, 3).sum(2)
    variance = noisy @ problem.marker_weights
    fitted = measure_errors(
        predicted[is_designed], problem.markers[is_designed], problem.marker_weights
    )
    every = measure_errors(predicted, problem.markers, problem.marker_weights)
    expected = np.sqrt(every.per_state**2 + variance)
    rmse = dict(zip(names, expected.tolist(), strict=True))
    unseen = task.unseen
    unseen_error, noise_free_error = _unseen_errors(problem, unseen, signals, noise, flat)
    prediction = Prediction(
        decoder=problem.decoder,
        noise=tuple(noise.tolist()),
        unseen=unseen_error,
        unseen_noise_free=noise_free_error,
        tested=len(unseen.tested),
        how=unseen.how,
        rmse=float(np.sqrt((expected[is_designed] ** 2).mean())),
        rmse_noise_free=fitted.rmse,
        peak=fitted.peak,
        average_peak=fitted.average_peak,
        floor=problem.floor(len(cords)),
        per_state={m: rmse[m] for m, h in zip(names, held, strict=True) if not h},
        held_out={m: rmse[m] for m, h in zip(names, held, strict=True) if h},
    )
    errors = np.linalg.norm(predicted - problem.markers, axis=2)
    return ScoredLayout(prediction, tuple(cords), signals, errors, decoder)


def _unseen_errors(
    problem: Problem, unseen: UnseenStates, signals: Float, noise: Float, flat: Float
) -> tuple[float, float]:
    """Return the RMSE (mm) with and without noise on tested states, by decoders of the others."""
    square = noisy = 0.0
    shape = (-1, *problem.markers.shape[1:])
    for train, test in unseen.folds:
        decoder = fit_decoder(problem.decoder, signals[train], flat[train], noise)
        predicted = decoder(signals[test]).reshape(shape)
        measured = measure_errors(predicted, problem.markers[test], problem.marker_weights)
        variance = decoder.noise_variance(signals[test], noise).reshape(shape).sum(2)
        square += float((measured.per_state**2).sum())
        noisy += float((variance @ problem.marker_weights).sum())
    count = sum(len(test) for _, test in unseen.folds)
    return float(np.sqrt((square + noisy) / count)), float(np.sqrt(square / count))
