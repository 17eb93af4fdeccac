"""At which lag motion and signals have most in common.

Both are smoothed onto one grid of time and freed of what changes slowly, as a cord's creep. At a
lag, what they share is the mutual information of Gaussian variables (from all canonical
correlations). Its moments are kept by block: a drift moves blocks against each other, and leaving
one block out at a time (the jackknife) tells how sure lag and drift are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from .clock_fit import Clocks

_STEP = 0.02  # s of the grid
_COARSE = 4  # steps, of the search
_BLUR = 0.04  # s; more where frames or samples are fewer
_SLOW = 4.0  # s: slower changes are left out
_APART = (0.16, 0.6)  # s: what slow motion is blurred by at least, and fast motion is freed of
_MOST = 6  # main components of motion and of signals
_SQUARES = 2  # of them enter squared as well: signals bend
_RIDGE = 1e-3
_RIDGE_FORETELLS = 0.1  # of a variance of one: what hardly moves in one half foretells nothing
_AROUND = 15  # steps about the best lag
_DRIFT_FROM = 40.0  # s; of less no drift is told
_NO_DRIFT = 1e-4  # standard deviation of a drift that is not told
_PART = 5.0  # s of a block
_SHARED = 0.1  # nats of information at least
_FORETOLD = 0.1  # of the signals' variance that motion foretells in the other half of the blocks
_NOTHING = (
    "synchronise: motion and signals have nothing in common; move the device about, faster and in"
    " all its ways, or put the LED in view"
)
_UNLIKE = 1.4  # by which blocks that hang together make the jackknife's deviations too small
_OTHER = 0.75  # of the best one's that another lag may share


@dataclass(frozen=True)
class Lag:
    """camera - middle = shift + (1 + drift) (device - device_middle), s, with standard deviations,
    from `span` s; by how much slow and fast motion `disagree` about the shift, s, 0 where they
    agree."""

    shift: float
    drift: float
    shift_sigma: float
    drift_sigma: float
    middle: float
    device_middle: float
    span: float
    disagree: float


@dataclass(frozen=True)
class _Rows:
    """Values (g, k) on a grid that begins at step `first`, and which of its rows are known."""

    first: int
    values: Float
    known: Bool


def find_lag(
    time: Float, motion: Float, device: Float, signals: Float, before: Clocks, within: float | None
) -> Lag:
    """Of motion (t, d) and signals (n, c), NaN where not known, at lags within so many s of what is
    known before (None: of all). Raises CaptureError where nothing moves, or no lag stands out."""
    expected = before.to_host(device)
    blur = max(_BLUR, *(1.1 * float(np.median(np.diff(t))) for t in (time, expected)))
    x, y = _smooth(time, motion, blur), _smooth(expected, signals, blur)
    whole = _main(_fast(x, _SLOW), "motion"), _main(_fast(y, _SLOW), "signals")
    bent = np.hstack([whole[0].values, whole[0].values[:, :_SQUARES] ** 2])
    whole = _Rows(whole[0].first, bent, whole[0].known), whole[1]
    best = _search(*whole, within)
    lag, d, a, s, span, middle = _refine(*whole, best)
    slow = [_main(_fast(_slow(r, _APART[0]), _SLOW), "motion") for r in (x, y)]
    fast = [_main(_fast(r, _APART[1]), "motion") for r in (x, y)]
    ends = [_refine(r0, r1, best, fixed=d) for r0, r1 in (slow, fast)]
    apart = abs(ends[0][0] - ends[1][0])
    sure = apart > 2 * float(np.hypot(ends[0][2], ends[1][2]))
    at = (middle - lag - before.offset) / (1 + before.drift)
    drift = (1 + before.drift) / (1 - d) - 1
    return Lag(0.0, drift, a, s, middle, float(at), span, apart if sure else 0.0)


def _smooth(time: Float, values: Float, blur: float) -> _Rows:
    """Local lines under a Gaussian window, on the grid; columns with many gaps are left out."""
    there = np.isfinite(values)
    values = values[:, there.mean(0) > 0.6]
    good = np.isfinite(values).all(1)
    if values.shape[1] == 0 or good.sum() < 20:
        raise CaptureError(
            "synchronise: motion or signals are missing for most of the time; record again with"
            " the markers in view and the cords connected",
            code="motion-mostly-missing",
        )
    t, v = time[good], values[good] - values[good].mean(0)
    first, size = int(np.floor(t[0] / _STEP)), int(np.ceil(np.ptp(t) / _STEP)) + 2
    reach = int(np.ceil(3.5 * blur / _STEP))
    near = np.round(t / _STEP).astype(int) - first
    sums = np.zeros((3, size))
    tops = np.zeros((2, size, v.shape[1]))
    for k in range(-reach, reach + 1):
        at = near + k
        inside = (at >= 0) & (at < size)
        at = at[inside]
        u = (t[inside] - (at + first) * _STEP) / blur
        w = np.exp(-(u**2) / 2)
        for power in range(3):
            sums[power] += np.bincount(at, w * u**power, size)
        for power in range(2):
            np.add.at(tops[power], at, (w * u**power)[:, None] * v[inside])
    det = sums[0] * sums[2] - sums[1] ** 2
    level = (sums[2][:, None] * tops[0] - sums[1][:, None] * tops[1]) / np.maximum(det, 1e-9)[
        :, None
    ]
    known = (sums[0] > 0.4 * np.median(sums[0])) & (det > 0.1 * np.median(det))
    return _Rows(first, np.where(known[:, None], level, 0.0), known)


def _slow(rows: _Rows, blur: float) -> _Rows:
    """Blurred by so many s."""
    sigma = blur / _STEP
    weight = gaussian_filter1d(rows.known.astype(float), sigma, mode="constant")
    sums = gaussian_filter1d(rows.values * rows.known[:, None], sigma, axis=0, mode="constant")
    known = rows.known & (weight > 0.3)
    return _Rows(rows.first, sums / np.maximum(weight, 1e-3)[:, None], known)


def _fast(rows: _Rows, blur: float) -> _Rows:
    """Without what a blur of so many s leaves."""
    slow = _slow(rows, blur)
    return _Rows(rows.first, rows.values - slow.values, slow.known)


def _main(rows: _Rows, name: str) -> _Rows:
    """Main components, each of variance one."""
    part = rows.values[rows.known]
    if len(part) < 50:
        raise CaptureError(
            f"synchronise: {name} is known for too short a time; record longer",
            code="recording-too-short",
            input=name,
        )
    scale = part.std(0)
    if name == "signals":  # channels need not be alike
        part, values = part[:, scale > 0] / scale[scale > 0], rows.values[:, scale > 0]
        values = values / scale[scale > 0]
    else:
        values = rows.values
    if not (scale > 1e-12).any():
        what = "no marker moves" if name == "motion" else "no signal changes"
        raise CaptureError(
            f"synchronise: {what}; move the device about while recording",
            code="motion-constant" if name == "motion" else "signals-constant",
        )
    center = part.mean(0)
    _, size, axes = np.linalg.svd(part - center, full_matrices=False)
    most = int(np.searchsorted(np.cumsum(size**2) / (size**2).sum(), 0.999)) + 1
    most = min(most, _MOST, len(size))
    out = (values - center) @ axes[:most].T / (size[:most] / np.sqrt(len(part)))
    return _Rows(rows.first, out * rows.known[:, None], rows.known)


def _moments(x: _Rows, y: _Rows, lag: int, of: slice) -> Float:
    """Sums (1 + p + q, 1 + p + q) of products over rows `of` x, of ones, x and y a lag of so many
    steps before."""
    lo = of.start + x.first - lag - y.first
    hi = lo + of.stop - of.start
    a, b = max(lo, 0), min(hi, len(y.values))
    if b <= a:
        return np.zeros((1 + x.values.shape[1] + y.values.shape[1],) * 2)
    rows = slice(of.start + a - lo, of.stop + b - hi)
    both = (x.known[rows] & y.known[a:b])[:, None]
    z = np.hstack([np.ones((b - a, 1)), x.values[rows], y.values[a:b]]) * both
    return np.asarray(z.T @ z)


def _shared(moments: Float, p: int) -> Float:
    """Nats (...) that the first p variables tell of the others, of moments (..., m, m)."""
    n = np.maximum(moments[..., :1, :1], 1.0)
    mean = moments[..., 0, 1:] / n[..., 0]
    spread = moments[..., 1:, 1:] / n - mean[..., :, None] * mean[..., None, :]
    spread = spread + _RIDGE * np.eye(spread.shape[-1])
    parts = (spread[..., :p, :p], spread[..., p:, p:], spread)
    one, other, all_ = (np.linalg.slogdet(m)[1] for m in parts)
    return np.asarray((one + other - all_) / 2)


def _foretells(learnt: Float, tested: Float, p: int) -> float:
    """What part of the variance of the others the first p variables foretell, in other moments
    than they were learnt from."""
    one, other = slice(0, 1 + p), slice(1 + p, None)
    ridge = _RIDGE_FORETELLS * learnt[0, 0] * np.eye(1 + p)
    b = np.linalg.solve(learnt[one, one] + ridge, learnt[one, other])
    left = tested[other, other] - b.T @ tested[one, other]
    left = np.trace(left - tested[other, one] @ b + b.T @ tested[one, one] @ b)
    return float(1 - left / np.trace(tested[other, other]))


def _search(x: _Rows, y: _Rows, within: float | None) -> int:
    """The best lag, in steps."""
    p = x.values.shape[1]
    if within is not None:
        reach = int(np.ceil(within / _STEP / _COARSE)) * _COARSE
        lags = np.arange(-reach, reach + 1, _COARSE)
    else:
        start = x.first - y.first
        half = min(len(x.values), len(y.values)) // 2
        lags = np.arange(start - len(y.values) + half, start + len(x.values) - half, _COARSE)
    thin = [
        _Rows(r.first // 2, r.values[r.first % 2 :: 2], r.known[r.first % 2 :: 2]) for r in (x, y)
    ]
    thin = [_Rows((r.first + r.first % 2) // 2, t.values, t.known)
            for r, t in zip((x, y), thin, strict=True)]  # fmt: skip
    every = slice(0, len(thin[0].values))
    moments = np.array([_moments(thin[0], thin[1], int(k) // 2, every) for k in lags])
    count = moments[:, 0, 0]
    shared = np.where(count > 0.4 * count.max(), _shared(moments, p), 0.0)
    k = int(shared.argmax())
    if shared[k] < _SHARED:
        raise CaptureError(_NOTHING, code="motion-unrelated")
    if within is not None and k in (0, len(lags) - 1):
        raise CaptureError(
            f"synchronise: motion and signals go together best {within:g} s from the offset that"
            " was expected, or farther; look for it within more",
            code="offset-out-of-range",
        )
    peaks = np.flatnonzero((shared[1:-1] >= shared[:-2]) & (shared[1:-1] >= shared[2:])) + 1
    others = peaks[np.abs(peaks - k) > 1]
    if len(others) and shared[others].max() > _OTHER * shared[k]:
        other = lags[others[shared[others].argmax()]] - lags[k]
        raise CaptureError(
            f"synchronise: motion and signals go together as well {abs(other) * _STEP:.2f} s"
            f" {'later' if other > 0 else 'earlier'}; move the device less evenly, or put the LED"
            " in view",
            code="offset-ambiguous",
        )
    return int(lags[k])


def _refine(
    x: _Rows, y: _Rows, best: int, fixed: float | None = None
) -> tuple[float, float, float, float, float, float]:
    """Lag s, drift, their standard deviations, and span and middle of the time, s, in common."""
    p = x.values.shape[1]
    here = np.arange(len(x.values)) + x.first - best - y.first
    common = np.flatnonzero(x.known & (here >= 0) & (here < len(y.values)))
    start, stop = int(common[0]), int(common[-1]) + 1
    span, middle = (stop - start) * _STEP, (x.first + (start + stop - 1) / 2) * _STEP
    count = int(np.clip(span / _PART, 4, 24))
    edges = np.linspace(start, stop, count + 1).astype(int)
    lags = np.arange(best - _AROUND, best + _AROUND + 1)
    blocks = np.array(
        [[_moments(x, y, int(k), slice(a, b)) for k in lags] for a, b in pairwise(edges)]
    )
    place = ((edges[:-1] + edges[1:]) / 2 - (start + stop) / 2) * _STEP
    free = fixed is None and span >= _DRIFT_FROM
    scale = np.array([2e-3, 2e-3 / (span / 2)])  # lag and drift that matter about as much

    def sums(points: Float, keep: Int) -> Float:
        """Moments at points (k, 2) of lag and drift, of some blocks."""
        at = (points[:, :1] + points[:, 1:] * place[keep]) / _STEP - lags[0]
        at = np.clip(at, 1, len(lags) - 2.001)
        low = at.astype(int)
        u = at - low
        # Cubics through four lags.
        weights = (
            -u * (u - 1) * (u - 2) / 6, (u + 1) * (u - 1) * (u - 2) / 2,
            -(u + 1) * u * (u - 2) / 2, (u + 1) * u * (u - 1) / 6,
        )  # fmt: skip
        total = np.zeros((len(points), *blocks.shape[2:]))
        for k, w in enumerate(weights):
            total += np.einsum("kb,kbij->kij", w, blocks[keep, low + k - 1])
        return total

    def shared(points: Float, keep: Int) -> Float:
        return _shared(sums(points, keep), p)

    def zoom(point: Float) -> Float:
        """The best of a grid, ever finer: peaks may be as sharp as cusps."""
        reach = np.array([0.08, 6e-4 if free else 0.0])
        for _ in range(6):
            sides = [np.linspace(-r, r, 17 if r else 1) for r in reach]
            points = point + np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
            point = points[int(shared(points, every).argmax())]
            reach = reach / 4
        return np.asarray(point)

    def climb(point: Float, keep: Int) -> Float:
        """Newton's method on the differences around a point near the peak."""
        side = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)], float)
        if not free:
            side = side[side[:, 1] == 0]
        for _ in range(3):
            v = shared(point + side * scale, keep)
            x1, x2 = side.T
            powers = [np.ones(len(side)), x1, x1**2, x2, x2**2, x1 * x2][: 6 if free else 3]
            c = np.append(np.linalg.lstsq(np.stack(powers, 1), v, rcond=None)[0], [0.0] * 3)
            bend = np.array([[2 * c[2], c[5]], [c[5], 2 * c[4] if free else -1.0]])
            size, axes = np.linalg.eigh(bend)
            move = axes @ (axes.T @ [c[1], c[3]] / np.maximum(np.abs(size), 1e-9))
            point = point + scale * np.clip(move, -3, 3)
        return point

    every = np.arange(count)
    first = zoom(np.array([best * _STEP, fixed or 0.0]))
    without = np.array([climb(first, np.delete(every, b)) for b in every])
    without -= climb(first, every) - first
    sigma = _UNLIKE * np.sqrt((count - 1) / count * ((without - without.mean(0)) ** 2).sum(0))
    turn = float(sigma[1]) if free else _NO_DRIFT
    halves = [sums(first[None], every[k::2])[0] for k in (0, 1)]
    tells = (_foretells(halves[0], halves[1], p), _foretells(halves[1], halves[0], p))
    if min(tells) < _FORETOLD and fixed is None:
        raise CaptureError(_NOTHING, code="motion-unrelated")
    return float(first[0]), float(first[1]), float(sigma[0]), turn, span, middle
