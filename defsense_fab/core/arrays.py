"""Array types used in signatures; shapes and units stand in each docstring."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


def xyz(point: Float) -> str:
    """A point (n,) mm as it stands in messages."""
    return "(" + ", ".join(f"{x:.1f}" for x in np.round(point, 1) + 0.0) + ")"


def places(text: str) -> list[Float]:
    """The points (3,) mm in a message, each as `xyz` has written it."""
    found = re.findall(r"\((-?\d+\.\d), (-?\d+\.\d), (-?\d+\.\d)\)", text)
    return [np.array(numbers, float) for numbers in found]
