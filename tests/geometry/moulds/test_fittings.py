"""Keys and screws between two pieces of a mould."""

import manifold3d as m3
import numpy as np
import pytest

from defsense_fab.geometry.moulds.fittings import join_pieces

UP, ORIGIN = np.array([0, 0, 1.0]), np.zeros(3)
BELOW = m3.Manifold.cube([60, 40, 20], True).translate([0, 0, -10])
NOTHING = m3.Manifold()


def block(height):
    return m3.Manifold.cube([60, 40, height], True).translate([0, 0, height / 2])


@pytest.mark.parametrize("height", [4.0, 8.0, 31.0])
def test_a_screw_of_10_mm_holds_pieces_of_any_height(height):
    """Its head has room down to a seat over the plane, and it grips the piece below."""
    joint = join_pieces(block(height), BELOW, NOTHING, UP, ORIGIN, UP, 0.1)
    assert joint.screws >= 2

    def holes(piece, at, radius):
        """How many round holes of the radius there are in the piece at a height."""
        outlines = piece.slice(at).to_polygons()
        areas = [abs(float(m3.CrossSection([p[::-1]]).area())) for p in outlines]
        return sum(a == pytest.approx(np.pi * radius**2, rel=0.02) for a in areas)

    heights = np.arange(0.05, height, 0.1)
    narrow = [z for z in heights if holes(joint.above, z, 1.7) >= joint.screws]
    wide = [z for z in heights if holes(joint.above, z, 3.3) >= joint.screws]
    assert {*narrow, *wide} == {*heights}
    seat = narrow[-1] + 0.05
    assert not wide or wide[0] > seat
    assert 2.9 < 8 - seat < 10 - seat < 7  # of screws of 8 and of 10 mm; the pilot hole has 7
    assert holes(joint.below, -6.9, 1.25) == joint.screws


def test_no_screw_crosses_the_cast():
    """Over the seats, between the heights at which a piece is looked at, and below."""
    for z in (15.0, -5.0):
        slab = m3.Manifold.cube([70, 50, 0.5], True).translate([0, 0, z])
        assert join_pieces(block(31.0), BELOW, slab, UP, ORIGIN, UP, 0.1).screws == 0


@pytest.mark.parametrize("edge", np.arange(-21.0, 10.0, 2.5))
@pytest.mark.parametrize("z", [15.0, -5.0])
def test_screws_leave_a_wall_to_the_cast(edge, z):
    slab = m3.Manifold.cube([100, 50, 0.5]).translate([edge, -25, z])
    joint = join_pieces(block(31.0), BELOW, slab, UP, ORIGIN, UP, 0.1)
    assert joint.screws >= 1
    taken = (block(31.0) - joint.above) if z > 0 else (BELOW - joint.below)
    assert taken.min_gap(slab, 10.0) > 1.35  # of 1.4 with circles of 32 sides
