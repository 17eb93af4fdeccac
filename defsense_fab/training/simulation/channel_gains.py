"""How a built device's channels differ from those that a map was made for: by gain and offset.

The map stays; s -> (s - offset)/gain is found so that the markers come out where cameras saw them,
with gains expected near one and offsets near zero (Gauss-Newton, robust). c channels have 2c
numbers: a few dozen pictures tell them.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Float
from ...decoding.input_features import InputDecoder

#: Standard deviations that gains and offsets are expected to have.
GAIN_SPREAD, OFFSET_SPREAD = 0.15, 0.02
_FEW = 500  # pictures that are looked at
_ERROR = 1.0  # mm, of the map itself


def fit_gains(decoder: InputDecoder, signals: Float, points: Float) -> tuple[Float, Float]:
    """Gains and offsets (c,) of signals (t, c) for a static decoder, by markers (t, m, 3) mm in the
    device's frame, NaN in gaps."""
    c = signals.shape[1]
    step = max(len(signals) // _FEW, 1)
    s, p = signals[::step], points[::step].reshape(len(signals[::step]), -1)
    known = np.isfinite(p)
    scale = _ERROR * np.sqrt(known.sum() / max(len(s), 1) / 3)  # a picture counts once

    def residuals(x: Float) -> Float:
        guess = decoder((s - x[c:]) / np.exp(x[:c]))
        off = np.where(known, guess - np.where(known, p, 0.0), 0.0)[known] / scale
        return np.concatenate([off, x[:c] / GAIN_SPREAD, x[c:] / OFFSET_SPREAD])

    found = least_squares(residuals, np.zeros(2 * c), loss="soft_l1", x_scale="jac")
    return np.exp(found.x[:c]), np.asarray(found.x[c:])
