"""Array types for signatures, and points as text. Docstrings give shapes and units of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


def format_point(point: Float) -> str:
    """Return a point (n,) in mm as text for messages, such as `(1.0, 2.5, 0.0)`."""
    return "(" + ", ".join(f"{x:.1f}" for x in np.round(point, 1) + 0.0) + ")"
