"""Decide which cord each channel reads, and choose the poses that can decide it.

The likelihood of a cord on a channel has three parts: its resistance at rest, its changes in the
poses that were held, and whether the channel reacted when the cord's wire was moved. Poses are
held less or further than designed, so that all changes share an unknown factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core.arrays import Bool, Float, Int
from .records import ExpectedCord

#: Log likelihood ratio from which another order of the wires is reported: odds of 1000 to 1.
DECISIVE = float(np.log(1000))
#: Mean and standard deviation of how far a user holds a pose, relative to the design (assumed).
POSE_EXTENT, POSE_EXTENT_SPREAD = 0.9, 0.25
_EXTENTS = (0.4, 0.65, 0.9, 1.15)  # at which assignments are searched
#: Share of channels that differ from their cord in any way, such as a wrong resistor, and the width
#: of their distribution: two decades either way.
_OUTLIER_SHARE, _OUTLIER_WIDTH = 0.05, 4 * np.log(10)
#: Largest log likelihood ratio of one moved wire: a hand may touch other wires, too.
_MAX_WIRE_EVIDENCE = 4.0


@dataclass(frozen=True)
class Evidence:
    """What the readings say about c channels.

    Attributes:
        ohm: Resistances at rest (c,), ohm; NaN where they are unknown.
        changes: (R - R0)/R0 of the channels (c,) by the pose that was held; NaN where unknown.
        reactions: Log likelihood ratio (k, c) that a channel reacted when the wire of each of k
            cords was moved; zeros if none was.
        deviation: Standard deviation of the logarithm of resistances at rest (k,).
    """

    ohm: Float
    changes: Mapping[str, Float]
    reactions: Float
    deviation: Float


@dataclass(frozen=True)
class Assignment:
    """Which cord each channel reads.

    Attributes:
        cords: Index of the cord of each channel (c,).
        ratio: Log likelihood ratio against the expected order.
    """

    cords: Int
    ratio: float


def _rest_likelihood(cords: Sequence[ExpectedCord], evidence: Evidence) -> Float:
    """Return log likelihoods (channels, cords) of the resistances at rest."""
    expected = np.log([c.ohm for c in cords])
    known = np.isfinite(evidence.ohm) & (evidence.ohm > 0)
    logs = np.where(known, np.log(np.where(known, evidence.ohm, 1.0)), np.nan)
    z = (logs[:, None] - expected) / evidence.deviation
    density = np.exp(-0.5 * z**2) / (np.sqrt(2 * np.pi) * evidence.deviation)
    mixed = (1 - _OUTLIER_SHARE) * density + _OUTLIER_SHARE / _OUTLIER_WIDTH
    return np.where(known[:, None], np.log(np.where(np.isfinite(mixed), mixed, 1.0)), 0.0)


def _changes(cords: Sequence[ExpectedCord], evidence: Evidence) -> tuple[Float, Float, Float]:
    """Return measured changes (p, c), expected ones (p, k), and their deviations (p, k)."""
    names = list(evidence.changes)
    shape = len(names), len(cords)
    measured = np.array([evidence.changes[n] for n in names]).reshape(shape)
    mean = np.array([[c.changes[n].mean for c in cords] for n in names])
    deviation = np.array([[c.changes[n].deviation for c in cords] for n in names])
    return measured, mean.reshape(shape), deviation.reshape(shape)


class _Scores:
    """Log likelihoods of orders of the cords."""

    def __init__(self, cords: Sequence[ExpectedCord], evidence: Evidence) -> None:
        self._fixed = _rest_likelihood(cords, evidence) + evidence.reactions.T
        self._measured, self._mean, self._deviation = _changes(cords, evidence)

    def matrix(self, extent: float) -> Float:
        """Return log likelihoods (channels, cords) at an extent of all poses."""
        z = (self._measured[:, :, None] - extent * self._mean[:, None]) / self._deviation[:, None]
        changes = np.nansum(-0.5 * z**2 - np.log(self._deviation[:, None]), axis=0)
        return np.asarray(self._fixed + changes)

    def total(self, order: Int) -> float:
        """Return the log likelihood of an order; the extent of each pose is integrated out."""
        channels = np.arange(len(order))
        out = float(self._fixed[channels, order].sum())
        rows = zip(self._measured, self._mean[:, order], self._deviation[:, order], strict=True)
        for measured, mean, deviation in rows:
            known = np.isfinite(measured)
            s, r = mean[known], measured[known] - POSE_EXTENT * mean[known]
            variance = deviation[known] ** 2
            # Covariance diag(variance) + spread^2 s s^T, by the formula of Sherman and Morrison.
            gain = 1 + POSE_EXTENT_SPREAD**2 * float((s**2 / variance).sum())
            square = float((r**2 / variance).sum())
            square -= POSE_EXTENT_SPREAD**2 * float((s * r / variance).sum()) ** 2 / gain
            out -= 0.5 * (square + float(np.log(variance).sum()) + float(np.log(gain)))
        return out


def assign_cords(cords: Sequence[ExpectedCord], evidence: Evidence, usable: Bool) -> Assignment:
    """Find the cord that each channel reads.

    Args:
        cords: The cords in the expected order of the channels.
        evidence: What the readings say.
        usable: Which channels (c,) can be exchanged with others: an open channel cannot show which
            cord it reads.

    Returns:
        The expected order, unless another one is decisively more likely than it.
    """
    scores, expected = _Scores(cords, evidence), np.arange(len(cords))
    free = np.flatnonzero(usable)
    candidates = [expected]
    for extent in _EXTENTS:
        order = expected.copy()
        costs = -scores.matrix(extent)[np.ix_(free, free)]
        order[free] = free[linear_sum_assignment(costs)[1]]
        candidates.append(order)
    candidates += [_exchange(expected, i, j) for i, j in combinations(free.tolist(), 2)]
    best = max(candidates, key=scores.total)
    ratio = scores.total(best) - scores.total(expected)
    if ratio <= DECISIVE:
        return Assignment(expected, 0.0)
    # Only exchanges that are decisive: the rest of an order may be arbitrary.
    return Assignment(_keep_decisive(best, scores), ratio)


def _exchange(order: Int, i: int, j: int) -> Int:
    out = order.copy()
    out[[i, j]] = order[[j, i]]
    return out


def _keep_decisive(order: Int, scores: _Scores) -> Int:
    """Return the order without those exchanges that are hardly more likely than the identity."""
    for channel in range(len(order)):
        if order[channel] != channel:
            other = int(np.flatnonzero(order == channel)[0])
            undone = _exchange(order, channel, other)
            if scores.total(order) - scores.total(undone) <= DECISIVE:
                order = undone
    return order


def separation(
    cords: Sequence[ExpectedCord], deviation: Float, poses: Sequence[str]
) -> tuple[Float, Bool]:
    """Return how clearly each pair of cords can be distinguished.

    Args:
        cords: The cords.
        deviation: Standard deviation of the logarithm of their resistances at rest (k,).
        poses: Names of the poses that are held.

    Returns:
        The expected log likelihood ratio (k, k) of the right order against an exchange of two
        cords, and whether it is decisive. The ratio of each cord against itself is infinite.
    """
    logs = np.log([c.ohm for c in cords])
    out = (logs[:, None] - logs) ** 2 / (deviation[:, None] * deviation)
    for name in poses:
        mean = POSE_EXTENT * np.array([c.changes[name].mean for c in cords])
        spread = np.array([c.changes[name].deviation for c in cords])
        out = out + (mean[:, None] - mean) ** 2 / (spread[:, None] * spread)
    np.fill_diagonal(out, np.inf)
    # The ratio scatters: half of it is left with a probability of 84 % at a ratio of 8.
    return out, np.asarray(out >= 2 * DECISIVE)


def choose_poses(cords: Sequence[ExpectedCord], deviation: Float) -> tuple[str, ...]:
    """Choose the fewest poses, one after the other, that distinguish all cords.

    Args:
        cords: The cords, with their changes in all poses that can be held.
        deviation: Standard deviation of the logarithm of their resistances at rest (k,).

    Returns:
        Names of poses; empty if the resistances at rest suffice, or if no pose helps.
    """
    chosen: list[str] = []
    left = list(cords[0].changes)
    while left:
        before, is_clear = separation(cords, deviation, chosen)
        if is_clear.all():
            break

        def gain(name: str, before: Float = before) -> float:
            after, _ = separation(cords, deviation, [*chosen, name])
            limit = 2 * DECISIVE
            return float((np.minimum(after, limit) - np.minimum(before, limit)).sum())

        best = max(left, key=gain)
        if gain(best) < 1.0:
            break
        chosen.append(best)
        left.remove(best)
    return tuple(chosen)


def indistinct_pairs(
    cords: Sequence[ExpectedCord], deviation: Float, poses: Sequence[str]
) -> list[tuple[str, str]]:
    """Return the pairs of cords that these poses cannot distinguish."""
    _, is_clear = separation(cords, deviation, poses)
    pairs = combinations(range(len(cords)), 2)
    return [(cords[i].name, cords[j].name) for i, j in pairs if not is_clear[i, j]]


def wire_reactions(spread_at_rest: Float, spread_moved: Float, count: float) -> Float:
    """Return log likelihood ratios that channels reacted to moved wires.

    A channel that reacts has a larger variance than at rest. A hand that moves the whole device
    makes all channels react, so the others are the measure.

    Args:
        spread_at_rest: Standard deviations of slow changes (c,) at rest.
        spread_moved: The same while the wire of each of k cords is moved (k, c).
        count: Number of independent values in a step.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (spread_moved / spread_at_rest) ** 2
    ratio = np.where(np.isfinite(ratio), ratio, 1.0)
    out = np.zeros_like(ratio)
    for k, c in np.ndindex(*ratio.shape):
        others = np.delete(ratio[k], c)
        excess = ratio[k, c] / max(float(np.median(others)) if len(others) else 1.0, 1.0)
        if excess > 1:
            out[k, c] = 0.5 * count * (excess - 1 - np.log(excess))
    return np.minimum(out, _MAX_WIRE_EVIDENCE)
