"""A solid carved and divided by OpenCascade."""

import build123d as bd
import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.kernels import occ
from tests.support.errors import raises

BODY = bd.Box(20, 20, 20)
HALF = occ.Knife(Plane(np.zeros(3), np.eye(3)), np.zeros(3))


def corner(size):
    """A cube in the body's corner."""
    return bd.Pos(*[10 - size / 2] * 3) * bd.Box(size, size, size)


@pytest.mark.parametrize(("chip", "counts"), [(0.45, False), (0.9, True)])
def test_crumbs_are_not_parts(chip, counts):
    """A cut around the corner leaves a chip of it, 0.1 or 0.7 mm^3 large."""
    around = corner(2) - corner(chip)
    expected = 20**3 - around.volume
    if counts:
        with raises(FabricationError, "cannot-divide-solid"):
            occ.carve_and_split(BODY.wrapped, [around.wrapped], [HALF], 2, expected)
        return
    solids = occ.carve_and_split(BODY.wrapped, [around.wrapped], [HALF], 2, expected)
    assert sorted(map(occ.volume, solids)) == pytest.approx([4000 - 8, 4000])
