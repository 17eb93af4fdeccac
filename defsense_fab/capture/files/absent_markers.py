"""The rule for markers that were not visible, in files of other programs.

Exporters mark an absent position in one of four ways: NaN, an empty cell, a negative residual
(C3D), or exactly 0, 0, 0. Readers turn the first three into NaN; this module adds the fourth. A
measured position is never exactly zero in all three coordinates, so the rule loses nothing. It does
not apply to files that only this package writes (its C3D, TRC and NPZ), in which an origin is a
position; CSV and Parquet of the same columns are also written by other programs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float

MAX_LISTED = 8  # markers that a note names


def hide_absent(
    points: Float, labels: Sequence[str], sigma: Float | None = None, *, is_own: bool = False
) -> tuple[Float, list[str]]:
    """Replace absent positions by NaN.

    Args:
        points: Positions (t, m, 3); absent ones have a coordinate that is not finite, or are
            exactly 0, 0, 0.
        labels: Labels of the m markers as in the file, for the note.
        sigma: Standard deviations (t, m, 3) of the positions. Positions whose standard deviations
            are known were measured, and are kept. None if all are unknown.
        is_own: Whether this package wrote the file, so that 0, 0, 0 is a position.

    Returns:
        The positions, all coordinates NaN where absent, and a note on those that were 0, 0, 0 if
        there are any.
    """
    is_zero = (points == 0).all(axis=2) & (not is_own)
    if sigma is not None:
        is_zero &= np.isnan(sigma).any(axis=2)
    is_absent = is_zero | ~np.isfinite(points).all(axis=2)
    if is_absent.any():
        points = np.where(is_absent[..., None], np.nan, points)
    counts = is_zero.sum(axis=0)
    if not counts.any():
        return points, []
    total, frames = int(counts.sum()), len(points)
    named = [f"{labels[k]} ({counts[k]})" for k in np.flatnonzero(counts).tolist()]
    return points, [
        f"{total} position{'s are' if total > 1 else ' is'} exactly 0, 0, 0 and"
        f" count{'' if total > 1 else 's'} as not visible, in {frames} frames: {list_some(named)}"
    ]


def list_some(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    rest = len(names) - MAX_LISTED
    return ", ".join(names[:MAX_LISTED]) + (f" and {rest} more" if rest > 0 else "")
