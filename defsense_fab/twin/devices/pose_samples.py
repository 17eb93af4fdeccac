"""Samples of the pose space of a device: the states in which its twin is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.device import Device, PointDrag, Pose
from ...core.device.states import are_opposite, can_mix, pose_actions
from ...core.errors import CaptureError
from ...store.build import Build
from ..scenes.hand_walk import MIXTURE_LIMITS

#: Largest level of a pose that is simulated.
FURTHEST = 1.1
SINGLE_FRACTIONS = (0.2, 0.45, 0.7, 0.9, 1.0)  # of a ray to `FURTHEST`
MIXTURE_FRACTIONS = (0.5, 1.0)
MAX_CORNER_PAIRS = 12  # pairs of poses at their ends; half as many triples
TRIPLE_SHARE = 0.4  # of random mixtures
AXIS_RTOL = 1e-9  # relative to the largest singular value
GRIP_SEED, GRIP_CANDIDATES = 11, 2000
GRIP_PULL_MM = 8.0
GRIP_STIFFNESS_MM = 10.0  # times Young's modulus: the stiffness of a hand


@dataclass(frozen=True)
class Ray:
    """States on the way from rest to a mixture of poses.

    Attributes:
        end: Weights of the poses at the end (d,).
        fractions: Fractions of the way that are simulated, increasing.
    """

    end: Float
    fractions: tuple[float, ...]


def find_mixable_poses(poses: Sequence[Pose]) -> Bool:
    """Return which of d poses can be mixed (d, d)."""
    d = len(poses)
    mixable = np.zeros((d, d), bool)
    for i, j in combinations(range(d), 2):
        is_mixable = can_mix(poses[i], poses[j]) and not are_opposite(poses[i], poses[j])
        mixable[i, j] = mixable[j, i] = is_mixable
    return mixable


def pose_axes(poses: Sequence[Pose]) -> Float:
    """Return the axes (r, d) of the pose space of d poses.

    Mixtures add up the actions of poses (`mechanics/loading/pose.py`). Poses with proportional
    actions that hold and free the same regions share one axis. The furthest pose on each axis is at
    distance 1.
    """
    actions = [
        {(_constraints(p), *key): value for key, value in pose_actions(p).items()} for p in poses
    ]
    sizes = {key: len(value) for action in actions for key, value in action.items()}
    matrix = np.array(
        [np.concatenate([a.get(k, np.zeros(n)) for k, n in sizes.items()]) for a in actions]
    )
    left, size, _ = np.linalg.svd(matrix, full_matrices=False)
    axes = left.T[size > AXIS_RTOL * size.max(initial=1e-300)]
    return np.asarray(axes / np.abs(axes).max(axis=1, keepdims=True))


def _constraints(pose: Pose) -> str:
    """Return a key of what a pose holds and leaves free."""
    handles = [
        (
            h.region,
            np.isnan(h.translation).tolist(),
            h.free_axes.tolist(),
            None if h.about is None else h.about.tolist(),
        )
        for h in pose.handles
    ]
    return repr((sorted(pose.fixed), sorted(handles), sorted(s.region for s in pose.symmetry)))


def single_rays(count: int) -> list[Ray]:
    """Return one ray for each of `count` poses."""
    return [Ray(FURTHEST * end, SINGLE_FRACTIONS) for end in np.eye(count)]


def corner_rays(mixable: Bool) -> list[Ray]:
    """Return rays to mixtures of two and three poses at their ends, evenly chosen.

    Args:
        mixable: Which poses can be mixed (d, d).
    """
    rays = []
    for size, limit in ((2, MAX_CORNER_PAIRS), (3, MAX_CORNER_PAIRS // 2)):
        groups = _mixable_groups(mixable, size)
        step = max(len(groups) / limit, 1.0)
        for k in range(min(len(groups), limit)):
            end = np.zeros(len(mixable))
            end[list(groups[int(k * step)])] = MIXTURE_LIMITS[size - 2]
            rays.append(Ray(end, MIXTURE_FRACTIONS))
    return rays


def _mixable_groups(mixable: Bool, size: int) -> list[tuple[int, ...]]:
    """Return the groups of `size` poses that can all be mixed."""
    return [
        g
        for g in combinations(range(len(mixable)), size)
        if all(mixable[i, j] for i, j in combinations(g, 2))
    ]


def draw_rays(mixable: Bool, count: int, rng: np.random.Generator) -> list[Ray]:
    """Draw rays to random mixtures of two or three poses, or to single poses if none can be mixed.

    Args:
        mixable: Which poses can be mixed (d, d).
        count: Number of rays.
        rng: Random generator.
    """
    pairs, triples = _mixable_groups(mixable, 2), _mixable_groups(mixable, 3)
    rays = []
    for _ in range(count):
        end = np.zeros(len(mixable))
        if not pairs:
            end[rng.integers(len(end))] = rng.uniform(0.1, FURTHEST)
            rays.append(Ray(end, (1.0,)))
            continue
        is_triple = bool(triples) and rng.random() < TRIPLE_SHARE
        groups = triples if is_triple else pairs
        group = list(groups[rng.integers(len(groups))])
        end[group] = rng.uniform(0.1, MIXTURE_LIMITS[int(is_triple)], len(group))
        rays.append(Ray(end, MIXTURE_FRACTIONS))
    return rays


def add_grips(device: Device, build: Build, count: int) -> tuple[Pose, ...]:
    """Return the poses of a device, and poses that pull sideways at other points of its skin.

    The points are outside of the regions that poses hold or move, and as far apart as possible.
    Grips hold what the first pose holds, and the handles of that pose stay at rest.

    Args:
        device: The device.
        build: Its build.
        count: Number of grips.

    Raises:
        CaptureError: The poses hold the whole skin (`no-place-to-grip`).
    """
    if not count:
        return device.poses
    rng = np.random.default_rng(GRIP_SEED)
    points = build.surface.scatter(GRIP_CANDIDATES, rng)
    regions = {n for p in device.poses for n in (*p.fixed, *(h.region for h in p.handles))}
    for name in regions:
        points = points[~device.regions[name].contains(points)]
    if len(points) < count:
        raise CaptureError(
            "the poses hold the whole skin, so that there is no place to grip it",
            code="no-place-to-grip",
            where=device.source,
            action="Simulate it without grips",
        )
    chosen = [points[int(np.linalg.norm(points - points.mean(0), axis=1).argmin())]]
    while len(chosen) < count:
        distance = np.linalg.norm(points[:, None] - np.array(chosen), axis=2).min(1)
        chosen.append(points[int(distance.argmax())])
    directions = rng.normal(size=(count, 3))
    pulls = GRIP_PULL_MM * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    stiffness = GRIP_STIFFNESS_MM * device.material.young_modulus
    first = device.poses[0]
    at_rest = tuple(
        replace(h, rotation=0 * h.rotation, translation=0 * h.translation) for h in first.handles
    )
    grips = (
        Pose(f"grip_{k + 1}", first.fixed, at_rest, drags=(PointDrag(point, pull, stiffness),))
        for k, (point, pull) in enumerate(zip(chosen, pulls, strict=True))
    )
    return (*device.poses, *grips)
