"""Train recurrent networks by backpropagation through time.

Networks that are fitted without one fold each have the same shape, so all are trained at once, as
one more dimension of every array. A network with a linear decoder learns the main movements of the
targets on windows of `_WINDOW_STEPS` steps, each of which starts with a state of zero; its first
steps do not count. Only the network is kept: what decodes its states is fitted later, in closed
form.

References:
    Werbos 1990, Backpropagation through time: what it does and how to do it.
    Kingma & Ba 2015, Adam: a method for stochastic optimization.
    Loshchilov & Hutter 2017, SGDR (cosine decay of the rate).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.progress import Progress, silent
from ...decoding.recurrent_network import MAX_INPUT, RecurrentNetwork

_STATES = 16
_WINDOW_STEPS, _IGNORED_STEPS, _WINDOWS = 150, 40, 16
_ROUNDS, _RATE, _DECAY = 400, 1e-2, 1e-3
_INPUT_NOISE = 0.02  # added to the scaled signals
_MAX_STEPS = 3000.0  # in the whole training; the network's clock is not faster
_MAX_STEP_S = 0.1
_MOMENTUM, _SECOND_MOMENTUM, _TINY = 0.9, 0.999, 1e-8
_MAX_GRADIENT = 1.0


@dataclass(frozen=True)
class Run:
    """A recording at the steps of a network's clock.

    Attributes:
        signals: Signals, shape (t, c).
        targets: Targets, shape (t, o); 0 where they are unknown.
        weights: Weights of the steps for each of the k networks, shape (k, t); 0 where a network
            is not trained on the step.
    """

    signals: Float
    targets: Float
    weights: Float


def clock_step(frame_steps: Float, sample_step: float) -> float:
    """Choose the time between the steps of a network, s.

    Args:
        frame_steps: Times between the frames to train on, shape (t,), s.
        sample_step: Time between the samples of the signals, s.

    Returns:
        The time; it is no shorter than that between frames and between samples.
    """
    slowest = max(float(np.median(frame_steps)), sample_step)
    return max(slowest, min(float(frame_steps.sum()) / _MAX_STEPS, _MAX_STEP_S))


def train_networks(
    runs: Sequence[Run], step: float, progress: Progress = silent, seed: int = 0
) -> list[RecurrentNetwork]:
    """Train networks on the same recordings with different weights of the steps.

    Args:
        runs: The recordings.
        step: Time between the steps, s.
        progress: Called with the stage "train".
        seed: Seed of the first weights and of the windows.

    Returns:
        The k networks.
    """
    is_used = [run.weights.any(axis=0) for run in runs]
    signals = np.concatenate([run.signals[used] for run, used in zip(runs, is_used, strict=True)])
    middle, spread = signals.mean(axis=0), np.maximum(signals.std(axis=0), 1e-9)
    scaled = [
        np.clip((run.signals - middle) / spread, -MAX_INPUT, MAX_INPUT).astype(np.float32)
        for run in runs
    ]
    targets = [run.targets.astype(np.float32) for run in runs]
    weights = [run.weights.astype(np.float32) for run in runs]
    rng = np.random.default_rng(seed)
    networks = _Networks(rng, len(weights[0]), len(middle), targets[0].shape[1])
    lengths = np.array([max(len(x) - _WINDOW_STEPS + 1, 1) for x in scaled])
    for k in range(_ROUNDS):
        if k % 40 == 0:
            progress("train", 0.55 + 0.2 * k / _ROUNDS, "training a recurrent network")
        x, y, w = _draw_windows(rng, scaled, targets, weights, lengths)
        noise = _INPUT_NOISE * rng.standard_normal(x.shape, np.float32)
        networks.fit(x + noise, y, w, _RATE * 0.5 * (1 + np.cos(np.pi * k / _ROUNDS)))
    return [
        RecurrentNetwork(step, middle, spread, *(p[n].astype(float) for p in networks.network))
        for n in range(len(weights[0]))
    ]


def _draw_windows(
    rng: np.random.Generator,
    signals: Sequence[Float],
    targets: Sequence[Float],
    weights: Sequence[Float],
    lengths: Float,
) -> tuple[Float, Float, Float]:
    """Return signals (s, b, c), targets (s, b, o) and weights (k, s, b) of b windows."""
    L, B = _WINDOW_STEPS, _WINDOWS
    x = np.zeros((L, B, signals[0].shape[1]), np.float32)
    y = np.zeros((L, B, targets[0].shape[1]), np.float32)
    w = np.zeros((len(weights[0]), L, B), np.float32)
    for b, i in enumerate(rng.choice(len(signals), B, p=lengths / lengths.sum())):
        start = int(rng.integers(lengths[i]))
        part = slice(start, start + L)
        n = len(signals[i][part])
        x[:n, b], y[:n, b], w[:, :n, b] = signals[i][part], targets[i][part], weights[i][:, part]
    w[:, :_IGNORED_STEPS] = 0.0
    return x, y, w


class _Networks:
    """k networks of h states with linear decoders, and the moments of their gradients."""

    def __init__(self, rng: np.random.Generator, k: int, c: int, o: int) -> None:
        h, bound = _STATES, _STATES**-0.5

        def uniform(*shape: int) -> Float:
            # The same start for all, so that folds differ by their data alone.
            one = rng.uniform(-bound, bound, shape).astype(np.float32)
            return np.repeat(one[None], k, axis=0)

        self.network = [
            uniform(c, 3 * h),
            uniform(h, 3 * h),
            uniform(3 * h),
            uniform(3 * h),
        ]
        self.decoder = [0.2 * uniform(h + c, o), np.zeros((k, o), np.float32)]
        self._first = [np.zeros_like(p) for p in self.network + self.decoder]
        self._second = [np.zeros_like(p) for p in self.network + self.decoder]
        self._round = 0

    def fit(self, x: Float, y: Float, w: Float, rate: float) -> None:
        """Take one step of Adam for windows x (s, b, c), y (s, b, o) with weights (k, s, b)."""
        gradients = self._gradients(x, y, w)
        size = np.sqrt(sum((g**2).reshape(len(g), -1).sum(axis=1) for g in gradients))
        scale = np.minimum(1.0, _MAX_GRADIENT / np.maximum(size, 1e-12))
        self._round += 1
        for p, g, first, second in zip(
            self.network + self.decoder, gradients, self._first, self._second, strict=True
        ):
            g *= scale.reshape(-1, *[1] * (g.ndim - 1)).astype(np.float32)
            first += (1 - _MOMENTUM) * (g - first)
            second += (1 - _SECOND_MOMENTUM) * (g * g - second)
            move = first / (1 - _MOMENTUM**self._round)
            move /= np.sqrt(second / (1 - _SECOND_MOMENTUM**self._round)) + _TINY
            p -= rate * (move + _DECAY * p)

    def _gradients(self, x: Float, y: Float, w: Float) -> list[Float]:
        """Return the gradients of the mean squared errors by all parameters."""
        W, U, b, c = self.network
        V, v = self.decoder
        k, h = len(W), _STATES
        s, n = x.shape[:2]
        a = (x.reshape(s * n, -1) @ W + b[:, None]).reshape(k, s, n, 3 * h)
        states = np.zeros((s + 1, k, n, h), np.float32)
        gates = np.empty((s, k, n, 2 * h), np.float32)
        kept, new = np.empty((2, s, k, n, h), np.float32)
        for t in range(s):
            u = states[t] @ U + c[:, None]
            gates[t] = 0.5 + 0.5 * np.tanh(0.5 * (a[:, t, :, : 2 * h] + u[..., : 2 * h]))
            kept[t] = u[..., 2 * h :]
            new[t] = np.tanh(a[:, t, :, 2 * h :] + gates[t, ..., :h] * kept[t])
            states[t + 1] = new[t] + gates[t, ..., h:] * (states[t] - new[t])
        shared = np.broadcast_to(x[None], (k, *x.shape))
        inputs = np.concatenate([states[1:].swapaxes(0, 1), shared], axis=3)
        inputs = inputs.reshape(k, s * n, -1)
        weight = w.reshape(k, s * n, 1)
        total = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
        error = 2 * weight / total * (inputs @ V + v[:, None] - y.reshape(s * n, -1))
        by_V, by_v = inputs.swapaxes(1, 2) @ error, error.sum(axis=1)
        by_states = (error @ V[:, :h].swapaxes(1, 2)).reshape(k, s, n, h)
        by_a, by_u = np.empty((2, s, k, n, 3 * h), np.float32)
        r, z = gates[..., :h], gates[..., h:]
        by_z = z * (1 - z) * (states[:-1] - new)
        by_n = (1 - z) * (1 - new * new)
        by_r = kept * r * (1 - r)
        UT, carried = U.swapaxes(1, 2), np.zeros((k, n, h), np.float32)
        for t in range(s - 1, -1, -1):
            g = carried + by_states[:, t]
            d = g * by_n[t]
            by_a[t, ..., :h] = d * by_r[t]
            by_a[t, ..., h : 2 * h] = g * by_z[t]
            by_a[t, ..., 2 * h :] = d
            by_u[t] = by_a[t]
            by_u[t, ..., 2 * h :] *= r[t]
            carried = g * z[t] + by_u[t] @ UT
        by_a, by_u = (g.swapaxes(0, 1).reshape(k, s * n, 3 * h) for g in (by_a, by_u))
        by_W = x.reshape(s * n, -1).T @ by_a
        by_U = states[:-1].swapaxes(0, 1).reshape(k, s * n, h).swapaxes(1, 2) @ by_u
        return [by_W, by_U, by_a.sum(axis=1), by_u.sum(axis=1), by_V, by_v]
