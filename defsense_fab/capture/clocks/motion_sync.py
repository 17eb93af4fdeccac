"""Find the lag at which motion and signals have most in common.

Both are smoothed onto one grid of time, and slow changes, such as a cord's creep, are removed. At a
lag, their common information is the mutual information of Gaussian variables (from all canonical
correlations). Its moments are kept by block: a drift moves blocks against each other, and leaving
out one block at a time (the jackknife) gives the standard deviations of lag and drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from .clock_fit import ClockMatch, Clocks

GRID_STEP_S = 0.02
SEARCH_STEPS = 4  # grid steps between lags of the search
MIN_BLUR_S = 0.04  # more if frames or samples are less frequent
SLOW_S = 4.0  # slower changes are removed
#: Slow motion is blurred by the first; changes slower than the second are removed from fast motion.
SLOW_BLUR_S, FAST_BLUR_S = 0.16, 0.6
MAX_COMPONENTS = 6  # of motion and of signals
SQUARED_COMPONENTS = 2  # enter squared as well, because signals are nonlinear
RIDGE = 1e-3
#: Ridge of the prediction, for a variance of one: a component that hardly moves in one half must
#: not predict anything.
PREDICTION_RIDGE = 0.1
NEIGHBOR_LAGS = 15  # grid steps on each side of the best lag
MIN_DRIFT_SPAN_S = 40.0  # a shorter span does not determine a drift
UNDETERMINED_DRIFT_SIGMA = 1e-4
BLOCK_S = 5.0
MIN_INFORMATION = 0.1  # nats
MIN_EXPLAINED_VARIANCE = (
    0.1  # of the signals, predicted from motion in the other half of the blocks
)
#: Neighboring blocks are correlated, which makes the jackknife's deviations too small by this.
JACKKNIFE_FACTOR = 1.4
MAX_OTHER_INFORMATION = 0.75  # at another lag, relative to the best
MIN_KNOWN_SHARE = 0.6  # of a column's values
MIN_KNOWN_ROWS, MIN_COMPONENT_ROWS = 20, 50
EXPLAINED_BY_COMPONENTS = 0.999


@dataclass(frozen=True)
class MotionMatch(ClockMatch):
    """Relation of the clocks by motion.

    Attributes:
        disagreement: Difference of the offsets of slow and fast motion, s; 0 if they agree.
    """

    disagreement: float


@dataclass(frozen=True)
class _Rows:
    """Values (g, k) on a grid that starts at step `first`, and which of its rows are known."""

    first: int
    values: Float
    known: Bool


@dataclass(frozen=True)
class _RefinedLag:
    """Lag, s, and drift with standard deviations; span and middle of the common time, s."""

    lag: float
    drift: float
    lag_sigma: float
    drift_sigma: float
    span: float
    middle: float


def find_lag(
    time: Float,
    motion: Float,
    device: Float,
    signals: Float,
    expected: Clocks,
    within: float | None,
) -> MotionMatch:
    """Find the lag and drift between motion and signals.

    Args:
        time: Times of the frames (t,), s.
        motion: Motion (t, d), NaN where not known.
        device: Device times of the samples (n,), s.
        signals: Signals (n, c), NaN where not known.
        expected: Relation that is known beforehand.
        within: Largest difference from the expected offset, s; None for any.

    Raises:
        CaptureError: If nothing moves, or no lag stands out.
    """
    sample_time = expected.to_host(device)
    blur = max(MIN_BLUR_S, *(1.1 * float(np.median(np.diff(t))) for t in (time, sample_time)))
    x, y = _smooth(time, motion, blur), _smooth(sample_time, signals, blur)
    x_main = _components(_remove_slow(x, SLOW_S), "motion")
    y_main = _components(_remove_slow(y, SLOW_S), "signals")
    bent = np.hstack([x_main.values, x_main.values[:, :SQUARED_COMPONENTS] ** 2])
    x_main = _Rows(x_main.first, bent, x_main.known)
    best = _search(x_main, y_main, within)
    fit = _refine(x_main, y_main, best)
    slow = [_components(_remove_slow(_blur(r, SLOW_BLUR_S), SLOW_S), "motion") for r in (x, y)]
    fast = [_components(_remove_slow(r, FAST_BLUR_S), "motion") for r in (x, y)]
    ends = [_refine(a, b, best, fixed_drift=fit.drift) for a, b in (slow, fast)]
    difference = abs(ends[0].lag - ends[1].lag)
    differs = difference > 2 * float(np.hypot(ends[0].lag_sigma, ends[1].lag_sigma))
    device_middle = (fit.middle - fit.lag - expected.offset) / (1 + expected.drift)
    return MotionMatch(
        drift=(1 + expected.drift) / (1 - fit.drift) - 1,
        sigma=fit.lag_sigma,
        drift_sigma=fit.drift_sigma,
        middle=fit.middle,
        device_middle=float(device_middle),
        span=fit.span,
        disagreement=difference if differs else 0.0,
    )


def _smooth(time: Float, values: Float, blur: float) -> _Rows:
    """Fit local lines under a Gaussian window onto the grid, without columns with many gaps."""
    is_known = np.isfinite(values)
    values = values[:, is_known.mean(0) > MIN_KNOWN_SHARE]
    good = np.isfinite(values).all(1)
    if values.shape[1] == 0 or good.sum() < MIN_KNOWN_ROWS:
        raise CaptureError(
            "motion or signals are missing for most of the time",
            code="motion-mostly-missing",
            where="synchronization",
            action="Record again with the markers in view and the cords connected",
        )
    t, v = time[good], values[good] - values[good].mean(0)
    first, size = int(np.floor(t[0] / GRID_STEP_S)), int(np.ceil(np.ptp(t) / GRID_STEP_S)) + 2
    reach = int(np.ceil(3.5 * blur / GRID_STEP_S))
    nearest = np.round(t / GRID_STEP_S).astype(int) - first
    weights = np.zeros((3, size))
    sums = np.zeros((2, size, v.shape[1]))
    for k in range(-reach, reach + 1):
        row = nearest + k
        inside = (row >= 0) & (row < size)
        row = row[inside]
        u = (t[inside] - (row + first) * GRID_STEP_S) / blur
        w = np.exp(-(u**2) / 2)
        for power in range(3):
            weights[power] += np.bincount(row, w * u**power, size)
        for power in range(2):
            np.add.at(sums[power], row, (w * u**power)[:, None] * v[inside])
    det = weights[0] * weights[2] - weights[1] ** 2
    numerator = weights[2][:, None] * sums[0] - weights[1][:, None] * sums[1]
    level = numerator / np.maximum(det, 1e-9)[:, None]
    known = (weights[0] > 0.4 * np.median(weights[0])) & (det > 0.1 * np.median(det))
    return _Rows(first, np.where(known[:, None], level, 0.0), known)


def _blur(rows: _Rows, blur: float) -> _Rows:
    """Blur rows by a Gaussian of `blur` s."""
    sigma = blur / GRID_STEP_S
    weight = gaussian_filter1d(rows.known.astype(float), sigma, mode="constant")
    sums = gaussian_filter1d(rows.values * rows.known[:, None], sigma, axis=0, mode="constant")
    known = rows.known & (weight > 0.3)
    return _Rows(rows.first, sums / np.maximum(weight, 1e-3)[:, None], known)


def _remove_slow(rows: _Rows, blur: float) -> _Rows:
    """Subtract the rows blurred by `blur` s."""
    slow = _blur(rows, blur)
    return _Rows(rows.first, rows.values - slow.values, slow.known)


def _components(rows: _Rows, name: str) -> _Rows:
    """Return the main components, each of variance one."""
    part = rows.values[rows.known]
    if len(part) < MIN_COMPONENT_ROWS:
        raise CaptureError(
            f"{name} is known for too short a time",
            code="recording-too-short",
            where="synchronization",
            action="Record longer",
            input=name,
        )
    scale = part.std(0)
    if name == "signals":  # channels may have different scales
        part, values = part[:, scale > 0] / scale[scale > 0], rows.values[:, scale > 0]
        values = values / scale[scale > 0]
    else:
        values = rows.values
    if not (scale > 1e-12).any():
        raise CaptureError(
            "no marker moves" if name == "motion" else "no signal changes",
            code="motion-constant" if name == "motion" else "signals-constant",
            where="synchronization",
            action="Move the device while recording",
        )
    center = part.mean(0)
    _, size, axes = np.linalg.svd(part - center, full_matrices=False)
    explained = np.cumsum(size**2) / (size**2).sum()
    count = int(np.searchsorted(explained, EXPLAINED_BY_COMPONENTS)) + 1
    count = min(count, MAX_COMPONENTS, len(size))
    out = (values - center) @ axes[:count].T / (size[:count] / np.sqrt(len(part)))
    return _Rows(rows.first, out * rows.known[:, None], rows.known)


def _moments(x: _Rows, y: _Rows, lag: int, part: slice) -> Float:
    """Return sums (1 + p + q, 1 + p + q) of products of ones, x and y over the rows `part` of x.

    The rows of y are `lag` grid steps earlier.
    """
    start = part.start + x.first - lag - y.first
    stop = start + part.stop - part.start
    a, b = max(start, 0), min(stop, len(y.values))
    if b <= a:
        return np.zeros((1 + x.values.shape[1] + y.values.shape[1],) * 2)
    rows = slice(part.start + a - start, part.stop + b - stop)
    both = (x.known[rows] & y.known[a:b])[:, None]
    z = np.hstack([np.ones((b - a, 1)), x.values[rows], y.values[a:b]]) * both
    return np.asarray(z.T @ z)


def _information(moments: Float, p: int) -> Float:
    """Return nats (...) that the first p of m variables share with the others."""
    n = np.maximum(moments[..., :1, :1], 1.0)
    mean = moments[..., 0, 1:] / n[..., 0]
    spread = moments[..., 1:, 1:] / n - mean[..., :, None] * mean[..., None, :]
    spread = spread + RIDGE * np.eye(spread.shape[-1])
    parts = (spread[..., :p, :p], spread[..., p:, p:], spread)
    one, other, both = (np.linalg.slogdet(m)[1] for m in parts)
    return np.asarray((one + other - both) / 2)


def _explained_variance(trained: Float, tested: Float, p: int) -> float:
    """Return the share of the others' variance that the first p variables predict.

    The prediction is fitted to the moments `trained` and evaluated on the moments `tested`.
    """
    one, other = slice(0, 1 + p), slice(1 + p, None)
    ridge = PREDICTION_RIDGE * trained[0, 0] * np.eye(1 + p)
    b = np.linalg.solve(trained[one, one] + ridge, trained[one, other])
    residual = tested[other, other] - b.T @ tested[one, other]
    residual = np.trace(residual - tested[other, one] @ b + b.T @ tested[one, one] @ b)
    return float(1 - residual / np.trace(tested[other, other]))


def _unrelated() -> CaptureError:
    return CaptureError(
        "motion and signals have nothing in common",
        code="motion-unrelated",
        where="synchronization",
        action="Move the device faster and in all its ways, or put the LED in view",
    )


def _search(x: _Rows, y: _Rows, within: float | None) -> int:
    """Return the best lag, in grid steps."""
    p = x.values.shape[1]
    if within is not None:
        reach = int(np.ceil(within / GRID_STEP_S / SEARCH_STEPS)) * SEARCH_STEPS
        lags = np.arange(-reach, reach + 1, SEARCH_STEPS)
    else:
        start = x.first - y.first
        half = min(len(x.values), len(y.values)) // 2
        lags = np.arange(start - len(y.values) + half, start + len(x.values) - half, SEARCH_STEPS)
    thin_x, thin_y = _every_second(x), _every_second(y)
    every = slice(0, len(thin_x.values))
    moments = np.array([_moments(thin_x, thin_y, int(k) // 2, every) for k in lags])
    count = moments[:, 0, 0]
    information = np.where(count > 0.4 * count.max(), _information(moments, p), 0.0)
    k = int(information.argmax())
    if information[k] < MIN_INFORMATION:
        raise _unrelated()
    if within is not None and k in (0, len(lags) - 1):
        raise CaptureError(
            f"motion and signals agree best {within:g} s or more from the expected offset",
            code="out-of-range",
            where="synchronization",
            action="Search within a longer time",
        )
    is_peak = (information[1:-1] >= information[:-2]) & (information[1:-1] >= information[2:])
    peaks = np.flatnonzero(is_peak) + 1
    others = peaks[np.abs(peaks - k) > 1]
    if len(others) and information[others].max() > MAX_OTHER_INFORMATION * information[k]:
        other = lags[others[information[others].argmax()]] - lags[k]
        raise CaptureError(
            f"motion and signals agree as well {abs(other) * GRID_STEP_S:.2f} s"
            f" {'later' if other > 0 else 'earlier'}",
            code="offset-ambiguous",
            where="synchronization",
            action="Move the device less regularly, or put the LED in view",
        )
    return int(lags[k])


def _every_second(rows: _Rows) -> _Rows:
    """Return the rows at even grid steps, on a grid of twice the step."""
    odd = rows.first % 2
    return _Rows((rows.first + odd) // 2, rows.values[odd::2], rows.known[odd::2])


class _LagPeak:
    """Common information of x and y near a lag, as a function of lag and drift.

    Points (k, 2) are lags, s, and drifts.
    """

    def __init__(self, x: _Rows, y: _Rows, best: int, fixed_drift: float | None) -> None:
        self._p = x.values.shape[1]
        y_row = np.arange(len(x.values)) + x.first - best - y.first
        common = np.flatnonzero(x.known & (y_row >= 0) & (y_row < len(y.values)))
        start, stop = int(common[0]), int(common[-1]) + 1
        self.span = (stop - start) * GRID_STEP_S
        self.middle = (x.first + (start + stop - 1) / 2) * GRID_STEP_S
        self.count = int(np.clip(self.span / BLOCK_S, 4, 24))
        edges = np.linspace(start, stop, self.count + 1).astype(int)
        lags = np.arange(best - NEIGHBOR_LAGS, best + NEIGHBOR_LAGS + 1)
        self._first_lag, self._lag_count = lags[0], len(lags)
        self._blocks = np.array(
            [[_moments(x, y, int(k), slice(a, b)) for k in lags] for a, b in pairwise(edges)]
        )
        self._block_time = ((edges[:-1] + edges[1:]) / 2 - (start + stop) / 2) * GRID_STEP_S
        self.is_drift_free = fixed_drift is None and self.span >= MIN_DRIFT_SPAN_S
        # Changes of lag and drift that matter about as much.
        self._scale = np.array([2e-3, 2e-3 / (self.span / 2)])

    def moments(self, points: Float, blocks: Int) -> Float:
        """Return the moments (k, m, m) of some blocks at points (k, 2)."""
        place = (points[:, :1] + points[:, 1:] * self._block_time[blocks]) / GRID_STEP_S
        place = np.clip(place - self._first_lag, 1, self._lag_count - 2.001)
        low = place.astype(int)
        u = place - low
        # Cubics through four lags.
        weights = (
            -u * (u - 1) * (u - 2) / 6,
            (u + 1) * (u - 1) * (u - 2) / 2,
            -(u + 1) * u * (u - 2) / 2,
            (u + 1) * u * (u - 1) / 6,
        )
        total = np.zeros((len(points), *self._blocks.shape[2:]))
        for k, w in enumerate(weights):
            total += np.einsum("kb,kbij->kij", w, self._blocks[blocks, low + k - 1])
        return total

    def zoom(self, point: Float, blocks: Int) -> Float:
        """Return the best point (2,) of ever finer grids; peaks may be as sharp as cusps."""
        reach = np.array([0.08, 6e-4 if self.is_drift_free else 0.0])
        for _ in range(6):
            sides = [np.linspace(-r, r, 17 if r else 1) for r in reach]
            points = point + np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
            information = _information(self.moments(points, blocks), self._p)
            point = points[int(information.argmax())]
            reach = reach / 4
        return np.asarray(point)

    def climb(self, point: Float, blocks: Int) -> Float:
        """Return the maximum near a point (2,), by Newton's method on differences."""
        free = self.is_drift_free
        side = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)], float)
        if not free:
            side = side[side[:, 1] == 0]
        for _ in range(3):
            v = _information(self.moments(point + side * self._scale, blocks), self._p)
            x1, x2 = side.T
            powers = [np.ones(len(side)), x1, x1**2, x2, x2**2, x1 * x2][: 6 if free else 3]
            c = np.append(np.linalg.lstsq(np.stack(powers, 1), v, rcond=None)[0], [0.0] * 3)
            bend = np.array([[2 * c[2], c[5]], [c[5], 2 * c[4] if free else -1.0]])
            size, axes = np.linalg.eigh(bend)
            move = axes @ (axes.T @ [c[1], c[3]] / np.maximum(np.abs(size), 1e-9))
            point = point + self._scale * np.clip(move, -3, 3)
        return point

    def explained_variance(self, point: Float) -> float:
        """Return the smaller share of the signals' variance predicted across halves of blocks."""
        every = np.arange(self.count)
        even, odd = (self.moments(point[None], every[k::2])[0] for k in (0, 1))
        return min(_explained_variance(even, odd, self._p), _explained_variance(odd, even, self._p))


def _refine(x: _Rows, y: _Rows, best: int, fixed_drift: float | None = None) -> _RefinedLag:
    """Refine a lag, in grid steps, to a lag and a drift with standard deviations."""
    peak = _LagPeak(x, y, best, fixed_drift)
    every, count = np.arange(peak.count), peak.count
    point = peak.zoom(np.array([best * GRID_STEP_S, fixed_drift or 0.0]), every)
    without = np.array([peak.climb(point, np.delete(every, b)) for b in every])
    without -= peak.climb(point, every) - point
    squares = ((without - without.mean(0)) ** 2).sum(0)
    sigma = JACKKNIFE_FACTOR * np.sqrt((count - 1) / count * squares)
    drift_sigma = float(sigma[1]) if peak.is_drift_free else UNDETERMINED_DRIFT_SIGMA
    if peak.explained_variance(point) < MIN_EXPLAINED_VARIANCE and fixed_drift is None:
        raise _unrelated()
    return _RefinedLag(
        float(point[0]), float(point[1]), float(sigma[0]), drift_sigma, peak.span, peak.middle
    )
