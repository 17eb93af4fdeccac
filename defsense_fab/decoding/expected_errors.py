"""Marker errors of decoders: how they are measured, and the states on which they are expected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.device.states import LoadingPath, loading_path


@dataclass(frozen=True)
class ErrorMeasures:
    """Marker errors over states, mm.

    Attributes:
        rmse: Root mean square.
        peak: Largest error.
        average_peak: Mean over the states of the largest error.
        per_state: Root mean square of each state (n,).
    """

    rmse: float
    peak: float
    average_peak: float
    per_state: Float


def measure_errors(predicted: Float, truth: Float, weights: Float) -> ErrorMeasures:
    """Measure the errors of predicted marker positions.

    Args:
        predicted: Predicted positions (n, k, 3), mm.
        truth: True positions (n, k, 3), mm.
        weights: Weights of the markers (k,), whose sum is 1.

    Returns:
        The errors.
    """
    distance = np.linalg.norm(predicted - truth, axis=2)
    per_state = np.sqrt((distance**2 * weights).sum(1))
    return ErrorMeasures(
        rmse=float(np.sqrt((per_state**2).mean())),
        peak=float(distance.max()),
        average_peak=float(distance.max(1).mean()),
        per_state=per_state,
    )


def affine_error_floor(outputs: Float, sensors: int) -> float:
    """Return the lowest RMSE of any affine map from noise-free signals.

    It is the error of the rank-M truncation of the centered outputs (Eckart & Young 1936).

    Args:
        outputs: Outputs (n, o), scaled so that a row's squared norm is the state's mean squared
            marker error, mm.
        sensors: Number of signals M.

    Returns:
        The RMSE, mm.
    """
    values = np.linalg.svd(outputs - outputs.mean(0), compute_uv=False)
    return float(np.sqrt((values[sensors:] ** 2).sum() / len(outputs)))


HELD_OUT, LEFT_OUT, NONE = "held out", "left out", "none"

#: Explanations, for users, of how unseen states were chosen.
MEANING = {
    HELD_OUT: "unseen states are the held-out ones: neither the paths nor the decoder were"
    " fitted to them. Only the few layouts that the search found and, with decoder = "
    '"auto", three kinds of decoders were compared on them',
    LEFT_OUT: "no states are held out: each amplitude and mixture was excluded from the decoder's"
    " training in turn, but the cords were designed for all of them. Give [states] held_out in"
    " device.toml for a better estimate",
    NONE: "there are too few states to exclude any: the error is that of the fitted states and may"
    " be much larger between them. Give [states] ramp, mixtures and held_out in device.toml",
}


@dataclass(frozen=True)
class UnseenStates:
    """States to train and to test a decoder on.

    Attributes:
        how: How they were chosen. HELD_OUT states are used neither for design nor for training,
            LEFT_OUT states are used for design and excluded from training in turn. With NONE, the
            decoder is tested on the training states, because there are too few.
        folds: Pairs of training and test states, by index.
        paths: States on the same loading path: their indices (k,) and how far along it they are
            (k,).
        shares: How often a session shows each state (n,), for training and for testing; None to
            train on all alike, and to test on the test states alone.
    """

    how: str
    folds: tuple[tuple[Int, Int], ...]
    paths: tuple[tuple[Int, Float], ...] = ()
    shares: Float | None = None

    @property
    def tested(self) -> Int:
        """All test states (t,), in order."""
        return np.unique(np.concatenate([test for _, test in self.folds]))


#: Weight of each pose in a state; rest has none.
Weights = Mapping[str, float]


def choose_unseen_states(states: Sequence[Weights], held_out: Bool) -> UnseenStates:
    """Choose the states on which a decoder is tested.

    Args:
        states: The states (n,), rest first.
        held_out: Whether each state is held out (n,). If none is, the single poses at each
            amplitude, and each mixture, are excluded from training in turn.

    Returns:
        Training and test states.
    """
    held, paths = np.flatnonzero(held_out), _group_by_path(states)
    if len(held):
        return UnseenStates(HELD_OUT, ((np.flatnonzero(~held_out), held),), paths)
    groups: dict[object, list[int]] = {}
    for k, weights in enumerate(states[1:], 1):
        path, amplitude = loading_path(weights)
        key = amplitude * path[0][1] if len(path) == 1 else (path, amplitude)
        groups.setdefault(key, []).append(k)
    everything = np.arange(len(states))
    if len(groups) < 2:
        return UnseenStates(NONE, ((everything, everything),), paths)
    tests = [np.array(group) for group in groups.values()]
    return UnseenStates(LEFT_OUT, tuple((np.setdiff1d(everything, t), t) for t in tests), paths)


def _group_by_path(states: Sequence[Weights]) -> tuple[tuple[Int, Float], ...]:
    """Group states, rest first, into amplitudes of a pose and mixtures of the same ratios."""
    groups: dict[LoadingPath, list[tuple[int, float]]] = {}
    for k, weights in enumerate(states[1:], 1):
        path, amplitude = loading_path(weights)
        groups.setdefault(path, []).append((k, amplitude))
    return tuple(
        (np.array([k for k, _ in group]), np.array([amplitude for _, amplitude in group]))
        for group in groups.values()
    )
