"""Simulated states of a device as prior knowledge: expected signals, and coverage of the poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...decoding.input_decoder import InputFeatures, all_products
from ..data.dataset import Recording
from .frames import Frames
from .weighted_ridge import Sums, Whitening, accumulate_sums, solve_ridge

_MOVEMENT_COUNT = 4  # main movements of the states
_MOVEMENT_RIDGE = 1e-3  # of a movement's square, for frames with few visible markers
_MOVEMENT_NOISE = 0.05  # of the movements, relative to their spread over the states

_MAX_DISTANCE_RATIO = 0.25  # of a state's distance from rest; frames within it show the state
_MIN_DISTANCE_MM = 1.0
_FINAL_REST_S = 5.0  # rest at the end of a recording shows how the cords drifted
_REST_RATIO = 0.1  # of the largest distance of a state from rest; the device is at rest below
_BLOCK_SIZE = 500  # frames compared at once
_MAX_ADVICE = 3  # requested states


@dataclass(frozen=True)
class Prior:
    """Simulated states of a device, rest first.

    Attributes:
        names: Names of the s states.
        signals: Signals (R - R0)/R0 of the device's channels, shape (s, c).
        displacements: Displacements of the device's markers, shape (s, m, 3), mm, rest frame.

    Raises:
        TrainingError: If there are fewer than two states, or shapes do not match.
    """

    names: tuple[str, ...]
    signals: Float
    displacements: Float

    def __post_init__(self) -> None:
        s = len(self.names)
        if s < 2:
            raise TrainingError(
                f"the simulation has only {s} states",
                code="too-few-states",
                action="Build the device again",
            )
        if len(self.signals) != s or len(self.displacements) != s:
            raise TrainingError(
                f"the simulation has {s} states, but signals {self.signals.shape} and displacements"
                f" {self.displacements.shape}",
                code="shapes-differ",
                action="Build the device again",
            )

    def accumulate_sums(self, features: Float) -> Sums:
        """Compute sums over the states for ridge regression; the weights add up to one.

        Args:
            features: Whitened features of the states, shape (s, f).

        Returns:
            The sums, of one fold.
        """
        s, m = self.displacements.shape[:2]
        weights = np.full((s, m), 1 / s)
        return accumulate_sums(features, self.displacements, weights, np.zeros(s, np.int64))


def predict_signals(prior: Prior, r: Recording, rest_points: Float) -> Float:
    """Predict the signals of a recording from its marker positions and the simulation.

    This detects exchanged or changed channels before anything is trained. The signals are a
    quadratic function of the main movements of the simulated states.

    Args:
        prior: The simulated states.
        r: The recording.
        rest_points: Marker positions at rest, shape (m, 3), mm.

    Returns:
        Signals (R - R0)/R0 at the frames, shape (t, c); NaN where fewer than half of the markers
        are visible.

    Raises:
        TrainingError: If no marker moves in any state.
    """
    s, m = prior.displacements.shape[:2]
    flat = prior.displacements.reshape(s, -1)
    _, size, directions = np.linalg.svd(flat, full_matrices=False)
    k = min(_MOVEMENT_COUNT, int((size > 1e-6 * size[0]).sum()))
    if k == 0:
        raise TrainingError(
            "no marker moves in any simulated state",
            code="markers-do-not-move",
            action="Put markers where the poses move the device",
        )
    V = directions[:k]
    states = flat @ V.T
    spread = np.maximum(states.std(0), 1e-9)
    features = InputFeatures(k, all_products(k), np.zeros((0, k)), np.ones(k))
    whitening, x = Whitening.fit(features, states / spread)
    sums = accumulate_sums(
        x,
        prior.signals[:, :, None],
        np.ones_like(prior.signals),
        np.zeros(s, np.int64),
    )
    beta, constant = solve_ridge(sums.without(), np.array([_MOVEMENT_NOISE]))

    displacements = (r.points - rest_points).reshape(len(r.time), -1)
    is_known = np.isfinite(displacements)
    normal = np.einsum("ka,ta,la->tkl", V, is_known.astype(float), V)
    normal = normal + _MOVEMENT_RIDGE * np.eye(k)
    projected = np.where(is_known, displacements, 0.0) @ V.T
    movements = np.linalg.solve(normal, projected[:, :, None])[:, :, 0]
    signals = whitening(features(movements / spread)) @ beta[0] + constant[0]
    signals[is_known.sum(axis=1) < 1.5 * m] = np.nan
    return np.asarray(signals)


@dataclass(frozen=True)
class StateCoverage:
    """Which simulated states a recording shows.

    Attributes:
        names: Names of the s states, rest first.
        nearest: Distance of the nearest frame to each state, shape (s,), mm.
        is_shown: Whether each state was shown, shape (s,).
        ends_at_rest: Whether the recording ends at rest.
        advice: What to record next, one sentence each.
    """

    names: tuple[str, ...]
    nearest: Float
    is_shown: Bool
    ends_at_rest: bool
    advice: tuple[str, ...]

    @property
    def share(self) -> float:
        """Share of the states that were shown, without rest."""
        return float(self.is_shown[1:].mean()) if len(self.is_shown) > 1 else 1.0


def measure_coverage(frames: Frames, prior: Prior) -> StateCoverage:
    """Compare the markers of frames with the simulated states.

    Args:
        frames: The frames.
        prior: The simulated states.

    Returns:
        Which states were shown, and what to record next.
    """
    displacements = frames.points - frames.dataset.rest_points
    state_distance = np.sqrt((prior.displacements**2).sum(2).mean(1))
    nearest = np.full(len(state_distance), np.inf)
    for k in range(0, len(displacements), _BLOCK_SIZE):
        difference = displacements[k : k + _BLOCK_SIZE, None] - prior.displacements
        with np.errstate(all="ignore"):
            distance = np.sqrt(np.nanmean((difference**2).sum(3), axis=2))
        nearest = np.minimum(nearest, np.nanmin(distance, axis=0))
    is_shown = nearest <= np.maximum(_MAX_DISTANCE_RATIO * state_distance, _MIN_DISTANCE_MM)
    is_last = frames.recording_index == frames.recording_index[-1]
    time = frames.time
    is_end = is_last & (time > time[is_last][-1] - _FINAL_REST_S)
    with np.errstate(all="ignore"):
        final = np.sqrt(np.nanmean((displacements[is_end] ** 2).sum(2), axis=1))
    limit = max(_MIN_DISTANCE_MM, _REST_RATIO * float(state_distance.max()))
    ends_at_rest = bool(np.median(final) <= limit)
    advice = _advise(prior, nearest, is_shown, ends_at_rest)
    return StateCoverage(prior.names, nearest, is_shown, ends_at_rest, advice)


def _advise(prior: Prior, nearest: Float, is_shown: Bool, ends_at_rest: bool) -> tuple[str, ...]:
    missing = np.flatnonzero(~is_shown[1:]) + 1
    # The state that is farthest from all frames comes first.
    order = missing[np.argsort(-nearest[missing])]
    advice = [
        f"show {prior.names[k]}: the nearest frame is {nearest[k]:.1f} mm away"
        for k in order[:_MAX_ADVICE]
    ]
    if len(order) > _MAX_ADVICE:
        advice.append(f"{len(order) - _MAX_ADVICE} more states were not shown")
    if not is_shown[0]:
        advice.append("rest for 10 s at the start")
    if not ends_at_rest:
        advice.append("rest for 10 s at the end, to show how the cords drifted")
    return tuple(advice)
