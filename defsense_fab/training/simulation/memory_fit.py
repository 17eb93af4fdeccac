"""What turns the signals of a built device's cords into those that the simulation knows.

Each channel has a gain near one and an offset near zero; what cords remember is the same of all
(`decoding/shared_memory.py`). These few numbers are found so that the markers come out where
cameras saw them (Gauss-Newton with a soft L1 loss): a few dozen pictures tell them.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float
from ...decoding.input_features import InputDecoder
from ...decoding.past import Past
from ...decoding.shared_memory import SharedMemory

#: Time constants, s, among which cross-validation chooses; none, for cords that forget at once.
PASTS = (
    Past(),
    Past((2.0, 30.0), (2.0, 20.0)),
    Past((0.5, 5.0, 50.0), (5.0, 50.0)),
    Past((1.0, 10.0, 60.0), (1.0, 10.0, 60.0)),
)
#: Standard deviations that the numbers are expected to have.
_GAINS, _OFFSETS, _MOVED, _WORKED = 0.15, 0.02, 0.3, 0.1
_FEW = 300  # pictures that are looked at
_ERROR = 1.0  # mm, of the map itself
_TRIES = 60  # evaluations


def fit_memory(
    decoder: InputDecoder, past: Past, inputs: Float, points: Float, known: Bool,
    near: SharedMemory | None = None,
) -> SharedMemory:  # fmt: skip
    """For a static decoder of c signals, by inputs (t, d) made with the `past`, and markers
    `points` (t, m, 3) mm in the frame of what the decoder gives, where `known` (t, m);
    beginning at one that is `near`."""
    c, K = decoder.features.inputs, len(past.moved)
    step = max(len(inputs) // _FEW, 1)
    z, there = inputs[::step], known[::step]
    p = points[::step]
    scale = _ERROR * np.sqrt(there.sum() / max(len(z), 1))  # a picture counts once
    spread = np.repeat(
        [_GAINS, _OFFSETS, _MOVED, _WORKED], [c, c, K, len(past.worked)]
    )  # fmt: skip

    def made(x: Float) -> SharedMemory:
        return SharedMemory(
            np.exp(x[:c]), x[c : 2 * c], x[2 * c : 2 * c + K], x[2 * c + K :], decoder
        )

    def residuals(x: Float) -> Float:
        off = (made(x)(z).reshape(p.shape) - p)[there]
        return np.concatenate([off.ravel() / scale, x / spread])

    start = np.zeros(len(spread))
    if near is not None:
        start = np.concatenate([np.log(near.gain), near.offset, near.moved, near.worked])
    found = least_squares(residuals, start, loss="soft_l1", x_scale="jac", max_nfev=_TRIES)
    return made(found.x)
