"""How a device opens: the joints in the reverse of the order in which they are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import igl
import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths
from ...core.mesh import Surface
from ...store.manifest import JoinStep
from .followers import Follower

_OPENED = 0.1  # of the device's size: how far either side of a joint goes
_NEAR = 0.5  # mm further off than the nearest part: a cord lies between both
_SOFT = 0.04  # of a cord's length: how soon it goes from one part's way to another's


def openings(steps: Sequence[JoinStep], names: Sequence[str], size: float) -> Float:
    """Where the joints take the parts `names` as they open, (steps, parts, 3) mm: either side along
    the normal of the cut."""
    out = np.zeros((len(steps), len(names), 3))
    for k, step in enumerate(steps):
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                out[k, list(names).index(name)] = sign * _OPENED * size * step.opens
    return out


def followed(
    followers: Sequence[Follower], parts: Mapping[str, Surface], ways: Float
) -> list[Float]:
    """Where the joints take the points (p, 3) of each follower, (steps, p, 3) mm, as they open by
    the `ways` (steps, parts, 3) mm of the parts: with the parts that they lie in or between."""
    if not followers:
        return []
    counts = [len(f.points) for f in followers]
    points = np.concatenate([f.points for f in followers])
    squared = [
        igl.point_mesh_squared_distance(points, s.vertices, s.faces)[0] for s in parts.values()
    ]
    away = np.sqrt(np.maximum(np.transpose(squared), 0))
    near = (away <= away.min(axis=1, keepdims=True) + _NEAR).astype(float)
    near /= near.sum(axis=1, keepdims=True)
    pieces = np.split(near, np.cumsum(counts)[:-1])
    return [
        np.einsum("pn,snj->spj", _evened(f, piece), ways)
        for f, piece in zip(followers, pieces, strict=True)
    ]


def _evened(follower: Follower, near: Float) -> Float:
    """Shares (p, parts): of what bends they change little by little, of others not."""
    if not follower.bends:
        return np.broadcast_to(near.mean(axis=0), near.shape)
    at = arc_lengths(follower.points)
    soft = np.exp(-(((at[:, None] - at) / (_SOFT * max(float(at[-1]), 1e-9))) ** 2))
    return np.asarray(soft @ near / soft.sum(axis=1, keepdims=True))
