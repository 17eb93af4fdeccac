"""Where on the read-out board's clock the frames lie in which its LED is seen to blink.

The likelihood of a frame's brightness at a time from the nearest toggle: dark before, lit after, in
between what part of the exposure was lit; blurred by what times are unsure by, and mixed with a few
frames that tell nothing (a hand before the LED, a frame given twice). Each toggle bounds the offset
by the frames around it; all of them, which fall on other places between frames, narrow it down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...core.arrays import Float
from .clock_fit import Clocks
from .led_schedule import LedSchedule

_STEP = 5e-3  # s, of the first search
_WINDOW = 60.0  # s, of the first search: drifts do not yet matter
_DRIFT = 600e-6  # from what is known beforehand, at most
_WRONG = 0.02  # part of the frames that tell nothing
_EXPOSURES = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0, 24.0, 32.0]) / 1e3
_JITTERS = np.array([0.3, 0.8, 2.0, 4.0, 8.0]) / 1e3
_WORSE = 7.0  # nats: explanations that are worse are given up
_TRUST = 0.5  # of the likelihood: frames about one toggle are not independent
_FINE = 2.5e-4  # s, in tables of likelihood
_BLURRED = (8e-3, 2e-3, 0.0, 0.0)  # s, jitters of one search after the other, at least
_BINS = np.linspace(-0.3, 1.3, 33)
_LEAST = 8.0  # contrast over noise


@dataclass(frozen=True)
class LedStates:
    """f frames at which it is known how bright the LED was: `time` (f,) s, `level` (f,), 0 dark and
    1 lit, and its standard deviation `noise`; the frames' `period`, s."""

    time: Float
    level: Float
    noise: float
    period: float


@dataclass(frozen=True)
class Shift:
    """What is to be added to device times, s, where they are `device`, for camera times; the part
    `score` of frames that agree, less that of frames that do not."""

    shift: float
    device: float
    score: float


@dataclass(frozen=True)
class Found:
    """camera - middle = shift + (1 + drift) (device - device_middle), s, with standard deviations;
    over `span` s with so many `toggles`, of an LED seen for `exposure` s a frame, times unsure by
    `jitter` s."""

    shift: float
    drift: float
    shift_sigma: float
    drift_sigma: float
    middle: float
    device_middle: float
    span: float
    toggles: int
    exposure: float
    jitter: float


def normalise(time: Float, brightness: Float) -> LedStates | None:
    """Levels by what is dark and lit near by in time: rooms and cameras change. None where nothing
    switches."""
    known = np.isfinite(brightness)
    same = np.zeros(len(time), bool)
    same[1:] = brightness[1:] == brightness[:-1]
    if same.mean() < 0.3:  # otherwise it is an LED without noise
        known &= ~same  # a frame given twice
    t, b = time[known], brightness[known].astype(float)
    if len(t) < 20:
        return None
    period = float(np.median(np.diff(time)))
    count = max(int(np.ptp(t) // 6.0), 1)
    parts = np.array_split(np.arange(len(t)), count)
    ends = np.array([np.quantile(b[p], [0.08, 0.92]) for p in parts])
    centers = np.array([t[p].mean() for p in parts])
    contrast = ends[:, 1] - ends[:, 0]
    usual = float(np.median(contrast))
    noise = float(np.median(np.abs(np.diff(b)))) / 0.954
    if usual <= 0 or usual < _LEAST * noise:
        return None
    seen = contrast > 0.4 * usual
    low, high = (np.interp(t, centers[seen], e[seen]) for e in ends.T)
    level = (b - low) / (high - low)
    good = np.concatenate([np.full(len(p), s) for p, s in zip(parts, seen, strict=True)])
    steady = np.minimum(np.abs(level), np.abs(level - 1))
    wide = float(np.median(steady[good])) / 0.6745
    # What is neither dark nor lit most of the time does not switch.
    if np.mean(steady[good] > 0.3) > 0.4:
        return None
    return LedStates(
        t[good], level[good], float(np.clip(max(wide, noise / usual), 0.02, 0.3)), period
    )


def shift_of(
    lit: LedStates, toggles: LedSchedule, before: Clocks, within: float | None
) -> Shift | None:
    """The shift at which the frames of a minute agree best with the LED's states, within so many s
    of what is known before (None: of all); None where clocks have too little in common."""
    middle = float(np.median(lit.time))
    part = np.abs(lit.time - middle) <= _WINDOW / 2
    t, level = lit.time[part], lit.level[part]
    grid = np.arange(t[0], t[-1], _STEP)
    nearest = np.clip(np.searchsorted(t, grid - lit.period / 2), 0, len(t) - 1)
    near = np.abs(t[nearest] - grid) <= lit.period
    seen = np.where(near, np.clip(2 * level[nearest] - 1, -1, 1), 0.0)
    device = np.arange(toggles.start, toggles.end, _STEP)
    state = toggles.state(device)
    from scipy.signal import correlate  # 27 MB, which recordings without an LED do not need

    product = correlate(state, seen, mode="full")
    common = correlate(np.abs(state), np.abs(seen), mode="full")
    place = np.arange(len(product)) - (len(seen) - 1)
    start = device[0] + place * _STEP  # device time of the first frame
    shift = t[0] - start
    allowed = common > 0.5 * min(np.abs(seen).sum(), np.abs(state).sum())
    if within is not None:
        expected = before.offset + (1 + before.drift) * start
        allowed &= np.abs(t[0] - expected) <= within
    if not allowed.any():
        return None
    score = np.where(allowed, product / np.maximum(common, 1.0), -2.0)
    k = int(score.argmax())
    return Shift(float(shift[k]), float(start[k] + (middle - t[0])), float(score[k]))


def posterior(
    lit: LedStates, toggles: LedSchedule, start: Shift, exposure: float | None, drift: float
) -> Found:
    """Shift and drift and their standard deviations, from a first shift on."""
    known = np.array([0.0, exposure]) if exposure is not None else _EXPOSURES
    known = known[known <= 1.05 * lit.period]
    ways = [(float(e), float(j)) for e in known for j in _JITTERS]
    middle = start.shift + start.device
    half, whole = _WINDOW / 2, max(lit.time[-1] - middle, middle - lit.time[0])
    shift, slope, reach, steep = 0.0, drift, 0.03, _DRIFT
    while True:
        near = np.abs(lit.time - middle) <= half + 1e-6
        part = LedStates(lit.time[near], lit.level[near], lit.noise, lit.period)
        anchor = (middle, start.device)
        for least in _BLURRED:
            box = (shift, reach, slope, steep)
            # A grid still too coarse for sharp likelihoods would take one of their side peaks.
            some = [w for w in ways if w[1] >= least] or ways
            shift, slope, a, d, left = _grid(part, toggles, anchor, box, some, 21)
            ways = left if len(some) == len(ways) else ways
            reach, steep = max(4 * a, 1e-4), max(4 * d, 1e-7)
        if half >= whole:
            break
        half *= 2
        steep = max(steep, 1e-6)
    # About the middle of what was seen the shift and the drift are the least entangled.
    center = float((lit.time[0] + lit.time[-1]) / 2)
    device = start.device + (center - middle - shift) / (1 + slope)
    for _ in range(2):
        box = (0.0, reach, slope, steep)
        moved, slope, a, d, ways = _grid(lit, toggles, (center, device), box, ways, 31)
        device -= moved / (1 + slope)
        reach, steep = max(4 * a, 1e-4), max(4 * d, 1e-7)
    k = np.searchsorted(lit.time, center + (toggles.time - device) * (1 + slope))
    k = k[(k > 0) & (k < len(lit.time))]
    used = int((lit.time[k] - lit.time[k - 1] < 3 * lit.period).sum())
    return Found(
        0.0, slope, a, d, center, device, float(lit.time[-1] - lit.time[0]), used, *ways[0]
    )


def shifts_alike(
    lit: LedStates, toggles: LedSchedule, found: Found, before: Clocks, within: float | None
) -> float | None:
    """By how many s another offset differs that explains the frames as well; None: there is
    none."""
    device = found.device_middle + (lit.time - found.middle - found.shift) / (1 + found.drift)
    apart = float(np.median(np.diff(toggles.time))) if len(toggles.time) > 1 else 0.5
    length = max(np.ptp(device), toggles.end - toggles.start)
    step = 0.02
    moves = np.arange(-length, length, step)
    if within is not None:
        now = float(found.middle - before.offset - (1 + before.drift) * found.device_middle)
        # Moves of the device's time to which the offset's are opposite.
        moves = moves[np.abs(now - moves) <= within]
    moves = moves[np.abs(moves) > apart / 2]
    every = max(len(lit.time) // 3000, 1)
    device, seen = device[::every], np.clip(2 * lit.level - 1, -1, 1)[::every]

    def agreement(move: float) -> tuple[float, float]:
        state = toggles.state(device + move)
        return float(state @ seen), float(np.abs(state) @ np.abs(seen))

    here, count = agreement(0.0)
    wrong = (count - here) / 2
    for move in moves:
        there, many = agreement(float(move))
        if many < 0.5 * count or there < 0.5 * many:
            continue
        fine = max((agreement(move + s) for s in np.arange(-step, step, 2e-3)), key=lambda v: v[0])
        # Frames that disagree, beyond those that do at the best offset.
        if (fine[1] - fine[0]) / 2 <= wrong * fine[1] / count + 3 + 0.005 * count:
            return -float(move)
    return None


def _grid(
    lit: LedStates, toggles: LedSchedule, anchor: tuple[float, float],
    box: tuple[float, float, float, float], ways: list[tuple[float, float]], size: int,
) -> tuple[float, float, float, float, list[tuple[float, float]]]:  # fmt: skip
    """Means of shift and drift and their standard deviations, over all `ways`: exposures and
    jitters; those that explain the frames nearly as well as the best one, which is the first."""
    shift, reach, slope, steep = box
    shifts, slopes = (np.linspace(x - r, x + r, size) for x, r in ((shift, reach), (slope, steep)))
    edge = max(e / 2 + 4 * j for e, j in ways)  # of all: the same frames
    values = [_likelihood(lit, toggles, anchor, shifts, slopes, e, j, edge) for e, j in ways]
    best = max(float(v.max()) for v in values)
    order = sorted(range(len(ways)), key=lambda k: -float(values[k].max()))
    left = [ways[k] for k in order if values[k].max() > best - _WORSE]
    weight = np.sum([np.exp(_TRUST * (v - best)) for v in values], axis=0)
    weight /= weight.sum()
    a, d = float(weight.sum(1) @ shifts), float(weight.sum(0) @ slopes)
    spread = float(np.sqrt(weight.sum(1) @ (shifts - a) ** 2 + (shifts[1] - shifts[0]) ** 2 / 12))
    turn = float(np.sqrt(weight.sum(0) @ (slopes - d) ** 2 + (slopes[1] - slopes[0]) ** 2 / 12))
    # A grid too coarse for sharp likelihoods must not leave them out.
    return a, d, spread, turn, left if spread > 1.5 * (shifts[1] - shifts[0]) else ways


def _likelihood(
    lit: LedStates, toggles: LedSchedule, anchor: tuple[float, float], shifts: Float, slopes: Float,
    exposure: float, jitter: float, edge: float,
) -> Float:  # fmt: skip
    """Its logarithm (a, d) at shifts (a,) and drifts (d,), by frames within `edge` s of toggles."""
    middle, device = anchor
    c, a, d = lit.time - middle, float(shifts.mean()), float(slopes.mean())
    at = device + (c - a) / (1 + d)
    k = np.clip(np.searchsorted(toggles.time, at), 1, max(len(toggles.time) - 1, 1))
    k = np.where(at - toggles.time[k - 1] < toggles.time[k % len(toggles.time)] - at, k - 1, k)
    k = np.clip(k, 0, len(toggles.time) - 1)
    edge += 2 * _FINE
    apart = float(np.ptp(shifts)) / 2 + float(np.ptp(slopes)) / 2 * float(np.abs(c).max()) + edge
    near = np.abs(at - toggles.time[k]) < apart
    near &= (at >= toggles.start) & (at <= toggles.end)
    c, k, level = c[near], k[near], lit.level[near]
    z = np.where(toggles.on[k], level, 1 - level)
    table = _table(exposure, jitter, lit.noise, edge)
    row = np.clip(np.round((z - _BINS[0]) / (_BINS[1] - _BINS[0])), 0, len(_BINS) - 1).astype(int)
    then = toggles.time[k] - device
    out = np.empty((len(shifts), len(slopes)))
    last = table.shape[1] - 1
    for j, slope in enumerate(slopes):
        from_toggle = (c - shifts[:, None]) / (1 + slope) - then
        place = np.clip((from_toggle + edge) / _FINE, 0, last)
        below = np.minimum(place.astype(int), last - 1)
        part = place - below
        out[:, j] = ((1 - part) * table[row, below] + part * table[row, below + 1]).sum(1)
    return out


@lru_cache(maxsize=256)
def _table(exposure: float, jitter: float, noise: float, edge: float) -> Float:
    """Logarithms of likelihoods (levels, times from a toggle)."""
    u = np.arange(-edge, edge + _FINE, _FINE)
    blur = np.linspace(-3, 3, 25)
    weight = np.exp(-(blur**2) / 2)
    weight /= weight.sum()
    off = u[:, None] + jitter * blur
    part = np.clip(off / max(exposure, 1e-6) + 0.5, 0, 1)
    gap = (_BINS[:, None, None] - part) / noise
    likely = (np.exp(-(gap**2) / 2) @ weight) / (noise * np.sqrt(2 * np.pi))
    return np.asarray(np.log((1 - _WRONG) * likely + _WRONG / 1.6))
