"""A solid carved and divided by OpenCascade."""

import build123d as bd
import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.kernels.cutting_tools import cylinder
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


def test_a_failed_cut_is_reported_in_words():
    """Tools that leave nothing of the body once ended on a list without items."""
    cover = bd.Box(40, 40, 40)
    with raises(FabricationError, "cannot-divide-solid"):
        occ.carve_and_split(BODY.wrapped, [cover.wrapped], [HALF, HALF], 2, 8000.0)


def test_division_survives_operations_that_destroy_their_operands(monkeypatch):
    """Joining faces after a cut makes nothing of some solids."""
    cut = bd.Solid.cut

    def destructive_cut(self, *tools):
        return cut(self, *tools) if not bd.SkipClean.clean else bd.Compound(children=[])

    monkeypatch.setattr(bd.Solid, "cut", destructive_cut)
    tool = corner(2)
    solids = occ.carve_and_split(BODY.wrapped, [tool.wrapped], [HALF], 2, 8000 - 8.0)
    assert sorted(map(occ.volume, solids)) == pytest.approx([4000 - 8, 4000])
    hole = cylinder(np.array([0, 0, -20.0]), np.array([0, 0, 20.0]), 4.0)
    assert occ.volume(occ.cut_out(BODY.wrapped, [hole])) == pytest.approx(8000 - np.pi * 4 * 20)
    assert bd.SkipClean.clean


@pytest.mark.slow
def test_large_curved_bodies_have_fewer_facets_within_the_tolerance():
    ring = bd.Torus(50, 9).solids()[0].wrapped
    surface = occ.tessellate(ring, 0.05)
    assert len(surface.faces) <= occ.MAX_FINE_FACETS
    assert surface.volume == pytest.approx(occ.volume(ring), rel=occ.MAX_FACET_LOSS)
    around = np.hypot(surface.vertices[:, 0], surface.vertices[:, 1]) - 50
    middles = surface.vertices[surface.faces].mean(1)
    depth = 9 - np.hypot(np.hypot(middles[:, 0], middles[:, 1]) - 50, middles[:, 2])
    assert np.hypot(around, surface.vertices[:, 2]) == pytest.approx(9, abs=1e-5)
    assert depth.max() < 0.05
    again = occ.tessellate(ring, 0.05)
    assert np.array_equal(again.faces, surface.faces)
