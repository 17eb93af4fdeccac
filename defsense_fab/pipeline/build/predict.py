"""What a layout is predicted to sense: the error of the best decoder for its signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.device import Sensor
from ...core.path_sampling import sample_path
from ...core.prediction import Prediction
from ...decoding.decoders import Trained, fit_decoder
from ...decoding.folds import cross_validated
from ...decoding.ridge import measure
from ...optimize.problem.problem import Problem
from .design_task import DesignTask


def unseen_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Expected RMSE (mm) of decoders on runs of states that they were not trained on."""
    signals = np.stack(
        [problem.signals(path) for path in [sample_path(s) for s in sensors]], axis=1
    )
    return cross_validated(
        lambda seen, told: fit_decoder(problem.decoder, seen, told, problem.noise),
        signals,
        problem.outputs,
        problem.noise,
    )


@dataclass(frozen=True)
class Scored:
    """The prediction; of all n states signals (n, c) and marker errors (n, k) mm without noise; the
    decoder that was fitted."""

    prediction: Prediction
    signals: Float
    errors: Float
    decoder: Trained


def predict(task: DesignTask, paths: Sequence[Float]) -> Scored:
    """Fit on the states not held out and score all, for cords along `paths`, each (p, 3) mm."""
    problem, names, held = task.everything, task.names, task.held_out
    signals = np.stack([problem.signals(path) for path in paths], axis=1)
    n, k = problem.markers.shape[:2]
    flat = problem.markers.reshape(n, -1)
    seen_by = ~held
    decoder = fit_decoder(problem.decoder, signals[seen_by], flat[seen_by], problem.noise)
    guess = decoder(signals).reshape(n, k, 3)
    noisy = decoder.noise_variance(signals, problem.noise).reshape(n, k, 3).sum(2)
    variance = noisy @ problem.marker_weights
    seen = measure(guess[seen_by], problem.markers[seen_by], problem.marker_weights)
    every = measure(guess, problem.markers, problem.marker_weights)
    expected = np.sqrt(every.per_state**2 + variance)
    rmse = dict(zip(names, expected.tolist(), strict=True))
    only = replace(problem, markers=problem.markers[seen_by])
    prediction = Prediction(
        decoder=problem.decoder,
        noise=problem.noise,
        rmse=float(np.sqrt((expected[seen_by] ** 2).mean())),
        rmse_noise_free=seen.rmse,
        peak=seen.peak,
        average_peak=seen.average_peak,
        floor=only.floor(len(paths)),
        per_state={m: rmse[m] for m, h in zip(names, held, strict=True) if not h},
        held_out={m: rmse[m] for m, h in zip(names, held, strict=True) if h},
    )
    errors = np.linalg.norm(guess - problem.markers, axis=2)
    return Scored(prediction, signals, errors, decoder)
