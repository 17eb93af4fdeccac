"""What the simulation says of a device: its states, with the signals and the markers in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...decoding.input_decoder import InputFeatures, all_products
from ..data.dataset import Recording
from .frames import Frames
from .weighted_ridge import Sums, Whitened, solve, sums

# Which parts of the pose space a recording has shown, and what to show next.

_NEAR = 0.25  # of how far a state is from rest: a picture that is nearer shows it
_LEAST = 1.0  # mm
_REST = 5.0  # s at the end, in which a device at rest shows how cords drifted
_BLOCK = 500  # pictures compared at once
_TOLD = 3  # states that are asked for


@dataclass(frozen=True)
class Coverage:
    """Simulated states by `names` (s,), how near pictures came to each, mm (s,), which were `seen`
    (s,), whether the recording ends at rest, and what to do next."""

    names: tuple[str, ...]
    nearest: Float
    seen: Bool
    ends_at_rest: bool
    advice: tuple[str, ...]

    @property
    def share(self) -> float:
        """Of the states but rest."""
        return float(self.seen[1:].mean()) if len(self.seen) > 1 else 1.0


def coverage(frames: Frames, prior: Prior) -> Coverage:
    """Of the frames' markers against the states of the simulation, rest first."""
    moved = frames.points - frames.dataset.rest_points
    away = np.sqrt((prior.displacements**2).sum(2).mean(1))
    nearest = np.full(len(away), np.inf)
    for k in range(0, len(moved), _BLOCK):
        part = moved[k : k + _BLOCK, None] - prior.displacements
        with np.errstate(all="ignore"):
            off = np.sqrt(np.nanmean((part**2).sum(3), axis=2))
        nearest = np.minimum(nearest, np.nanmin(off, axis=0))
    seen = nearest <= np.maximum(_NEAR * away, _LEAST)
    last = frames.of == frames.of[-1]
    time = frames.time
    end = last & (time > time[last][-1] - _REST)
    with np.errstate(all="ignore"):
        rested = np.sqrt(np.nanmean((moved[end] ** 2).sum(2), axis=1))
    ends = bool(np.median(rested) <= max(_LEAST, 0.1 * float(away.max())))
    return Coverage(prior.names, nearest, seen, ends, _advice(prior, nearest, seen, ends))


def _advice(prior: Prior, nearest: Float, seen: Bool, ends_at_rest: bool) -> tuple[str, ...]:
    missing = np.flatnonzero(~seen[1:]) + 1
    # What is farthest from all that was shown, first.
    order = missing[np.argsort(-nearest[missing])]
    out = [
        f"show {prior.names[k]}: pictures came within {nearest[k]:.1f} mm" for k in order[:_TOLD]
    ]
    if len(order) > _TOLD:
        out.append(f"{len(order) - _TOLD} more states were not shown")
    if not seen[0]:
        out.append("rest for 10 s at the beginning")
    if not ends_at_rest:
        out.append("rest for 10 s at the end: it shows how the cords drifted")
    return tuple(out)


# What the simulation lets expect of the signals where the markers are: for noticing channels that
# are exchanged or changed, before anything is trained on them.

_MOVEMENTS = 4  # main ones of the states
_RIDGE = 1e-3  # of a movement's own square, where few markers are seen
_NOISE = 0.05  # of the movements, in their spread over the states


def expected_signals(prior: Prior, r: Recording, rest_points: Float) -> Float:
    """(R - R0)/R0 (t, c) at the pictures of a recording, whose markers are at rest at (m, 3) mm;
    NaN where fewer than half of the markers are seen. Raises TrainingError where none moves."""
    s, m = prior.displacements.shape[:2]
    flat = prior.displacements.reshape(s, -1)
    _, size, across = np.linalg.svd(flat, full_matrices=False)
    k = min(_MOVEMENTS, int((size > 1e-6 * size[0]).sum()))
    if k == 0:
        raise TrainingError(
            "no marker moves in any of the simulated states; put markers where the poses move the"
            " device",
            code="markers-do-not-move",
        )
    V = across[:k]
    states = flat @ V.T
    spread = np.maximum(states.std(0), 1e-9)
    features = InputFeatures(k, all_products(k), np.zeros((0, k)), np.ones(k))

    def made_of(movements: Float) -> Float:
        return features(movements / spread)

    phi = made_of(states)
    whitened = Whitened.of(phi, features.slopes(states / spread), features.roughness())
    told = sums(whitened(phi), prior.signals[:, :, None], np.ones_like(prior.signals),
                np.zeros(s, np.int64))  # fmt: skip
    beta, constant = solve(told.without(), np.array([_NOISE]))

    moved = (r.points - rest_points).reshape(len(r.time), -1)
    known = np.isfinite(moved)
    normal = np.einsum("ka,ta,la->tkl", V, known.astype(float), V) + _RIDGE * np.eye(k)
    seen = np.where(known, moved, 0.0) @ V.T
    movements = np.linalg.solve(normal, seen[:, :, None])[:, :, 0]
    out = whitened(made_of(movements)) @ beta[0] + constant[0]
    out[known.sum(axis=1) < 1.5 * m] = np.nan
    return np.asarray(out)


@dataclass(frozen=True)
class Prior:
    """Simulated states by their `names` (s,), rest first: signals (s, c) of the device's channels,
    and displacements (s, m, 3) mm of its markers."""

    names: tuple[str, ...]
    signals: Float
    displacements: Float

    def __post_init__(self) -> None:
        s = len(self.names)
        if s < 2:
            raise TrainingError(
                f"the simulation has {s} states; build the device again", code="too-few-states"
            )
        if len(self.signals) != s or len(self.displacements) != s:
            raise TrainingError(
                f"the simulation has {s} states, signals {self.signals.shape} and displacements"
                f" {self.displacements.shape}; build the device again",
                code="shapes-differ",
            )

    def sums(self, phi: Float, whitened: Whitened) -> Sums:
        """Of their features (s, f), with weights that add up to one."""
        s, m = self.displacements.shape[:2]
        weights = np.full((s, m), 1 / s)
        return sums(whitened(phi), self.displacements, weights, np.zeros(s, np.int64))
