"""Bodies that lie too far from the origin for the files that their parts are written to."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.errors import BodyError

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
