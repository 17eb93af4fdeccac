"""How often a session of a hand shows each simulated state of a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.device.states import are_opposite, can_mix
from ...twin.scenes.hand_walk import plan_walk

WALKS, WALK_S, STEP_S = 3, 600.0, 0.1  # sessions of ten minutes


def session_shares(device: Device, weights: Sequence[Mapping[str, float]]) -> Float:
    """Return the share (n,) of a session's time in which each state is the nearest.

    The hand walks through the poses as in guided recordings, `twin/scenes/hand_walk.py`. Distances
    are those of the poses' weights.

    Args:
        device: The device.
        weights: For each state the weight of each pose, by name; none at rest.
    """
    poses = device.poses
    names = [pose.name for pose in poses]
    together = np.array([[can_mix(p, q) and not are_opposite(p, q) for q in poses] for p in poses])
    states = np.array([[w.get(name, 0.0) for name in names] for w in weights])
    count = np.zeros(len(states))
    time = np.arange(0.0, WALK_S, STEP_S)
    for seed in range(WALKS):
        levels = plan_walk(names, together, WALK_S, np.random.default_rng(seed))(time)
        nearest = ((levels[:, None] - states) ** 2).sum(axis=2).argmin(axis=1)
        count += np.bincount(nearest, minlength=len(states))
    return np.asarray(count / count.sum())
