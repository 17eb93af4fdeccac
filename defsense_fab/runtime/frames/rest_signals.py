"""Signals of a device at rest, as a decoder with memories expects them.

Rubber cords that were worked have other resistances at rest than fresh ones, and they return to
them within minutes. A decoder with memories knows that: from the same memories it finds the device
at rest at signals that are not zero. Taken for a drift of R0, they would be corrected twice.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import Branch

_STEP = 1e-4  # of signals, for slopes
_DAMPING = 0.1  # of the mean square slope of a signal


def rest_signals(branch: Branch, inputs: Float, rest: Float, prior: Float) -> Float:
    """Return the signals (k,) of a device at rest, of a decoder with the memories of `inputs`.

    They are a Gauss-Newton step to the positions at rest. Signals that hardly change the positions
    are those of the prior.

    Args:
        branch: The decoder.
        inputs: Its inputs (d,), the k signals first.
        rest: Outputs (o,) at rest.
        prior: Signals (k,) that are expected without the decoder.
    """
    k = len(branch.channels)
    steps = np.concatenate([np.zeros((1, len(inputs))), _STEP * np.eye(k, len(inputs))])
    outputs = branch.positions(inputs + steps)
    slopes = (outputs[1:] - outputs[0]) / _STEP
    normal = slopes @ slopes.T
    damping = max(_DAMPING * np.trace(normal) / k, _STEP)
    target = normal @ inputs[:k] + slopes @ (rest - outputs[0]) + damping * prior
    return np.asarray(np.linalg.solve(normal + damping * np.eye(k), target))
