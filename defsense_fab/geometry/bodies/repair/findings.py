"""How places and counts are told."""

from __future__ import annotations

import numpy as np

from ....core.arrays import Float
from ....core.errors import BodyError

# Bodies that lie too far from the origin for the files that their parts are written to.

#: Of the largest size of a body. STL files hold coordinates in single precision: at 15 m they are
#: rounded by 0.001 mm, further away by more than there is room for between parts.
_FAR = 1.5


def check_near(where: str, vertices: Float, largest: float) -> None:
    """Raises BodyError where vertices (n, 3) mm lie far away for bodies of at most `largest` mm."""
    away = float(np.abs(vertices).max())
    if away > _FAR * largest:
        raise BodyError(
            f"{where}: the body reaches {away / 1000:.3g} m away from the origin, where coordinates"
            " in STL files are rounded too much; move it to the origin",
            code="far-from-origin",
            distance=away,
        )


def place(p: Float) -> str:
    """A point (3,) mm."""
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in p) + ")"


def number(count: int, one: str, many: str = "") -> str:
    """As in 1 hole, 2 holes."""
    return f"{count} {one if count == 1 else many or one + 's'}"
