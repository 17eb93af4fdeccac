"""Which states a twin's shapes are solved in: a sample of what a device's poses span."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.device import Device, PointDrag, Pose
from ...core.device.states import acts, agree, opposite
from ...core.errors import CaptureError
from ...geometry.bodies.body_record import load_surface
from ..scenes.hand_walk import MIXTURE_LIMITS

#: Parts of the way that a pose is solved at, the last one being `FURTHEST` of its amplitude.
_LEVELS = (0.2, 0.45, 0.7, 0.9, 1.0)
FURTHEST = 1.1
_CORNERS = 12  # pairs, and half as many triples, that are taken to their ends
_PARTS = (0.5, 1.0)
_SEED, _SPOTS = 11, 2000
_PULL, _HAND = 8.0, 10.0  # mm; mm, that times Young's modulus is a hand's stiffness


@dataclass(frozen=True)
class Ray:
    """Poses' weights `end` (d,), and the parts of the way there that are solved."""

    end: Float
    parts: tuple[float, ...]


def companions(poses: Sequence[Pose]) -> Bool:
    """Which poses (d, d) can be taken at once."""
    d = len(poses)
    out = np.zeros((d, d), bool)
    for i, j in combinations(range(d), 2):
        out[i, j] = out[j, i] = agree(poses[i], poses[j]) and not opposite(poses[i], poses[j])
    return out


def coordinates(poses: Sequence[Pose]) -> Float:
    """Axes (r, d) of `PoseSpace`: mixtures add up what poses do (`mechanics/loading/pose.py`), so
    that poses which do the same, more or less or backwards, and hold and leave free the same, lie
    on one axis; the farthest pose on each axis is 1 away."""
    told = [{(_kind(p), *key): value for key, value in acts(p).items()} for p in poses]
    keys = {key: len(value) for one in told for key, value in one.items()}
    does = np.array(
        [np.concatenate([one.get(k, np.zeros(n)) for k, n in keys.items()]) for one in told]
    )
    left, size, _ = np.linalg.svd(does, full_matrices=False)
    axes = left.T[size > 1e-9 * size.max(initial=1e-300)]
    return np.asarray(axes / np.abs(axes).max(axis=1, keepdims=True))


def _kind(pose: Pose) -> str:
    """What a pose holds and leaves free, as one word."""
    free = [(h.region, np.isnan(h.translation).tolist(), h.free_axes.tolist(),
             None if h.about is None else h.about.tolist()) for h in pose.handles]  # fmt: skip
    return repr((sorted(pose.fixed), sorted(free), sorted(s.region for s in pose.symmetry)))


def singles(count: int) -> list[Ray]:
    """Each of d poses by itself."""
    return [Ray(FURTHEST * end, _LEVELS) for end in np.eye(count)]


def corners(together: Bool) -> list[Ray]:
    """Pairs and triples at their ends, of those there are at most so many, evenly chosen."""
    out = []
    for size, most, level in ((2, _CORNERS, MIXTURE_LIMITS[0]), (3, _CORNERS // 2, MIXTURE_LIMITS[1])):
        found = groups(together, size)
        step = max(len(found) / most, 1.0)
        for k in range(min(len(found), most)):
            end = np.zeros(len(together))
            end[list(found[int(k * step)])] = level
            out.append(Ray(end, _PARTS))
    return out


def groups(together: Bool, size: int) -> list[tuple[int, ...]]:
    """Of so many poses that can all be taken at once."""
    return [
        g
        for g in combinations(range(len(together)), size)
        if all(together[i, j] for i, j in combinations(g, 2))
    ]


def scattered(together: Bool, count: int, rng: np.random.Generator) -> list[Ray]:
    """Random mixtures of two and three poses that go together, or single poses where none do."""
    pairs, triples = groups(together, 2), groups(together, 3)
    out = []
    for _ in range(count):
        end = np.zeros(len(together))
        if not pairs:
            end[rng.integers(len(end))] = rng.uniform(0.1, FURTHEST)
            out.append(Ray(end, (1.0,)))
            continue
        three = bool(triples) and rng.random() < 0.4
        chosen = triples if three else pairs
        group = list(chosen[rng.integers(len(chosen))])
        end[group] = rng.uniform(0.1, MIXTURE_LIMITS[int(three)], len(group))
        out.append(Ray(end, _PARTS))
    return out


def grips(device: Device, folder: Path, count: int) -> tuple[Pose, ...]:
    """Places of the skin that are pulled at sideways, which no pose does: away from what poses hold
    or move, as far apart as can be."""
    if not count:
        return ()
    rng = np.random.default_rng(_SEED)
    points = load_surface(folder).scatter(_SPOTS, rng)
    held = {n for p in device.poses for n in (*p.fixed, *(h.region for h in p.handles))}
    for name in held:
        points = points[~device.regions[name].contains(points)]
    if len(points) < count:
        raise CaptureError(f"{device.source}: poses hold the whole skin; there is no place to grip")
    chosen = [points[int(np.linalg.norm(points - points.mean(0), axis=1).argmin())]]
    while len(chosen) < count:
        apart = np.linalg.norm(points[:, None] - np.array(chosen), axis=2).min(1)
        chosen.append(points[int(apart.argmax())])
    ways = rng.normal(size=(count, 3))
    pulls = _PULL * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    stiffness = _HAND * device.material.young_modulus
    return tuple(
        Pose(f"grip_{k + 1}", (), (), drags=(PointDrag(at, by, stiffness),))
        for k, (at, by) in enumerate(zip(chosen, pulls, strict=True))
    )


def gripped(poses: Sequence[Pose], grips: Sequence[Pose]) -> tuple[Pose, ...]:
    """Poses and grips, which hold what the first pose holds and leave its handles at rest."""
    first = poses[0]
    still = tuple(
        replace(h, rotation=0 * h.rotation, translation=0 * h.translation) for h in first.handles
    )
    return (*poses, *(replace(g, fixed=first.fixed, handles=still) for g in grips))
