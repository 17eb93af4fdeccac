"""States of a device: default states that cover its poses, and the loading path of a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from ..arrays import Float
from .device import Handle, Pose, StatesSpec

DEFAULT_RAMP = (0.25, 0.5, 0.75, 1.0)
_MAX_PAIRS, _MAX_TRIPLES = 15, 4  # of poses that are mixed
#: Two poses are opposite where the sum of their actions on a region is smaller than this share of
#: the larger one.
_OPPOSITE_REMAINDER = 0.5
_MM_PER_RAD = 50.0  # translation that counts as much as a rotation by one radian

#: Poses of a path by name, with their shares relative to the largest one.
LoadingPath = tuple[tuple[str, float], ...]


def loading_path(weights: Mapping[str, float]) -> tuple[LoadingPath, float]:
    """Return the loading path of a state, and how far along it the state is.

    Neither poses of weight zero nor the order of the poses matter.

    Args:
        weights: Weight of each pose in the state; at least one is not zero.

    Returns:
        The path, and the largest weight.
    """
    largest = max(map(abs, weights.values()))
    return tuple((n, round(w / largest, 9)) for n, w in sorted(weights.items()) if w), largest


def default_states(
    poses: Sequence[Pose],
    ramp: tuple[float, ...] = DEFAULT_RAMP,
    mixtures: Sequence[Mapping[str, float]] | None = None,
    held_out: Sequence[Mapping[str, float]] | None = None,
) -> StatesSpec:
    """Complete the states of a device: propose the lists that are not given.

    The states are each pose at the fractions of the ramp. Proposed mixtures are pairs of poses that
    can be mixed and are not opposite, at the largest fraction and at half of it. Proposed to be
    held out are pairs of one at the largest fraction and one at half, and three poses at once; if
    no pair is left, each pose between its two largest fractions. A proposed list does not contain
    states of a given list.

    Args:
        poses: Poses of the device.
        ramp: Fractions of each pose, increasing.
        mixtures: Weights of the poses in each mixture; None to propose mixtures.
        held_out: The same for states held out of the design; None to propose them.

    Returns:
        The states, with marks on which lists were given.
    """
    pairs = [(a, b) for a, b in combinations(poses, 2) if can_mix(a, b) and not are_opposite(a, b)]
    pairs = sorted(pairs, key=lambda p: _pair_order(poses, p))[:_MAX_PAIRS]
    full, half = ramp[-1], _round_weight(0.5 * ramp[-1])
    mixed: list[Mapping[str, float]] = []
    unseen: list[Mapping[str, float]] = []
    for a, b in pairs:
        mixed += [{a.name: w, b.name: w} for w in (half, full)]
        unseen += [{a.name: full, b.name: half}, {a.name: half, b.name: full}]
    mixable = {frozenset((a.name, b.name)) for a, b in pairs}
    triples = [
        t
        for t in combinations([p.name for p in poses], 3)
        if all(frozenset(pair) in mixable for pair in combinations(t, 2))
    ]
    unseen += [dict.fromkeys(t, _round_weight(0.7 * full)) for t in triples[:_MAX_TRIPLES]]
    unseen = _without(unseen, mixtures or ())
    if not unseen:
        between = (ramp[-1] + (ramp[-2] if len(ramp) > 1 else 0.0)) / 2
        unseen = _without([{p.name: _round_weight(between)} for p in poses], mixtures or ())
    return StatesSpec(
        ramp,
        tuple(_without(mixed, held_out or ()) if mixtures is None else mixtures),
        tuple(unseen if held_out is None else held_out),
        mixtures_given=mixtures is not None,
        held_out_given=held_out is not None,
    )


def state_key(weights: Mapping[str, float]) -> tuple[tuple[str, str], ...]:
    """Return a key that is the same for states of the same name, in any order of the poses."""
    return tuple(sorted((pose, f"{w:g}") for pose, w in weights.items() if w))


def _without(
    states: Sequence[Mapping[str, float]], others: Sequence[Mapping[str, float]]
) -> list[Mapping[str, float]]:
    """Return the states that are not among others."""
    known = set(map(state_key, others))
    return [state for state in states if state_key(state) not in known]


def _pair_order(poses: Sequence[Pose], pair: tuple[Pose, Pose]) -> tuple[int, int]:
    """Return a sort key that puts neighbors first, so that a selection includes all poses."""
    names = [p.name for p in poses]
    first, second = (names.index(p.name) for p in pair)
    return second - first, first


def can_mix(a: Pose, b: Pose) -> bool:
    """Return whether two poses can act at once.

    Neither may move a region that the other fixes. A region that both move must turn about the same
    pivot, and be free in both or in neither.
    """
    moved = [{h.region: h for h in pose.handles} for pose in (a, b)]
    if set(a.fixed) & moved[1].keys() or set(b.fixed) & moved[0].keys():
        return False
    return all(
        shared_pivot(h, moved[1][name]) is not False
        and h.free_axes.shape == moved[1][name].free_axes.shape
        for name, h in moved[0].items()
        if name in moved[1]
    )


def shared_pivot(a: Handle, b: Handle) -> Float | Literal[False] | None:
    """Return the pivot about which two handles turn the same region.

    Returns:
        The pivot (3,) in mm, None for the region's center, or False where the pivots differ.
    """
    turning = [h for h in (a, b) if h.rotation.any() or len(h.free_axes)]
    pivots = [h.about for h in turning]
    first = pivots[0] if pivots else None
    for other in pivots[1:]:
        if (first is None) != (other is None) or (
            first is not None and not np.array_equal(first, np.asarray(other))
        ):
            return False
    return first


def _round_weight(weight: float) -> float:
    """Round to as many digits as the name of a state has."""
    return float(f"{weight:.6g}")


def are_opposite(a: Pose, b: Pose) -> bool:
    """Return whether one pose undoes the other, as bending up and down.

    Mixtures of such poses are closer to rest than either pose.
    """
    actions, others = pose_actions(a), pose_actions(b)
    return any(
        float(np.linalg.norm(actions[key] + others[key]))
        < _OPPOSITE_REMAINDER
        * float(max(np.linalg.norm(actions[key]), np.linalg.norm(others[key])))
        for key in actions.keys() & others.keys()
    )


def pose_actions(pose: Pose) -> dict[tuple[object, ...], Float]:
    """Return everything that a pose does, by the kind of action and its target.

    Args:
        pose: A pose.

    Returns:
        Gravity (3,); per handle, rotation (rad) and translation (in units of 50 mm) (6,), where
        free components are 0; pressures (1,); drags (3,).
    """
    out: dict[tuple[object, ...], Float] = {("gravity",): pose.gravity}
    for h in pose.handles:
        out["handle", h.region] = np.append(h.rotation, np.nan_to_num(h.translation) / _MM_PER_RAD)
    for p in pose.pressures:
        out["pressure", p.region] = np.array([p.value])
    for d in pose.drags:
        out["drag", *d.at.tolist()] = d.by
    return out
