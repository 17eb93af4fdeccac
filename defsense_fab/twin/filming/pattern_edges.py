"""Edges between the cells of a pattern: all that is needed to fill it exactly.

A picture of constant cells is the sum over edges of what changes across them; an edge between equal
cells adds nothing. Edges in line with the same change on both sides of a corner are one.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ..scenes.scene import WHITE


def pieces(pattern: NDArray[np.uint8], margin: float, reach: float) -> tuple[Float, Float]:
    """Of a pattern (r, c) in its white margin: segments (k, 2, 2) no longer than `reach`, in cells
    to the right and downwards from its upper left corner, and (k, 3) the weights with which they
    count in the picture's values, in its cover, and in that of the pattern alone. A weight is
    added to what lies to the right of a segment that goes down."""
    return _pieces(pattern.tobytes(), pattern.shape, float(margin), float(reach))


@lru_cache(maxsize=4096)
def _pieces(
    data: bytes, shape: tuple[int, int], margin: float, reach: float
) -> tuple[Float, Float]:
    segments, weights = _edges(data, shape, margin)
    length = np.abs(segments[:, 1] - segments[:, 0]).max(-1)
    count = np.maximum(np.ceil(length / reach - 1e-9), 1).astype(np.int64)
    of = np.repeat(np.arange(len(segments)), count)
    first = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    at = np.stack([first, first + 1], axis=1) / count[of, None]
    start, along = segments[of, :1], segments[of, 1:] - segments[of, :1]
    return start + at[:, :, None] * along, weights[of]


@lru_cache(maxsize=1024)
def _edges(data: bytes, shape: tuple[int, int], margin: float) -> tuple[Float, Float]:
    rows, columns = shape
    cells = np.pad(np.frombuffer(data, np.uint8).reshape(shape).astype(float), 1,
                   constant_values=WHITE)  # fmt: skip
    found: list[tuple[float, float, float, float, float]] = []
    for j, change in enumerate((cells[1:-1, 1:] - cells[1:-1, :-1]).T):
        found += [(j, a, j, b, w) for a, b, w in _runs(change)]
    for i, change in enumerate(cells[:-1, 1:-1] - cells[1:, 1:-1]):
        found += [(a, i, b, i, w) for a, b, w in _runs(change)]
    inner = np.array(found).reshape(-1, 5)
    frames = [_frame(rows, columns, m) for m in (margin, 0.0)]
    segments = np.concatenate([inner[:, :4], *frames]).reshape(-1, 2, 2)
    weights = np.zeros((len(segments), 3))
    weights[:-8, 0] = inner[:, 4]
    weights[-8:-4] = WHITE, 1.0, 0.0
    weights[-4:, 2] = 1.0
    return segments, weights


def _frame(rows: int, columns: int, margin: float) -> Float:
    low, right, foot = -margin, columns + margin, rows + margin
    return np.array(
        [[low, low, low, foot], [low, foot, right, foot],
         [right, foot, right, low], [right, low, low, low]]
    )  # fmt: skip


def _runs(change: Float) -> list[tuple[int, int, float]]:
    """Stretches (from, to, value) of equal values other than zero."""
    ends = np.flatnonzero(np.diff(change, prepend=np.nan, append=np.nan) != 0)
    return [(int(a), int(b), float(change[a])) for a, b in pairwise(ends) if change[a] != 0]
