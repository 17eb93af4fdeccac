"""Fit the memory of the twin's cords to recordings of real sensors, in the forward direction.

    python -m benchmarks.cord_memory FOLDER                          # all recordings of a folder
    python -m benchmarks.cord_memory FOLDER --constants knit-squat knit-hamstring45

FOLDER contains recordings: folders with `signals.csv` and `targets.csv` (or `run0-signals.csv`,
...), a column of time (s) in each. Each signal is predicted from the targets: by a line, by a cubic
without memory, and by that cubic followed by the memory of each family of cords. Everything is
fitted to the first 70 % in time; NRMSE is the RMS error on the last 30 % over the standard
deviation of the signal there. `--constants` names the recordings whose constants are combined to
rows of `data/cord_memory.csv`: medians over channels, and the spread of pieces of cord. Constants
of recordings without a licence must not be committed.

The spread between channels of one recording contains the error of the fits. To separate it, each
channel is fitted twice, to either half of its training part. The variance between the channels'
means, less half of the variance within channels, is the variance of channels (analysis of variance
with one random effect, pooled over recordings, negative estimates kept). The row `spread` is the
square root of its median over the constants, in logarithms (`exponent`: plain; `friction`: relative
to its median). Where the median is not positive, nothing can be separated. The result still
contains the place of each sensor at the knee, and what the model lacks in both halves alike.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from defsense_fab.core.arrays import Bool, Float
from defsense_fab.twin.electronics.hysteretic_memory import CONSTANTS, HystereticMemory
from defsense_fab.twin.electronics.rubber_cords import MemoryTraits

TRAINED_SHARE = 0.7
STARTS, FIRST_EVALUATIONS, EVALUATIONS = 3, 12, 50
GAP_S = 10.0  # between runs that are joined
MAX_RATE_HZ = 30.0
FRESH = 0.05  # of the span of the target
PRIOR_SHARE = 0.004  # of the variance, that one prior width of a parameter costs
WARP_LIMIT = 3.0
Model = Callable[[Float, Float, Float], Float]
# Start and prior width of each parameter; all but friction and exponent are logarithms.
START = np.array([-0.15, -0.3, *np.log([0.7, 0.4, 0.5, 0.3, 0.5, 3.0, 40.0, 1.2, 0.1, 5.0])])
WIDTH = np.array([0.4, 0.6, *np.full(5, 0.9), *np.full(2, 1.5), 0.7, 0.9, 0.9])
VISCOELASTIC_START = np.array(
    [
        0.06,
        0.05,
        0.05,
        *np.log([0.4, 5.0, 50.0]),
        0.6,
        np.log(0.03),
        0.12,
        *np.log([0.05, 0.03]),
        0.12,
    ]
)
VISCOELASTIC_WIDTH = np.array([0.4, 0.4, 0.4, 1.2, 1.2, 1.2, 1.0, 3.0, 0.4, 0.9, 0.9, 0.4])


def read(folder: Path) -> tuple[Float, Float, Float]:
    """Return times (n,) s, targets (n, d) and signals (n, c) of a recording, its runs joined."""
    parts, end = [], 0.0
    for path in sorted(folder.glob("*signals.csv")):
        signals = np.genfromtxt(path, delimiter=",", skip_header=1)
        targets = np.genfromtxt(
            path.with_name(path.name.replace("signals", "targets")), delimiter=",", skip_header=1
        )
        n = min(len(signals), len(targets))
        every = max(round(1 / np.median(np.diff(signals[:, 0])) / MAX_RATE_HZ), 1)
        joined = np.column_stack([signals[:n, 0] + end, targets[:n, 1:], signals[:n, 1:]])[::every]
        joined = joined[np.isfinite(joined).all(axis=1)]
        parts.append(joined)
        end = joined[-1, 0] + GAP_S
    rows, d = np.concatenate(parts), targets.shape[1] - 1
    return rows[:, 0], rows[:, 1 : 1 + d], rows[:, 1 + d :]


def excite(targets: Float, signal: Float, train: Bool) -> Float:
    """Return one input (n,) from 0 to 1: the target, or of several the quadratic that fits best."""
    u = targets[:, 0]
    if targets.shape[1] > 1:
        x = (targets - targets[train].mean(0)) / (targets[train].std(0) + 1e-9)
        _, _, axes = np.linalg.svd(x[train], full_matrices=False)
        x = x @ axes[:3].T
        pairs = [x[:, i] * x[:, j] for i in range(x.shape[1]) for j in range(i + 1)]
        A = np.column_stack([np.ones(len(x)), x, *pairs])
        u = A @ np.linalg.lstsq(A[train], signal[train], rcond=None)[0]
    low, high = np.percentile(u[train], [0.5, 99.8])
    return np.asarray((u - low) / (high - low))


def warp(u: Float, bends: Float) -> Float:
    """Return a cubic of u that is 0 at 0 and 1 at 1."""
    return u + bends[0] * (u * u - u) + bends[1] * (u**3 - u)


def hysteretic(p: Float, time: Float, s: Float) -> Float:
    """Return the response (n,) of the hysteretic family to an ideal signal s (n,)."""
    pieces = np.array([*p[:2], *np.exp(np.clip(p[2:], -12, 12))])[None]
    memory = replace(HystereticMemory(), fresh=FRESH)
    return memory.respond(time, s[:, None], memory.new_state(1), pieces)[0][:, 0]


def viscoelastic(p: Float, time: Float, s: Float) -> Float:
    """Return the response (n,) of the viscoelastic family to an ideal signal s (n,)."""
    times, flow, widths = np.exp(p[3:6]), np.exp(p[7]), np.exp(p[9:11])
    memory = MemoryTraits(
        tear=tuple(p[:3]),
        times=tuple(times),
        released=p[6],
        flow=flow,
        friction=p[8],
        width_stretched=widths[0],
        width_released=widths[1],
        mullins=p[11],
        fresh=FRESH,
    )
    return memory.respond(time, s[:, None], memory.new_state(1), np.empty((1, 0)))[0][:, 0]


def no_memory(p: Float, time: Float, s: Float) -> Float:
    """Return the ideal signal itself."""
    return s


def scale(response: Float, signal: Float, train: Bool) -> tuple[Float, float]:
    """Return the line of a response that fits a signal best, and its slope."""
    A = np.column_stack([response, np.ones(len(response))])
    line = np.linalg.lstsq(A[train], signal[train], rcond=None)[0]
    return A @ line, float(line[0])


def fit(
    model: Model, start: Float, width: Float, data: tuple[Float, Float, Float, Bool], seed: int = 0
) -> tuple[Float, Float, float]:
    """Fit a cubic and a memory to a signal.

    Args:
        model: Response of a memory to an ideal signal.
        start: Parameters of the memory to start from.
        width: Width of the prior of each.
        data: Times, input, signal and which samples to fit.
        seed: Seed of further starts.

    Returns:
        Parameters of the memory, the predicted signal (n,), and its slope over the response.
    """
    time, u, signal, train = data
    deviation = signal[train].std()
    p0, spans = np.concatenate([np.zeros(2), start]), np.concatenate([np.ones(2), width])
    weight = np.sqrt(PRIOR_SHARE * train.sum())
    last = np.flatnonzero(train)[-1] + 1

    def residuals(p: Float) -> Float:
        response = model(p[2:], time[:last], warp(u[:last], p[:2]))
        predicted, _ = scale(response, signal[:last], train[:last])
        prior = weight * 0.3 * (p - p0) / spans
        return np.concatenate([(predicted - signal[:last])[train[:last]] / deviation, prior])

    def refine(p: Float, evaluations: int) -> tuple[float, Float]:
        found = least_squares(
            residuals, p, diff_step=1e-3, x_scale=spans, max_nfev=evaluations, method="trf"
        )
        return found.cost, found.x

    rng = np.random.default_rng(seed)
    starts = [p0, *(p0 + 0.5 * spans * rng.normal(size=len(p0)) for _ in range(STARTS - 1))]
    best = min((refine(p, FIRST_EVALUATIONS) for p in starts), key=lambda r: r[0])[1]
    best = refine(best, EVALUATIONS)[1]
    predicted, slope = scale(model(best[2:], time, warp(u, best[:2])), signal, train)
    return best[2:], predicted, slope


def choose_channels(signals: Float, limit: int) -> list[int]:
    """Return the channels that move, or the `limit` ones that move most."""
    moving = [c for c in range(signals.shape[1]) if signals[:, c].std() > 1e-9]
    if len(moving) > limit:
        moving = sorted(moving, key=lambda c: -signals[:, c].std())[:limit]
    return moving


def fit_recording(folder: Path, limit: int) -> list[Float]:
    """Fit each channel, print its errors; return the constants of the hysteretic family."""
    time, targets, signals = read(folder)
    train = np.arange(len(time)) < TRAINED_SHARE * len(time)
    constants, errors = [], []
    for c in choose_channels(signals[train], limit):
        signal = signals[:, c]
        u = excite(targets, signal, train)
        data = (time, u, signal, train)
        empty = np.zeros(0)
        line = scale(u, signal, train)[0]
        cubic = fit(no_memory, empty, empty, data)[1]
        old = fit(viscoelastic, VISCOELASTIC_START, VISCOELASTIC_WIDTH, data)[1]
        p, new, _ = fit(hysteretic, START, WIDTH, data)
        test = ~train
        row = [
            np.sqrt(np.mean((x - signal)[test] ** 2)) / signal[test].std()
            for x in (line, cubic, old, new)
        ]
        errors.append(row)
        constants.append(p)
        print(f"{folder.name} {c}: " + " ".join(f"{x:.3f}" for x in row), flush=True)
    mean = np.exp(np.log(errors).mean(0))
    names = ("line", "cubic", "viscoelastic", "hysteretic")
    text = ", ".join(f"{n} {x:.3f}" for n, x in zip(names, mean, strict=True))
    print(f"{folder.name}: geometric mean of {len(errors)} channels: {text}", flush=True)
    return constants


def fit_halves(folder: Path, limit: int) -> Float:
    """Return the constants (c, 2, 12) of channels, fitted to halves of the training part."""
    time, targets, signals = read(folder)
    train = np.arange(len(time)) < TRAINED_SHARE * len(time)
    first = np.arange(len(time)) < TRAINED_SHARE * len(time) / 2
    constants = []
    for c in choose_channels(signals[train], limit):
        u = excite(targets, signals[:, c], train)
        halves = [
            fit(hysteretic, START, WIDTH, (time, u, signals[:, c], half))[0]
            for half in (first, train & ~first)
        ]
        constants.append(halves)
        print(f"{folder.name} {c}: both halves fitted", flush=True)
    return np.array(constants)


def separate_variances(recordings: Sequence[Float]) -> tuple[Float, Float]:
    """Estimate the variance of channels and the variance within them, for each constant.

    Args:
        recordings: Constants (c, 2, k) of the channels of each recording, fitted twice.

    Returns:
        The variance (k,) of channels, which may be negative, and of the two fits of a channel (k,).
    """
    means = [fits.mean(axis=1) for fits in recordings]
    freedom = sum(len(mean) - 1 for mean in means)
    between = sum(((mean - mean.mean(axis=0)) ** 2).sum(axis=0) for mean in means) / freedom
    within = np.concatenate([np.diff(fits, axis=1)[:, 0] ** 2 / 2 for fits in recordings]).mean(0)
    return between - within / 2, within


def print_constants(fitted: dict[str, list[Float]], halves: dict[str, Float]) -> None:
    """Print the medians of the constants, and the spread of pieces without errors of fits."""
    everything = np.concatenate([np.array(rows) for rows in fitted.values()])
    within = np.concatenate([np.array(r) - np.median(r, axis=0) for r in fitted.values()])
    middle, spread = np.median(everything, axis=0), 1.4826 * np.median(np.abs(within), axis=0)
    scale = np.ones(len(CONSTANTS))
    scale[CONSTANTS.index("friction")] = abs(middle[CONSTANTS.index("friction")])
    pieces, error = separate_variances([fits / scale for fits in halves.values()])
    for k, name in enumerate(CONSTANTS):
        value = middle[k] if k < 2 else np.exp(middle[k])
        print(
            f"{name}: {value:.3g}; channels differ by {spread[k] / scale[k]:.2g}; variance of"
            f" channels {pieces[k]:.3f}, within {error[k]:.3f}"
        )
    middle_variance = float(np.median(pieces))
    text = f"{np.sqrt(middle_variance):.2g}" if middle_variance > 0 else "cannot be separated"
    print(
        f"spread of pieces: {text} (variance {middle_variance:.3f}, error {np.median(error):.3f})"
    )


def main() -> None:
    """Fit the recordings of a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of recordings")
    parser.add_argument("--only", nargs="+", help="names of recordings")
    parser.add_argument("--constants", nargs="+", default=(), help="recordings to take them from")
    parser.add_argument("--channels", type=int, default=6, help="most channels of a recording")
    options = parser.parse_args()
    fitted, halves = {}, {}
    for folder in sorted(p for p in options.folder.iterdir() if p.is_dir()):
        if options.only and folder.name not in options.only:
            continue
        constants = fit_recording(folder, options.channels)
        if folder.name in options.constants:
            fitted[folder.name] = constants
            halves[folder.name] = fit_halves(folder, options.channels)
    if fitted:
        print_constants(fitted, halves)


if __name__ == "__main__":
    main()
