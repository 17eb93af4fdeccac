"""A gated recurrent network in NumPy, trained by backpropagation through time.

Networks that are fitted without one fold each have the same shape, so all are trained at once, as
one more dimension of every array. The steps are

    r = sigmoid(W_r x + b_r + U_r h + c_r),  z = sigmoid(W_z x + b_z + U_z h + c_z)
    n = tanh(W_n x + b_n + r (U_n h + c_n)),  h' = (1 - z) n + z h

and outputs are linear in (h', x). After training, outputs are fitted again in closed form to the
states over whole runs, as an alternative to those of the network.

References:
    Cho et al. 2014, Learning Phrase Representations using RNN Encoder-Decoder for Statistical
    Machine Translation (in the variant of cuDNN).
    Werbos 1990, Backpropagation through time: what it does and how to do it.
    Kingma & Ba 2015, Adam; Loshchilov & Hutter 2017, SGDR (cosine decay of the rate).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from defsense_fab.core.arrays import Float

WINDOW_STEPS, IGNORED_STEPS, WINDOWS = 150, 40, 16
ROUNDS, RATE, DECAY = 400, 1e-2, 1e-3
INPUT_NOISE = 0.02  # added to the scaled signals
MAX_INPUT = 4.0  # larger scaled signals are cut
WARM_UP_STEPS = 100  # with the first signals of a run
MAX_GRADIENT = 1.0
MOMENTUM, SECOND_MOMENTUM, TINY = 0.9, 0.999, 1e-8


@dataclass(frozen=True)
class Steps:
    """A run at the steps of the networks' clock.

    Attributes:
        signals: Scaled signals, shape (t, c).
        targets: Scaled targets, shape (t, o); 0 where they are unknown.
        weights: Weights of the steps for each of the k networks, shape (k, t); 0 where a network is
            not trained on the step.
    """

    signals: Float
    targets: Float
    weights: Float


class Networks:
    """k networks of h states with linear outputs.

    Args:
        rng: Generator of the first parameters, which are the same in all networks.
        k: Number of networks.
        h: Number of states.
        c: Number of signals.
        o: Number of outputs.
    """

    def __init__(self, rng: np.random.Generator, k: int, h: int, c: int, o: int) -> None:
        bound = h**-0.5

        def uniform(*shape: int) -> Float:
            one = rng.uniform(-bound, bound, shape).astype(np.float32)
            return np.repeat(one[None], k, axis=0)

        self.h = h
        self.parameters = [
            uniform(c, 3 * h),
            uniform(h, 3 * h),
            uniform(3 * h),
            uniform(3 * h),
            0.2 * uniform(h + c, o),
            np.zeros((k, o), np.float32),
        ]
        self._first = [np.zeros_like(p) for p in self.parameters]
        self._second = [np.zeros_like(p) for p in self.parameters]
        self._round = 0

    def train(self, runs: Sequence[Steps], rng: np.random.Generator, rounds: int = ROUNDS) -> None:
        """Train on windows drawn from runs."""
        cast = [
            Steps(*(x.astype(np.float32) for x in (r.signals, r.targets, r.weights))) for r in runs
        ]
        lengths = np.array([max(len(r.signals) - WINDOW_STEPS + 1, 1) for r in cast])
        for k in range(rounds):
            x, y, w = draw_windows(rng, cast, lengths)
            noise = INPUT_NOISE * rng.standard_normal(x.shape, np.float32)
            self._fit(x + noise, y, w, RATE * 0.5 * (1 + np.cos(np.pi * k / rounds)))

    def states(self, signals: Float) -> Float:
        """Return the states (t + 1, k, h) before and after each step of a run (t, c)."""
        x = np.clip(signals, -MAX_INPUT, MAX_INPUT).astype(np.float32)
        h = np.zeros((len(self.parameters[0]), self.h), np.float32)
        for _ in range(WARM_UP_STEPS):
            h = self.advance(h, x[:1])
        states = np.empty((len(x) + 1, *h.shape), np.float32)
        states[0] = h
        for t in range(len(x)):
            states[t + 1] = self.advance(states[t], x[t : t + 1])
        return states

    def advance(self, states: Float, signals: Float) -> Float:
        """Return the states after one step.

        Args:
            states: States, shape (k, h), or (n, k, h) for n independent steps.
            signals: Scaled signals, shape (1, c) or (n, c).
        """
        W, U, b, c = self.parameters[:4]
        h, is_one = self.h, states.ndim == 2
        before = states[None] if is_one else states  # (n, k, h)
        x = np.clip(signals, -MAX_INPUT, MAX_INPUT).astype(np.float32)
        a = (x @ W + b[:, None]).swapaxes(0, 1)  # (n, k, 3 h)
        u = (before.swapaxes(0, 1) @ U + c[:, None]).swapaxes(0, 1)
        gates = 0.5 + 0.5 * np.tanh(0.5 * (a[..., : 2 * h] + u[..., : 2 * h]))
        new = np.tanh(a[..., 2 * h :] + gates[..., :h] * u[..., 2 * h :])
        after = new + gates[..., h:] * (before - new)
        return np.asarray(after[0] if is_one else after)

    def outputs(self, k: int, states: Float, signals: Float) -> Float:
        """Return the outputs (n, o) of network k at its states (n, h)."""
        x = np.clip(signals, -MAX_INPUT, MAX_INPUT)
        V, v = self.parameters[4][k], self.parameters[5][k]
        return np.concatenate([states, x], axis=1) @ V + v

    def _fit(self, x: Float, y: Float, w: Float, rate: float) -> None:
        """Take one step of Adam for windows x (s, b, c), y (s, b, o) with weights (k, s, b)."""
        gradients = self.gradients(x, y, w)
        size = np.sqrt(sum((g**2).reshape(len(g), -1).sum(axis=1) for g in gradients))
        scale = np.minimum(1.0, MAX_GRADIENT / np.maximum(size, 1e-12))
        self._round += 1
        for p, g, first, second in zip(
            self.parameters, gradients, self._first, self._second, strict=True
        ):
            g *= scale.reshape(-1, *[1] * (g.ndim - 1)).astype(np.float32)
            first += (1 - MOMENTUM) * (g - first)
            second += (1 - SECOND_MOMENTUM) * (g * g - second)
            move = first / (1 - MOMENTUM**self._round)
            move /= np.sqrt(second / (1 - SECOND_MOMENTUM**self._round)) + TINY
            p -= rate * (move + DECAY * p)

    def gradients(self, x: Float, y: Float, w: Float) -> list[Float]:
        """Return the gradients of the mean squared errors by all parameters.

        Args:
            x: Signals of windows, shape (s, b, c).
            y: Targets, shape (s, b, o).
            w: Weights, shape (k, s, b).
        """
        W, U, b, c, V, v = self.parameters
        k, h = len(W), self.h
        s, n = x.shape[:2]
        a = (x.reshape(s * n, -1) @ W + b[:, None]).reshape(k, s, n, 3 * h)
        states = np.zeros((s + 1, k, n, h), x.dtype)
        gates = np.empty((s, k, n, 2 * h), x.dtype)
        kept, new = np.empty((2, s, k, n, h), x.dtype)
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
        by_a, by_u = np.empty((2, s, k, n, 3 * h), x.dtype)
        r, z = gates[..., :h], gates[..., h:]
        by_z = z * (1 - z) * (states[:-1] - new)
        by_n = (1 - z) * (1 - new * new)
        by_r = kept * r * (1 - r)
        UT, carried = U.swapaxes(1, 2), np.zeros((k, n, h), x.dtype)
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


def draw_windows(
    rng: np.random.Generator, runs: Sequence[Steps], lengths: Float
) -> tuple[Float, Float, Float]:
    """Return signals (s, b, c), targets (s, b, o) and weights (k, s, b) of b windows.

    Args:
        rng: Generator of the windows' places.
        runs: Runs to draw from, in float32.
        lengths: Number of places of a window in each run.
    """
    L, B = WINDOW_STEPS, WINDOWS
    x = np.zeros((L, B, runs[0].signals.shape[1]), np.float32)
    y = np.zeros((L, B, runs[0].targets.shape[1]), np.float32)
    w = np.zeros((len(runs[0].weights), L, B), np.float32)
    for b, i in enumerate(rng.choice(len(runs), B, p=lengths / lengths.sum())):
        start = int(rng.integers(lengths[i]))
        part = slice(start, start + L)
        n = len(runs[i].signals[part])
        x[:n, b] = np.clip(runs[i].signals[part], -MAX_INPUT, MAX_INPUT)
        y[:n, b], w[:, :n, b] = runs[i].targets[part], runs[i].weights[:, part]
    w[:, :IGNORED_STEPS] = 0.0
    return x, y, w
