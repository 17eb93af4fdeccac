"""Arrays copied entry by entry in compiled functions.

Where an assignment as a whole could meet another shape, Numba compiles the message that tells both
shapes with it, which takes seconds. These take the shape of `out`, and check nothing.
"""

from __future__ import annotations

from .compiled import compiled


@compiled()
def copy_row(source, out):  # type: ignore[no-untyped-def]
    """Copy the first n entries of source (m,) into out (n,)."""
    for i in range(len(out)):
        out[i] = source[i]


@compiled()
def copy_rows(source, out):  # type: ignore[no-untyped-def]
    """Copy the first rows and columns of source (p, q) into out (m, n)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]
