"""A finger that passes over the device now and then, as hands that bend it do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.arrays import Float
from .scene import Ball

_EVERY, _LASTS = 6.0, 1.2  # s
_RADIUS, _ABOVE = 8.0, 14.0  # mm
_LEVEL = 105.0


def passing_hand(
    rng: np.random.Generator, bounds: Float, towards: Float
) -> Callable[[float], tuple[Ball, ...]]:
    """What is in the way at a time, s: of a body within `bounds` (2, 3) mm, on the side of its
    cameras, which are in the direction `towards` (3,). Once in six seconds a finger goes in a
    straight line from one place above the body to another."""
    seed = int(rng.integers(1 << 31))
    low, high = bounds
    reach = (high - low) / 2
    lifted = towards * (float(np.abs(towards) @ reach) + _ABOVE)
    flat = np.eye(3) - np.outer(towards, towards)

    def at(seconds: float) -> tuple[Ball, ...]:
        turn = max(int(seconds // _EVERY), 0)  # the first picture's first rows are read before 0 s
        own = np.random.default_rng([seed, turn])
        begins = own.uniform(0.5, _EVERY - _LASTS)
        ends = (low + high) / 2 + own.uniform(-1, 1, (2, 3)) * reach @ flat + lifted
        part = (seconds - turn * _EVERY - begins) / _LASTS
        if not 0 <= part <= 1:
            return ()
        return (Ball((1 - part) * ends[0] + part * ends[1], _RADIUS, _LEVEL),)

    return at
