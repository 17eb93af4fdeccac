"""Regressors of scikit-learn and a recurrent network on the same frames, split and folds.

Each family chooses its hyperparameters and its inputs by the error on the folds that are left out:
the signals alone, with lags, or with exponential memories.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from sklearn.ensemble import ExtraTreesRegressor, HistGradientBoostingRegressor
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import Ridge

from benchmarks.peers.recurrent import Networks, Steps
from benchmarks.real.recordings import Task
from defsense_fab.core.arrays import Float
from defsense_fab.decoding.signal_history import Past, interpolate_at
from defsense_fab.training.regression.frames import Frames

LAGS_S = (0.1, 0.2, 0.4, 0.8)
MEMORIES_S = {"memories to 3 s": (0.3, 1.0, 3.0), "memories to 30 s": (0.3, 1.0, 3.0, 10.0, 30.0)}
STATIC, LAGS = "signals", "lags"
INPUTS = (STATIC, LAGS, *MEMORIES_S)

RIDGE_PENALTIES = (1e-2, 1.0, 100.0)
KERNEL_SCALES, KERNEL_PENALTIES = (0.03, 0.1, 0.3), (0.03, 0.3)
MAX_KERNEL_FRAMES = 1500  # evenly spaced; kernel ridge solves a system of this size
TREES, MIN_LEAF = 100, 3
BOOSTING_ROUNDS = 150
STATES = (16, 32)  # of the recurrent network
MIN_STEP_S = 0.02  # of its clock
READOUT_PENALTY = 1e-3

Predict = Callable[[Float], Float]
Fit = Callable[[Float, Float], Predict]


@dataclass(frozen=True)
class PeerResult:
    """One choice of hyperparameters of a family.

    Attributes:
        family: Name of the family.
        choice: Its inputs and hyperparameters.
        cross_validated: Error on the folds left out; of several units, scaled.
        test: Error on the test frames; of several units, scaled.
        by_unit: Error on the test frames for each unit.
        cpu_s: CPU seconds of all fits of this choice.
    """

    family: str
    choice: str
    cross_validated: float
    test: float
    by_unit: dict[str, float]
    cpu_s: float


def inputs_of(frames: Frames, kind: str) -> Float:
    """Return one of INPUTS at frames, shape (t, d)."""
    channels = range(len(frames.dataset.channels))
    if kind in MEMORIES_S:
        return frames.inputs(Past(MEMORIES_S[kind]), channels)
    now = frames.inputs(Past(), channels)
    if kind == STATIC:
        return now
    lagged, when = np.empty((len(LAGS_S), *now.shape)), frames.time
    for k, run in enumerate(frames.dataset.recordings):
        is_of_run = frames.recording_index == k
        for i, lag in enumerate(LAGS_S):
            for c, signal in enumerate(run.signals.T):
                known = np.isfinite(signal)
                at = when[is_of_run] - lag  # constant before the first sample
                lagged[i, is_of_run, c] = np.interp(at, run.sample_time[known], signal[known])
    return np.concatenate([now, *lagged], axis=1)


def ridge(penalty: float) -> Fit:
    """Return ridge regression."""

    def fit(x: Float, y: Float) -> Predict:
        return Ridge(penalty).fit(x, y).predict

    return fit


def kernel_ridge(scale: float, penalty: float) -> Fit:
    """Return kernel ridge regression with Gaussian functions, on evenly spaced frames."""

    def fit(x: Float, y: Float) -> Predict:
        step = -(-len(x) // MAX_KERNEL_FRAMES)
        x, y = x[::step], y[::step]
        model = KernelRidge(alpha=penalty, kernel="rbf", gamma=scale / x.shape[1])
        model.fit(x, y - y.mean(0))
        return lambda q: model.predict(q) + y.mean(0)

    return fit


def extra_trees(seed: int) -> Fit:
    """Return extremely randomized trees."""

    def fit(x: Float, y: Float) -> Predict:
        model = ExtraTreesRegressor(TREES, min_samples_leaf=MIN_LEAF, random_state=seed)
        model.fit(x, y[:, 0] if y.shape[1] == 1 else y)
        return model.predict

    return fit


def boosting(seed: int) -> Fit:
    """Return gradient boosting on histograms, one model for each output."""

    def fit(x: Float, y: Float) -> Predict:
        models = [
            HistGradientBoostingRegressor(max_iter=BOOSTING_ROUNDS, random_state=seed).fit(x, o)
            for o in y.T
        ]
        return lambda q: np.stack([m.predict(q) for m in models], axis=1)

    return fit


def choices(seed: int) -> Iterator[tuple[str, str, Fit]]:
    """Yield family, hyperparameters and fit of each choice."""
    for penalty in RIDGE_PENALTIES:
        yield "ridge", f"penalty {penalty:g}", ridge(penalty)
    for scale in KERNEL_SCALES:
        for penalty in KERNEL_PENALTIES:
            name = f"gamma {scale:g}/inputs, penalty {penalty:g}"
            yield "kernel ridge", name, kernel_ridge(scale, penalty)
    yield "extra trees", f"{TREES} trees", extra_trees(seed)
    yield "boosting", f"{BOOSTING_ROUNDS} rounds", boosting(seed)


def fit_known(fit: Fit, x: Float, y: Float, query: Float) -> Float:
    """Fit outputs that are known in the same frames together, and predict them.

    Args:
        fit: The regressor.
        x: Inputs, shape (t, d).
        y: Outputs, shape (t, o); NaN in gaps.
        query: Inputs to predict at, shape (n, d).

    Returns:
        Predicted outputs (n, o).
    """
    middle, spread = x.mean(0), np.maximum(x.std(0), 1e-9)
    x, query = (x - middle) / spread, (query - middle) / spread
    is_known, out = np.isfinite(y), np.empty((len(query), y.shape[1]))
    for pattern in np.unique(is_known, axis=1).T:
        columns = np.flatnonzero((is_known == pattern[:, None]).all(axis=0))
        predict = fit(x[pattern], y[np.ix_(pattern, columns)])
        out[:, columns] = predict(query).reshape(len(query), -1)
    return out


def regress(task: Task, seed: int = 0) -> list[PeerResult]:
    """Measure all choices of all families of scikit-learn.

    Args:
        task: The divided recording.
        seed: Seed of the trees.

    Returns:
        The results of all choices.
    """
    results = []
    y = task.train.points.reshape(len(task.train), -1)
    for kind in INPUTS:
        x, query = inputs_of(task.train, kind), inputs_of(task.test, kind)
        for family, name, fit in choices(seed):
            start, left_out = time.process_time(), np.empty(y.shape)
            for k in range(task.options.folds):
                test = task.fold == k
                left_out[test] = fit_known(fit, x[~test], y[~test], x[test])
            predicted = fit_known(fit, x, y, query)
            cpu_s = time.process_time() - start
            results.append(_result(task, (family, f"{kind}, {name}"), left_out, predicted, cpu_s))
    return results


def _result(
    task: Task, name: tuple[str, str], left_out: Float, predicted: Float, cpu_s: float
) -> PeerResult:
    """Return the errors of outputs (t, o) of the folds left out, and of the test."""
    left_out = left_out.reshape(task.train.points.shape)
    predicted = predicted.reshape(task.test.points.shape)
    return PeerResult(
        *name,
        task.rmse(left_out, task.train),
        task.rmse(predicted, task.test),
        task.rmse_by_unit(predicted),
        cpu_s,
    )


def recur(task: Task, seed: int = 0) -> list[PeerResult]:
    """Measure recurrent networks of each size.

    Args:
        task: The divided recording.
        seed: Seed of the first parameters and of the windows.

    Returns:
        For each size, the errors of the network's outputs, and of outputs fitted in closed form.
    """
    clock = _Clock(task)
    results = []
    for size in STATES:
        start = time.process_time()
        rng = np.random.default_rng(seed)
        networks = Networks(
            rng, task.options.folds + 1, size, clock.middle.size, clock.target_middle.size
        )
        networks.train(clock.steps(), rng)
        x, states = clock.states(networks, task.train)  # of frames: (t, c), (t, k, h)
        query, test_states = clock.states(networks, task.test)
        half = (time.process_time() - start) / 2
        for kind in ("own outputs", "outputs by ridge"):
            start = time.process_time()
            left_out = np.empty((len(task.train), clock.target_middle.size))
            for k in range(task.options.folds):
                test = task.fold == k
                predict = clock.readout(networks, k, kind, x[~test], states[~test], ~test)
                left_out[test] = predict(states[test, k], x[test])
            k = task.options.folds
            predict = clock.readout(networks, k, kind, x, states, np.ones(len(x), bool))
            predicted = predict(test_states[:, k], query)
            cpu_s = half + time.process_time() - start
            name = ("recurrent network", f"{size} states, {kind}")
            results.append(_result(task, name, left_out, predicted, cpu_s))
    return results


class _Clock:
    """The clock of recurrent networks on a task, with scaled signals and targets."""

    def __init__(self, task: Task) -> None:
        self._task = task
        runs, frames = task.dataset.recordings, task.train
        sample_step = float(np.median(np.concatenate([np.diff(r.sample_time) for r in runs])))
        of_run = np.diff(frames.recording_index) == 0
        frame_step = float(np.median(np.diff(frames.time)[of_run]))
        self.step = max(frame_step, sample_step, MIN_STEP_S)
        x = inputs_of(frames, STATIC)
        y = frames.points.reshape(len(frames), -1)
        self.middle, self.spread = x.mean(0), np.maximum(x.std(0), 1e-9)
        self.target_middle = np.nanmean(y, axis=0)
        self.target_spread = np.maximum(np.nanstd(y, axis=0), 1e-9)
        self._y = (y - self.target_middle) / self.target_spread

    def _signals(self, run: int, at: Float) -> Float:
        """Return scaled signals (n, c) of a run at times (n,), held over gaps and at the ends."""
        r = self._task.dataset.recordings[run]
        columns = []
        for signal in r.signals.T:
            known = np.isfinite(signal)
            columns.append(np.interp(at, r.sample_time[known], signal[known]))
        return (np.stack(columns, axis=1) - self.middle) / self.spread

    def steps(self) -> list[Steps]:
        """Return the runs to train on, with weights of the networks: all but one fold, then all."""
        runs, frames, folds = [], self._task.train, self._task.options.folds
        for k in range(len(self._task.dataset.recordings)):
            index = np.flatnonzero(frames.recording_index == k)
            if len(index) < 2:
                continue
            when = frames.time[index]
            at = np.arange(when[0], when[-1], self.step)
            complete = index[np.isfinite(self._y[index]).all(axis=1)]
            if len(at) < 2 or len(complete) < 2:
                continue
            gap = max(0.25, 2.5 * self.step)
            y = interpolate_at(at, frames.time[complete], self._y[complete], gap)
            is_known = np.isfinite(y).all(axis=1)
            fold = self._task.fold[index][np.minimum(np.searchsorted(when, at), len(index) - 1)]
            weights = [is_known & (fold != f) for f in range(folds)] + [is_known]
            runs.append(Steps(self._signals(k, at), np.nan_to_num(y), np.array(weights, float)))
        return runs

    def states(self, networks: Networks, frames: Frames) -> tuple[Float, Float]:
        """Return scaled signals (t, c) and states (t, k, h) at frames, without later samples."""
        x = np.empty((len(frames), self.middle.size))
        states = np.empty((len(frames), len(networks.parameters[0]), networks.h), np.float32)
        for k, run in enumerate(self._task.dataset.recordings):
            index = np.flatnonzero(frames.recording_index == k)
            if not len(index):
                continue
            at, when = np.arange(run.sample_time[0], run.sample_time[-1], self.step), frames.time
            x[index] = self._signals(k, when[index])
            after = networks.states(self._signals(k, at))
            # The last state that is half a step to one and a half steps before the frame.
            last = np.floor((when[index] - at[0]) / self.step - 0.5).astype(int) + 1
            states[index] = networks.advance(after[np.clip(last, 0, len(at))], x[index])
        return x, states

    def readout(
        self, networks: Networks, k: int, kind: str, x: Float, states: Float, which: Float
    ) -> Callable[[Float, Float], Float]:
        """Return the outputs of network k, its own or those fitted to signals and states."""

        def unscale(y: Float) -> Float:
            return y * self.target_spread + self.target_middle

        if kind == "own outputs":
            return lambda s, q: unscale(networks.outputs(k, s, q))
        train = np.concatenate([states[:, k], x], axis=1)
        penalty = READOUT_PENALTY * len(train)
        y = self._y[which]
        return lambda s, q: unscale(
            fit_known(ridge(penalty), train, y, np.concatenate([s, q], axis=1))
        )
