"""Which states tell how a decoder does on what it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.device.states import LoadingPath, loading_path

# What a layout is predicted to reach, as it stands in `layout.json`.


HELD_OUT, LEFT_OUT, NONE = "held out", "left out", "none"

#: What an error on unseen states is worth, for those who read it.
MEANING = {
    HELD_OUT: "unseen states are those held out: neither the cords' paths nor the decoder were"
    ' fitted to them; the few layouts that the search came to and, with decoder = "auto", three'
    " kinds of decoders were compared on them",
    LEFT_OUT: "no states are held out: each amplitude and mixture was left out of the decoder's"
    " training in turn, but the cords were designed for all of them; [states] held_out in"
    " device.toml tells more",
    NONE: "there are too few states to leave any out: the error is that of the states fitted, and"
    " between them it may be far more; give [states] ramp, mixtures and held_out in device.toml",
}


@dataclass(frozen=True)
class UnseenStates:
    """Pairs of states to train on and to test on, by index; how they came about: HELD_OUT states
    are neither designed nor trained on, LEFT_OUT ones are designed on but left out of training in
    turn, NONE: those trained on are tested, for there are too few. `paths` are states that lie on
    one path of loading: their indices (k,) and the fractions of it (k,) at which they are."""

    how: str
    folds: tuple[tuple[Int, Int], ...]
    paths: tuple[tuple[Int, Float], ...] = ()

    @property
    def tested(self) -> Int:
        """All states that are tested (t,), in order."""
        return np.unique(np.concatenate([test for _, test in self.folds]))


#: How much of each pose a state has; rest has none.
Weights = Mapping[str, float]


def unseen_states(states: Sequence[Weights], held_out: Bool) -> UnseenStates:
    """Of the states (n,), rest first, those that are `held_out` (n,); without any, the single poses
    at each amplitude and each mixture are left out in turn."""
    held, paths = np.flatnonzero(held_out), _paths(states)
    if len(held):
        return UnseenStates(HELD_OUT, ((np.flatnonzero(~held_out), held),), paths)
    groups: dict[object, list[int]] = {}
    for k, weights in enumerate(states[1:], 1):
        path, at = loading_path(weights)
        groups.setdefault(at * path[0][1] if len(path) == 1 else (path, at), []).append(k)
    everything = np.arange(len(states))
    if len(groups) < 2:
        return UnseenStates(NONE, ((everything, everything),), paths)
    tests = [np.array(group) for group in groups.values()]
    return UnseenStates(LEFT_OUT, tuple((np.setdiff1d(everything, t), t) for t in tests), paths)


def _paths(states: Sequence[Weights]) -> tuple[tuple[Int, Float], ...]:
    """Of states, rest first: a pose's amplitudes, and mixtures of the same ratios."""
    found: dict[LoadingPath, list[tuple[int, float]]] = {}
    for k, weights in enumerate(states[1:], 1):
        path, at = loading_path(weights)
        found.setdefault(path, []).append((k, at))
    return tuple(
        (np.array([k for k, _ in path]), np.array([at for _, at in path]))
        for path in found.values()
    )


@dataclass(frozen=True)
class ErrorMeasures:
    """Marker errors in mm over states: root mean square, largest, and mean of the largest."""

    rmse: float
    peak: float
    average_peak: float
    per_state: Float


def measure(predicted: Float, truth: Float, weights: Float) -> ErrorMeasures:
    """Errors of marker positions (n, k, 3) mm; `weights` (k,) of the markers sum to one."""
    distance = np.linalg.norm(predicted - truth, axis=2)
    per_state = np.sqrt((distance**2 * weights).sum(1))
    return ErrorMeasures(
        rmse=float(np.sqrt((per_state**2).mean())),
        peak=float(distance.max()),
        average_peak=float(distance.max(1).mean()),
        per_state=per_state,
    )


def floor(outputs: Float, sensors: int) -> float:
    """Least RMSE (mm) of any affine map from `sensors` signals without noise.

    The rank-M truncation of the centred outputs (n, o), o scaled so that a row's squared norm
    is the state's mean squared marker error (Eckart & Young 1936).
    """
    values = np.linalg.svd(outputs - outputs.mean(0), compute_uv=False)
    return float(np.sqrt((values[sensors:] ** 2).sum() / len(outputs)))
