"""Copy arrays entry by entry in compiled functions.

Where an assignment of a whole array could meet another shape, Numba also compiles the message that
names both shapes, which takes seconds. These functions use the shape of `out` and check nothing.
"""

from __future__ import annotations

from .compiled import compiled


@compiled()
def copy_row(source, out):  # type: ignore[no-untyped-def]
    """Copy the first n entries of source (m,) to out (n,)."""
    for i in range(len(out)):
        out[i] = source[i]


@compiled()
def copy_rows(source, out):  # type: ignore[no-untyped-def]
    """Copy the first m rows and n columns of source (p, q) to out (m, n)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]
