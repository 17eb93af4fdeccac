"""Names of parts by where they lie in the device."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ..bodies.standing import Z_UP

#: Words from low to high along what is to the right, up, and away from the viewer.
_WORDS = (("left", "right"), ("bottom", "top"), ("front", "back"))
_ORDINALS = ("second", "third", "fourth", "fifth", "sixth", "seventh")
_SAME = 0.08  # of the body's size: parts nearer than this are on one level: 13 at most


def names(centers: Sequence[Float], bounds: Float, frame: Float = Z_UP) -> list[str]:
    """A name for each part's centre of mass (3,) mm in a body with `bounds` (2, 3) mm: its number,
    counted from the bottom up, and where it lies for who sees the body as `frame` (3, 3) says
    (`geometry.bodies.standing`), as in "3-top-left"."""
    seen = frame * np.array([[1.0], [1], [-1]])
    points = np.array(centers).reshape(-1, 3) @ seen.T
    size = np.abs(frame) @ np.ptp(bounds, axis=0)
    rank = np.round(points[:, [1, 2, 0]], 3)
    order = sorted(range(len(points)), key=lambda i: tuple(rank[i]))
    words = [_levels(points[:, axis], float(size[axis]), axis) for axis in (1, 2, 0)]
    rows = list(zip(*words, strict=True))
    out = [""] * len(points)
    for n, i in enumerate(order):
        out[i] = "-".join([str(n + 1), *_told_apart(rows, i)])
    return out


def _told_apart(rows: Sequence[tuple[str, ...]], i: int) -> tuple[str, ...]:
    """As few of a part's words as tell it from all others, or all of them; "middle" where no
    other word does."""
    if len(rows) == 1:
        return ("whole",)
    sets = [c for size in (1, 2, 3) for c in itertools.combinations(range(3), size)]
    for vague in (("", "middle"), ("",)):
        for some in sets:
            own = tuple(rows[i][a] for a in some)
            alone = sum(own == tuple(r[a] for a in some) for r in rows) == 1
            if alone and not set(own) & set(vague):
                return own
    return tuple(w for w in rows[i] if w) or ("middle",)


def _levels(values: Float, size: float, axis: int) -> list[str]:
    """The word for each coordinate: levels are separated by gaps."""
    sort = np.argsort(values)
    level = np.zeros(len(values), int)
    level[sort] = np.concatenate([[0], np.cumsum(np.diff(values[sort]) > _SAME * size)])
    count = int(level.max()) + 1
    if count == 1:
        return [""] * len(values)
    words = _steps(count, *_WORDS[axis])
    return [words[k] for k in level]


def _steps(count: int, low: str, high: str) -> list[str]:
    """The words of so many levels, counted from the nearer end, as one does who looks at them."""
    if (count, low) == (4, "bottom"):
        return ["bottom", "lower-middle", "upper-middle", "top"]
    half = [_ORDINALS[k] for k in range(count // 2 - 1)]
    return [
        low,
        *(f"{n}-from-{low}" for n in half),
        *(["middle"] if count % 2 else []),
        *(f"{n}-from-{high}" for n in reversed(half)),
        high,
    ]
