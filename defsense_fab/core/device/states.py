"""States that cover what a device's poses span, for devices that do not say theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from ..arrays import Float
from .device import Handle, Pose, StatesSpec

# How far along which path of loading a state lies.

#: The poses of a path by name, and how much of each there is where the largest is whole.
LoadingPath = tuple[tuple[str, float], ...]


def on_path(weights: Mapping[str, float]) -> tuple[LoadingPath, float]:
    """Of a state with so much of each pose (of one at least, not zero): poses of which it has
    nothing, and the order in which they are given, do not matter."""
    largest = max(map(abs, weights.values()))
    return tuple((n, round(w / largest, 9)) for n, w in sorted(weights.items()) if w), largest


RAMP = (0.25, 0.5, 0.75, 1.0)
#: Mixtures of two and of three poses, at most.
_PAIRS, _TRIPLES = 15, 4
#: Poses are opposite where of two moves of a region less than this is left in their sum.
_LEFT = 0.5


def default_states(poses: Sequence[Pose], ramp: tuple[float, ...] = RAMP) -> StatesSpec:
    """Each pose at the fractions of `ramp`, and of poses that agree and are not opposite each pair,
    whole (the largest fraction) and half. Held out are pairs of a whole and a half and three poses
    at once, or where no two go together each pose between its two largest fractions."""
    pairs = [(a, b) for a, b in combinations(poses, 2) if agree(a, b) and not opposite(a, b)]
    pairs = sorted(pairs, key=lambda p: _apart(poses, p))[:_PAIRS]
    mixtures, held_out = [], []
    whole, half = ramp[-1], _short(0.5 * ramp[-1])
    for a, b in pairs:
        mixtures += [{a.name: w, b.name: w} for w in (half, whole)]
        held_out += [{a.name: whole, b.name: half}, {a.name: half, b.name: whole}]
    together = {frozenset((a.name, b.name)) for a, b in pairs}
    triples = [
        t
        for t in combinations([p.name for p in poses], 3)
        if all(frozenset(pair) in together for pair in combinations(t, 2))
    ]
    held_out += [dict.fromkeys(t, _short(0.7 * whole)) for t in triples[:_TRIPLES]]
    if not held_out:
        between = (ramp[-1] + (ramp[-2] if len(ramp) > 1 else 0.0)) / 2
        held_out = [{p.name: _short(between)} for p in poses]
    return StatesSpec(ramp, tuple(mixtures), tuple(held_out), given=False)


def _apart(poses: Sequence[Pose], pair: tuple[Pose, Pose]) -> tuple[int, int]:
    """Neighbours first, so that a selection has all poses."""
    names = [p.name for p in poses]
    first, second = (names.index(p.name) for p in pair)
    return second - first, first


def agree(a: Pose, b: Pose) -> bool:
    """Whether two poses can be mixed: none moves what the other fixes, and what both move they turn
    about one point, freely in both or in neither."""
    moved = [{h.region: h for h in pose.handles} for pose in (a, b)]
    if set(a.fixed) & moved[1].keys() or set(b.fixed) & moved[0].keys():
        return False
    return all(
        shared_point(h, moved[1][name]) is not False
        and h.free_axes.shape == moved[1][name].free_axes.shape
        for name, h in moved[0].items()
        if name in moved[1]
    )


def shared_point(a: Handle, b: Handle) -> Float | Literal[False] | None:
    """The point (3,) mm about which a region turns that both handles move, None for its middle;
    False where they turn it about different points."""
    turning = [h for h in (a, b) if h.rotation.any() or len(h.free_axes)]
    points = [h.about for h in turning]
    first = points[0] if points else None
    for other in points[1:]:
        if (first is None) != (other is None) or (
            first is not None and not np.array_equal(first, np.asarray(other))
        ):
            return False
    return first


def _short(weight: float) -> float:
    """As many digits as the name of a state has."""
    return float(f"{weight:.6g}")


def opposite(a: Pose, b: Pose) -> bool:
    """Whether a pose takes back what the other does, as bending up and down: then their mixtures
    are nearer to rest than either."""
    mine, theirs = acts(a), acts(b)
    return any(
        float(np.linalg.norm(mine[key] + theirs[key]))
        < _LEFT * float(max(np.linalg.norm(mine[key]), np.linalg.norm(theirs[key])))
        for key in mine.keys() & theirs.keys()
    )


def acts(pose: Pose) -> dict[tuple[object, ...], Float]:
    """All that a pose does, by what it does it to. Of a handle rotation (rad) and translation, in
    which 50 mm count as a radian, (6,); free is none."""
    out: dict[tuple[object, ...], Float] = {("gravity",): pose.gravity}
    for h in pose.handles:
        out["handle", h.region] = np.append(h.rotation, np.nan_to_num(h.translation) / 50.0)
    for p in pose.pressures:
        out["pressure", p.region] = np.array([p.value])
    for d in pose.drags:
        out["drag", *d.at.tolist()] = d.by
    return out
