"""Which states tell how a decoder does on what it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Bool, Float, Int

HELD_OUT, LEFT_OUT, NONE = "held out", "left out", "none"

#: What an error on unseen states is worth, for those who read it.
MEANING = {
    HELD_OUT: "unseen states are those held out: neither the cords nor the decoder were fitted to"
    " them",
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


def unseen_states(names: Sequence[str], held_out: Bool) -> UnseenStates:
    """Of the states `names` (n,), rest first, those that are `held_out` (n,); without any, the
    poses at each amplitude (`pose@amplitude`) and each mixture are left out in turn."""
    held, paths = np.flatnonzero(held_out), _paths(names)
    if len(held):
        return UnseenStates(HELD_OUT, ((np.flatnonzero(~held_out), held),), paths)
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(names[1:], 1):
        pose, at, amplitude = name.rpartition("@")
        groups.setdefault(amplitude if at and pose else name, []).append(k)
    everything = np.arange(len(names))
    if len(groups) < 2:
        return UnseenStates(NONE, ((everything, everything),), paths)
    tests = [np.array(group) for group in groups.values()]
    return UnseenStates(LEFT_OUT, tuple((np.setdiff1d(everything, t), t) for t in tests), paths)


def _paths(names: Sequence[str]) -> tuple[tuple[Int, Float], ...]:
    """Of states by name, rest first: a pose's amplitudes, and mixtures (`0.5*a+0.5*b`) of the same
    ratios."""
    found: dict[tuple[tuple[str, float], ...], list[tuple[int, float]]] = {}
    for k, name in enumerate(names[1:], 1):
        weights = _weights(name)
        largest = max(map(abs, weights.values()))
        ratios = tuple((pose, round(w / largest, 6)) for pose, w in weights.items())
        found.setdefault(ratios, []).append((k, largest))
    return tuple(
        (np.array([k for k, _ in path]), np.array([at for _, at in path]))
        for path in found.values()
    )


def _weights(name: str) -> dict[str, float]:
    """The poses of a state and how much of each it has."""
    pose, at, amplitude = name.rpartition("@")
    if at and pose:
        return {pose: float(amplitude)}
    parts = (part.partition("*") for part in name.split("+"))
    return {pose: float(weight) for weight, _, pose in parts}
