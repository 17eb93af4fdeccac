"""Measure how cords respond in a session, from signals and targets alone.

A polynomial of the targets describes the signals without memory. What remains is compared between
stretching and releasing, fast and slow movement, and over time while the targets hold still. All
numbers are shares of the span of the signal, so that a session and a twin can be compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ..data.dataset import Dataset, Recording

MAX_COMPONENTS = 4  # principal components of the targets
MIN_COMPONENT_SHARE = 0.01  # of the variance of the targets
SPAN_PERCENTILES = (1, 99)
SPEED_WINDOW_S = 0.3
MOVING_PER_S = 0.05  # of the span; slower signals do not count as moving
STILL_PER_S = 0.03
MIN_STILL_S = 1.5
STEP_DELAY_S = 0.2  # after a stop, from which the signal is compared
MAX_STEP_S = 5.0
BINS, MIN_BIN_FRAMES = 8, 10
MIN_SECONDS = 20.0  # shorter runs are not measured


@dataclass(frozen=True)
class CordCharacter:
    """How cords respond, by the median over channels; NaN where a session does not show it.

    Attributes:
        hysteresis: Difference between stretching and releasing at the same targets, share of the
            span (RMS over the range).
        rate: Difference between faster and slower movement there, share of the span.
        after_step: Change of the signal while the targets hold still after a movement, share of
            the span (RMS over the stops).
        drift: Change of the signal at the same targets, share of the span per minute.
        noise: Standard deviation between successive samples, share of the span.
    """

    hysteresis: float
    rate: float
    after_step: float
    drift: float
    noise: float


@dataclass(frozen=True)
class TwinLikeness:
    """A session next to twins whose cords move like it.

    Attributes:
        session: How the session's cords respond.
        twins: The same of twins: for each family of cords, the lowest and the highest of several
            built units. Empty without a device.
    """

    session: CordCharacter
    twins: Mapping[str, tuple[CordCharacter, CordCharacter]]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The numbers in words, one sentence each."""
        sentences = []
        for name, (label, unit) in _LABELS.items():
            value = getattr(self.session, name)
            if not np.isfinite(value):
                continue
            ranges = [
                f"{family} {_percent(getattr(low, name))}-{_percent(getattr(high, name))}"
                for family, (low, high) in self.twins.items()
                if np.isfinite(getattr(low, name))
            ]
            twins = f"; twins: {', '.join(ranges)} {unit}" if ranges else ""
            sentences.append(f"{label} {_percent(value)} {unit}{twins}")
        return tuple(sentences)

    def to_json(self) -> dict[str, object]:
        """Return the numbers in plain values."""
        return asdict(self)


_LABELS = {
    "hysteresis": ("hysteresis", "% of the span"),
    "rate": ("rate dependence", "% of the span"),
    "after_step": ("change after a stop", "% of the span"),
    "drift": ("drift", "% of the span per minute"),
    "noise": ("noise", "% of the span"),
}


def _percent(share: float) -> str:
    return f"{100 * share:.2g}"


def target_terms(dataset: Dataset) -> Float:
    """Return the terms (t, k) of a polynomial of the targets, at the frames of all runs."""
    targets = np.concatenate([_fill(r) for r in dataset.recordings])
    middle = targets.mean(axis=0)
    sizes, axes = np.linalg.eigh((targets - middle).T @ (targets - middle))
    share = sizes[::-1] / max(float(sizes.sum()), 1e-300)
    count = max(int((share[:MAX_COMPONENTS] > MIN_COMPONENT_SHARE).sum()), 1)
    x = (targets - middle) @ axes[:, ::-1][:, :count]
    x /= x.std(axis=0) + 1e-12
    pairs = [x[:, i] * x[:, j] for i in range(count) for j in range(i + 1)]
    return np.column_stack([np.ones(len(x)), x, *pairs, x**3])


def ideal_signals(dataset: Dataset, terms: Float) -> list[Float] | None:
    """Return the signals (t, c) at the frames of each run, without memory, by a polynomial.

    Args:
        dataset: The dataset.
        terms: Terms of the polynomial, of `target_terms`.

    Returns:
        None if fewer frames with signals exist than the polynomial needs.
    """
    signals = np.concatenate([r.signals_at(r.time) for r in dataset.recordings])
    ideal = np.full_like(signals, np.nan)
    for c in range(signals.shape[1]):
        is_known = np.isfinite(signals[:, c])
        if is_known.sum() < 2 * terms.shape[1]:
            return None
        fitted = np.linalg.lstsq(terms[is_known], signals[is_known, c], rcond=None)[0]
        ideal[:, c] = terms @ fitted
    return np.split(ideal, np.cumsum([len(r.time) for r in dataset.recordings])[:-1])


def _fill(r: Recording) -> Float:
    """Return marker coordinates (t, d), interpolated where markers are hidden."""
    flat = r.points.reshape(len(r.time), -1)
    visible = np.isfinite(flat)
    columns = [
        np.interp(r.time, r.time[visible[:, k]], flat[visible[:, k], k])
        for k in np.flatnonzero(visible.any(axis=0))
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((len(r.time), 1))


def measure_character(dataset: Dataset, ideal: list[Float]) -> CordCharacter | None:
    """Measure how the cords of a dataset respond.

    Args:
        dataset: The dataset.
        ideal: Signals without memory, of `ideal_signals`.

    Returns:
        None if no run is longer than 20 s or no signal changes.
    """
    rows = []
    for r, s in zip(dataset.recordings, ideal, strict=True):
        if r.time[-1] - r.time[0] < MIN_SECONDS:
            continue
        observed = r.signals_at(r.time)
        for c in range(s.shape[1]):
            low, high = np.percentile(s[:, c], SPAN_PERCENTILES)
            if high - low > 0:
                rows.append(_measure_channel(r, c, s[:, c], observed[:, c], float(high - low)))
    if not rows:
        return None
    known = [v[np.isfinite(v)] for v in np.array(rows).T]
    return CordCharacter(*(float(np.median(v)) if len(v) else np.nan for v in known))


def _measure_channel(
    r: Recording, channel: int, ideal: Float, observed: Float, span: float
) -> tuple[float, float, float, float, float]:
    x, residual, time = ideal / span, (observed - ideal) / span, r.time
    speed = _speed(time, x)
    is_known = np.isfinite(residual)
    up, down = is_known & (speed > MOVING_PER_S), is_known & (speed < -MOVING_PER_S)
    hysteresis = _difference(x, residual, up, down)
    rates = []
    for direction in (up, down):
        if direction.any():
            fast = np.abs(speed) > np.median(np.abs(speed[direction]))
            rates.append(_difference(x, residual, direction & fast, direction & ~fast))
    rates = [v for v in rates if np.isfinite(v)]
    minutes = (time[is_known] - time[0]) / 60
    drift = np.nan
    if is_known.sum() > MIN_BIN_FRAMES:
        drift = abs(float(np.polyfit(minutes, residual[is_known], 1)[0]))
    samples = r.signals[:, channel] / span
    noise = np.diff(samples[np.isfinite(samples)], 2) / np.sqrt(6)
    deviation = 1.4826 * float(np.median(np.abs(noise))) if len(noise) else np.nan
    rate = float(np.mean(rates)) if rates else np.nan
    return hysteresis, rate, _after_steps(time, speed, residual), drift, deviation


def _speed(time: Float, x: Float) -> Float:
    """Return the rate of change (t,) of x (t,) per second, between means over 0.3 s."""
    width = max(round(SPEED_WINDOW_S / float(np.median(np.diff(time)))), 1)
    padded = np.pad(x, (width // 2, (width - 1) // 2), mode="edge")
    smooth = np.convolve(padded, np.full(width, 1 / width), mode="valid")
    half = SPEED_WINDOW_S / 2
    after, before = np.interp(time + half, time, smooth), np.interp(time - half, time, smooth)
    return np.asarray((after - before) / SPEED_WINDOW_S)


def _difference(x: Float, residual: Float, first: Bool, second: Bool) -> float:
    """Return the RMS difference of residuals between two sets of frames, at equal x."""
    if not (first.any() and second.any()):
        return float("nan")
    edges = np.quantile(x[first | second], np.linspace(0, 1, BINS + 1))
    bins = np.clip(np.searchsorted(edges, x) - 1, 0, BINS - 1)
    squares = []
    for k in range(BINS):
        a, b = residual[first & (bins == k)], residual[second & (bins == k)]
        if min(len(a), len(b)) >= MIN_BIN_FRAMES:
            squares.append((a.mean() - b.mean()) ** 2)
    return float(np.sqrt(np.mean(squares))) if squares else float("nan")


def _after_steps(time: Float, speed: Float, residual: Float) -> float:
    """Return the RMS change of a residual in the pauses after movements."""
    is_still = np.abs(speed) < STILL_PER_S
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_still, [False]]).astype(int)))
    changes = []
    for start, end in edges.reshape(-1, 2):
        begin, last = time[start] + STEP_DELAY_S, min(time[end - 1], time[start] + MAX_STEP_S)
        if start == 0 or last - time[start] < MIN_STILL_S:
            continue
        inside = residual[(time >= begin) & (time <= last) & np.isfinite(residual)]
        part = len(inside) // 5
        if part:
            changes.append(inside[-part:].mean() - inside[:part].mean())
    return float(np.sqrt(np.mean(np.square(changes)))) if changes else float("nan")
