"""Align frames in which the LED blinks with the read-out board's clock.

The likelihood of a frame's brightness depends on its time from the nearest toggle: dark before, lit
after, and in between the share of the exposure that was lit. It is blurred by the uncertainty of
times, and mixed with a few frames that carry no information (a hand before the LED, a repeated
frame). Each toggle bounds the offset by the frames around it. All toggles together narrow it down,
because they fall on different places between frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...core.arrays import Float
from .clock_fit import ClockMatch, Clocks
from .led_schedule import LedSchedule

SEARCH_STEP_S = 5e-3
SEARCH_WINDOW_S = 60.0  # in which drifts do not matter yet
MAX_DRIFT_CHANGE = 600e-6  # from the drift that is known beforehand
UNINFORMATIVE_SHARE = 0.02  # of the frames
EXPOSURES_S = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0, 24.0, 32.0]) / 1e3
JITTERS_S = np.array([0.3, 0.8, 2.0, 4.0, 8.0]) / 1e3
MAX_LOG_LIKELIHOOD_LOSS = 7.0  # nats: worse hypotheses are dropped
TRUST = 0.5  # exponent of the likelihood: frames around one toggle are not independent
TABLE_STEP_S = 2.5e-4
MIN_JITTERS_S = (8e-3, 2e-3, 0.0, 0.0)  # of successive searches
LEVEL_BINS = np.linspace(-0.3, 1.3, 33)
MIN_CONTRAST_SIGMAS = 8.0
BLOCK_S = 6.0  # in which dark and lit levels are measured
MATCH_STEP_S = 0.02  # of the search for other offsets


@dataclass(frozen=True)
class LedStates:
    """f frames in which the LED's brightness is known.

    Attributes:
        time: Times of the frames (f,), s.
        level: Brightness (f,), 0 dark and 1 lit.
        noise: Standard deviation of the levels.
        period: Period of the frames, s.
    """

    time: Float
    level: Float
    noise: float
    period: float


@dataclass(frozen=True)
class Shift:
    """A first estimate of the offset.

    Attributes:
        shift: Added to device times to get camera times, s.
        device: Device time at which it holds, s.
        score: Share of the frames that agree, less the share of those that do not.
    """

    shift: float
    device: float
    score: float


@dataclass(frozen=True)
class LedMatch(ClockMatch):
    """Relation of the clocks by the LED.

    Attributes:
        toggles: Number of toggles between frames.
        jitter: Most likely standard deviation of the frames' times, s.
    """

    toggles: int
    jitter: float


def normalize_brightness(time: Float, brightness: Float) -> LedStates | None:
    """Scale brightness to levels from 0 (dark) to 1 (lit).

    Dark and lit are measured nearby in time, because rooms and cameras change.

    Args:
        time: Times of the frames (t,), s.
        brightness: Brightness of the LED (t,), NaN where not known.

    Returns:
        The levels; None if nothing switches.
    """
    known = np.isfinite(brightness)
    is_same = np.zeros(len(time), bool)
    is_same[1:] = brightness[1:] == brightness[:-1]
    if is_same.mean() < 0.3:  # otherwise the LED has no noise
        known &= ~is_same  # a repeated frame
    t, b = time[known], brightness[known].astype(float)
    if len(t) < 20:
        return None
    period = float(np.median(np.diff(time)))
    count = max(int(np.ptp(t) // BLOCK_S), 1)
    blocks = np.array_split(np.arange(len(t)), count)
    ends = np.array([np.quantile(b[p], [0.08, 0.92]) for p in blocks])
    centers = np.array([t[p].mean() for p in blocks])
    contrast = ends[:, 1] - ends[:, 0]
    usual_contrast = float(np.median(contrast))
    noise = float(np.median(np.abs(np.diff(b)))) / 0.954
    if usual_contrast <= 0 or usual_contrast < MIN_CONTRAST_SIGMAS * noise:
        return None
    has_contrast = contrast > 0.4 * usual_contrast
    low, high = (np.interp(t, centers[has_contrast], e[has_contrast]) for e in ends.T)
    level = (b - low) / (high - low)
    good = np.concatenate([np.full(len(p), h) for p, h in zip(blocks, has_contrast, strict=True)])
    deviation = np.minimum(np.abs(level), np.abs(level - 1))
    spread = float(np.median(deviation[good])) / 0.6745
    # Brightness that is mostly neither dark nor lit does not switch.
    if np.mean(deviation[good] > 0.3) > 0.4:
        return None
    return LedStates(
        t[good],
        level[good],
        float(np.clip(max(spread, noise / usual_contrast), 0.02, 0.3)),
        period,
    )


def find_shift(
    states: LedStates, schedule: LedSchedule, expected: Clocks, within: float | None
) -> Shift | None:
    """Find the shift at which the frames of one minute agree best with the LED's schedule.

    Args:
        states: Levels of the LED in frames.
        schedule: Toggles of the LED on the device's clock.
        expected: Relation that is known beforehand.
        within: Largest difference from the expected offset, s; None for any.

    Returns:
        The shift; None if the clocks have too little in common.
    """
    middle = float(np.median(states.time))
    in_window = np.abs(states.time - middle) <= SEARCH_WINDOW_S / 2
    t, level = states.time[in_window], states.level[in_window]
    grid = np.arange(t[0], t[-1], SEARCH_STEP_S)
    nearest = np.clip(np.searchsorted(t, grid - states.period / 2), 0, len(t) - 1)
    is_near = np.abs(t[nearest] - grid) <= states.period
    camera_state = np.where(is_near, np.clip(2 * level[nearest] - 1, -1, 1), 0.0)
    device = np.arange(schedule.start, schedule.end, SEARCH_STEP_S)
    state = schedule.state(device)
    from scipy.signal import correlate  # 27 MB, which recordings without an LED do not need

    product = correlate(state, camera_state, mode="full")
    common = correlate(np.abs(state), np.abs(camera_state), mode="full")
    place = np.arange(len(product)) - (len(camera_state) - 1)
    start = device[0] + place * SEARCH_STEP_S  # device time of the first frame
    shift = t[0] - start
    allowed = common > 0.5 * min(np.abs(camera_state).sum(), np.abs(state).sum())
    if within is not None:
        expected_start = expected.offset + (1 + expected.drift) * start
        allowed &= np.abs(t[0] - expected_start) <= within
    if not allowed.any():
        return None
    score = np.where(allowed, product / np.maximum(common, 1.0), -2.0)
    k = int(score.argmax())
    return Shift(float(shift[k]), float(start[k] + (middle - t[0])), float(score[k]))


def refine_shift(states: LedStates, schedule: LedSchedule, start: Shift, drift: float) -> LedMatch:
    """Find shift and drift and their standard deviations from a first shift.

    The posterior is evaluated on grids over ever longer spans of time.

    Args:
        states: Levels of the LED in frames.
        schedule: Toggles of the LED on the device's clock.
        start: First estimate of the shift.
        drift: First estimate of the drift.
    """
    exposures = EXPOSURES_S[1.05 * states.period >= EXPOSURES_S]
    hypotheses = [(float(e), float(j)) for e in exposures for j in JITTERS_S]
    middle = start.shift + start.device
    half = SEARCH_WINDOW_S / 2
    longest_half = max(states.time[-1] - middle, middle - states.time[0])
    shift, slope, shift_reach, slope_reach = 0.0, drift, 0.03, MAX_DRIFT_CHANGE
    while True:
        in_window = np.abs(states.time - middle) <= half + 1e-6
        part = LedStates(
            states.time[in_window], states.level[in_window], states.noise, states.period
        )
        anchor = (middle, start.device)
        for min_jitter in MIN_JITTERS_S:
            box = (shift, shift_reach, slope, slope_reach)
            # A grid that is too coarse for sharp likelihoods would take one of their side peaks.
            blurred = [h for h in hypotheses if h[1] >= min_jitter] or hypotheses
            shift, slope, a, d, likely = _grid_posterior(part, schedule, anchor, box, blurred, 21)
            hypotheses = likely if len(blurred) == len(hypotheses) else hypotheses
            shift_reach, slope_reach = max(4 * a, 1e-4), max(4 * d, 1e-7)
        if half >= longest_half:
            break
        half *= 2
        slope_reach = max(slope_reach, 1e-6)
    # Around the middle of the frames, shift and drift are least correlated.
    center = float((states.time[0] + states.time[-1]) / 2)
    device = start.device + (center - middle - shift) / (1 + slope)
    for _ in range(2):
        box = (0.0, shift_reach, slope, slope_reach)
        move, slope, a, d, hypotheses = _grid_posterior(
            states, schedule, (center, device), box, hypotheses, 31
        )
        device -= move / (1 + slope)
        shift_reach, slope_reach = max(4 * a, 1e-4), max(4 * d, 1e-7)
    k = np.searchsorted(states.time, center + (schedule.time - device) * (1 + slope))
    k = k[(k > 0) & (k < len(states.time))]
    toggles = int((states.time[k] - states.time[k - 1] < 3 * states.period).sum())
    span = float(states.time[-1] - states.time[0])
    return LedMatch(slope, a, d, center, device, span, toggles, jitter=hypotheses[0][1])


def find_other_shift(
    states: LedStates,
    schedule: LedSchedule,
    match: LedMatch,
    expected: Clocks,
    within: float | None,
) -> float | None:
    """Find another offset that explains the frames as well as a match does.

    Args:
        states: Levels of the LED in frames.
        schedule: Toggles of the LED on the device's clock.
        match: The best match.
        expected: Relation that is known beforehand.
        within: Largest difference from the expected offset, s; None for any.

    Returns:
        Difference of the other offset from the match's, s; None if there is no other.
    """
    device = match.device_middle + (states.time - match.middle) / (1 + match.drift)
    interval = float(np.median(np.diff(schedule.time))) if len(schedule.time) > 1 else 0.5
    length = max(np.ptp(device), schedule.end - schedule.start)
    moves = np.arange(-length, length, MATCH_STEP_S)
    if within is not None:
        now = float(match.middle - expected.offset - (1 + expected.drift) * match.device_middle)
        # Moves of the device's time are opposite to those of the offset.
        moves = moves[np.abs(now - moves) <= within]
    moves = moves[np.abs(moves) > interval / 2]
    stride = max(len(states.time) // 3000, 1)
    device, state = device[::stride], np.clip(2 * states.level - 1, -1, 1)[::stride]

    def agreement(move: float) -> tuple[float, float]:
        """Agreement of the states at a move of the device's time, and its largest value."""
        scheduled = schedule.state(device + move)
        return float(scheduled @ state), float(np.abs(scheduled) @ np.abs(state))

    best, count = agreement(0.0)
    disagreement = (count - best) / 2
    for move in moves:
        value, most = agreement(float(move))
        if most < 0.5 * count or value < 0.5 * most:
            continue
        fine_moves = np.arange(-MATCH_STEP_S, MATCH_STEP_S, 2e-3)
        fine = max((agreement(move + s) for s in fine_moves), key=lambda v: v[0])
        # Allow a few frames more to disagree than at the best offset.
        limit = disagreement * fine[1] / count + 3 + 0.005 * count
        if (fine[1] - fine[0]) / 2 <= limit:
            return -float(move)
    return None


def _grid_posterior(
    states: LedStates,
    schedule: LedSchedule,
    anchor: tuple[float, float],
    box: tuple[float, float, float, float],
    hypotheses: list[tuple[float, float]],
    size: int,
) -> tuple[float, float, float, float, list[tuple[float, float]]]:
    """Evaluate the posterior of shift and drift on a grid, over all hypotheses.

    Args:
        states: Levels of the LED in frames.
        schedule: Toggles of the LED.
        anchor: Camera and device time, s, at which the shift is measured.
        box: Center and half width of the shifts, s, and of the drifts.
        hypotheses: Exposures and jitters, s.
        size: Grid points along each axis.

    Returns:
        Means of shift and drift, their standard deviations, and the hypotheses that explain the
        frames nearly as well as the best, which comes first.
    """
    shift, shift_reach, slope, slope_reach = box
    shifts, slopes = (
        np.linspace(x - r, x + r, size) for x, r in ((shift, shift_reach), (slope, slope_reach))
    )
    edge = max(e / 2 + 4 * j for e, j in hypotheses)  # one for all, so that all see the same frames
    values = [
        _log_likelihood(states, schedule, anchor, (shifts, slopes), (e, j), edge)
        for e, j in hypotheses
    ]
    best = max(float(v.max()) for v in values)
    order = sorted(range(len(hypotheses)), key=lambda k: -float(values[k].max()))
    likely = [hypotheses[k] for k in order if values[k].max() > best - MAX_LOG_LIKELIHOOD_LOSS]
    weight = np.sum([np.exp(TRUST * (v - best)) for v in values], axis=0)
    weight /= weight.sum()
    a, d = float(weight.sum(1) @ shifts), float(weight.sum(0) @ slopes)
    a_sigma = float(np.sqrt(weight.sum(1) @ (shifts - a) ** 2 + (shifts[1] - shifts[0]) ** 2 / 12))
    d_sigma = float(np.sqrt(weight.sum(0) @ (slopes - d) ** 2 + (slopes[1] - slopes[0]) ** 2 / 12))
    # A grid that is too coarse for sharp likelihoods must not drop them.
    return a, d, a_sigma, d_sigma, likely if a_sigma > 1.5 * (shifts[1] - shifts[0]) else hypotheses


def _log_likelihood(
    states: LedStates,
    schedule: LedSchedule,
    anchor: tuple[float, float],
    grid: tuple[Float, Float],
    hypothesis: tuple[float, float],
    edge: float,
) -> Float:
    """Return log-likelihoods (a, d) at shifts (a,) and drifts (d,), by frames near toggles.

    `edge`, s, is the largest distance of a frame from its toggle.
    """
    shifts, slopes = grid
    exposure, jitter = hypothesis
    middle, device = anchor
    c, a, d = states.time - middle, float(shifts.mean()), float(slopes.mean())
    device_time = device + (c - a) / (1 + d)
    k = np.clip(np.searchsorted(schedule.time, device_time), 1, max(len(schedule.time) - 1, 1))
    following = schedule.time[k % len(schedule.time)]
    k = np.where(device_time - schedule.time[k - 1] < following - device_time, k - 1, k)
    k = np.clip(k, 0, len(schedule.time) - 1)
    edge += 2 * TABLE_STEP_S
    reach = float(np.ptp(shifts)) / 2 + float(np.ptp(slopes)) / 2 * float(np.abs(c).max()) + edge
    is_near = np.abs(device_time - schedule.time[k]) < reach
    is_near &= (device_time >= schedule.start) & (device_time <= schedule.end)
    c, k, level = c[is_near], k[is_near], states.level[is_near]
    z = np.where(schedule.on[k], level, 1 - level)
    table = _log_likelihood_table(exposure, jitter, states.noise, edge)
    row = np.clip(
        np.round((z - LEVEL_BINS[0]) / (LEVEL_BINS[1] - LEVEL_BINS[0])), 0, len(LEVEL_BINS) - 1
    ).astype(int)
    toggle = schedule.time[k] - device
    out = np.empty((len(shifts), len(slopes)))
    last = table.shape[1] - 1
    for j, slope in enumerate(slopes):
        from_toggle = (c - shifts[:, None]) / (1 + slope) - toggle
        place = np.clip((from_toggle + edge) / TABLE_STEP_S, 0, last)
        below = np.minimum(place.astype(int), last - 1)
        part = place - below
        out[:, j] = ((1 - part) * table[row, below] + part * table[row, below + 1]).sum(1)
    return out


@lru_cache(maxsize=256)
def _log_likelihood_table(exposure: float, jitter: float, noise: float, edge: float) -> Float:
    """Return log-likelihoods (levels, times from a toggle)."""
    u = np.arange(-edge, edge + TABLE_STEP_S, TABLE_STEP_S)
    blur = np.linspace(-3, 3, 25)
    weight = np.exp(-(blur**2) / 2)
    weight /= weight.sum()
    time = u[:, None] + jitter * blur
    lit_share = np.clip(time / max(exposure, 1e-6) + 0.5, 0, 1)
    gap = (LEVEL_BINS[:, None, None] - lit_share) / noise
    likelihood = (np.exp(-(gap**2) / 2) @ weight) / (noise * np.sqrt(2 * np.pi))
    return np.asarray(np.log((1 - UNINFORMATIVE_SHARE) * likelihood + UNINFORMATIVE_SHARE / 1.6))
