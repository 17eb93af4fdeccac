"""Array types for signatures, and small functions of arrays that many modules use.

Docstrings give shapes and units of arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


def format_point(point: Float) -> str:
    """Return a point (n,) in mm as text for messages, such as `(1.0, 2.5, 0.0)`."""
    return "(" + ", ".join(f"{x:.1f}" for x in np.round(point, 1) + 0.0) + ")"


def longest_run(values: Bool) -> slice:
    """Return the longest run of true values (n,); empty if none is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
    if not len(edges):
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    k = int((stops - starts).argmax())
    return slice(int(starts[k]), int(stops[k]))
