"""States that cover what a device's poses span, for devices that do not say theirs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from .device import Handle, Pose, StatesSpec

RAMP = (0.25, 0.5, 0.75, 1.0)
#: Mixtures of two and of three poses, at most.
_PAIRS, _TRIPLES = 15, 4
#: Poses are opposite where of two moves of a region less than this is left in their sum.
_LEFT = 0.5


def default_states(poses: Sequence[Pose], ramp: tuple[float, ...] = RAMP) -> StatesSpec:
    """Each pose at the fractions of `ramp`, and of poses that agree and are not opposite each pair,
    whole and half. Held out are pairs of a whole and a half and three poses at once, or where no
    two go together each pose between its two largest fractions."""
    pairs = [(a, b) for a, b in combinations(poses, 2) if agree(a, b) and not opposite(a, b)]
    pairs = sorted(pairs, key=lambda p: _apart(poses, p))[:_PAIRS]
    mixtures, held_out = [], []
    for a, b in pairs:
        mixtures += [{a.name: w, b.name: w} for w in (0.5, 1.0)]
        held_out += [{a.name: 1.0, b.name: 0.5}, {a.name: 0.5, b.name: 1.0}]
    together = {frozenset((a.name, b.name)) for a, b in pairs}
    triples = [
        t
        for t in combinations([p.name for p in poses], 3)
        if all(frozenset(pair) in together for pair in combinations(t, 2))
    ]
    held_out += [dict.fromkeys(t, 0.7) for t in triples[:_TRIPLES]]
    if not held_out:
        between = (ramp[-1] + (ramp[-2] if len(ramp) > 1 else 0.0)) / 2
        held_out = [{p.name: round(between, 3)} for p in poses]
    return StatesSpec(ramp, tuple(mixtures), tuple(held_out), given=False)


def _apart(poses: Sequence[Pose], pair: tuple[Pose, Pose]) -> tuple[int, int]:
    """Neighbours first, so that a selection has all poses."""
    names = [p.name for p in poses]
    first, second = (names.index(p.name) for p in pair)
    return second - first, first


def agree(a: Pose, b: Pose) -> bool:
    """Whether two poses can be mixed: none moves what the other fixes, and what both move is free
    in both or in neither."""
    moved = [{h.region: h for h in pose.handles} for pose in (a, b)]
    if set(a.fixed) & moved[1].keys() or set(b.fixed) & moved[0].keys():
        return False
    return all(
        (np.isnan(h.translation) == np.isnan(moved[1][name].translation)).all()
        and h.free_axes.shape == moved[1][name].free_axes.shape
        for name, h in moved[0].items()
        if name in moved[1]
    )


def opposite(a: Pose, b: Pose) -> bool:
    """Whether a pose takes back what the other does, as bending up and down: then their mixtures
    are nearer to rest than either."""
    theirs = {h.region: h for h in b.handles}
    shared = [(h, theirs[h.region]) for h in a.handles if h.region in theirs]
    return any(
        float(np.linalg.norm(_move(h) + _move(g)))
        < _LEFT * max(float(np.linalg.norm(_move(h))), float(np.linalg.norm(_move(g))))
        for h, g in shared
    )


def _move(handle: Handle) -> np.ndarray:
    """Rotation (rad) and translation, in which 50 mm count as a radian, (6,); free is none."""
    return np.concatenate([handle.rotation, np.nan_to_num(handle.translation) / 50.0])
