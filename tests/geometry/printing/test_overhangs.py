"""Overhangs of parts as they are printed, against areas in closed form.

`DEFSENSE_VARIANTS=1000` measures that many bodies in place of the few of the suite.
"""

from __future__ import annotations

import os

import manifold3d as m3
import numpy as np
import pytest

from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.printing.overhangs import MAX_BRIDGE_MM, MAX_SLOPE_DEG, measure_overhang
from defsense_fab.geometry.printing.print_bed import choose_side_down

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "60"))
DOWN = np.array([0, 0, -1.0])
SLOPE = np.radians(MAX_SLOPE_DEG)


def box(*size):
    return m3.Manifold.cube(list(size), True)


def cylinder_along_y(radius, length, sides=720):
    return m3.Manifold.cylinder(length, radius, radius, sides, True).rotate([90, 0, 0])


def tunnel(radius, length):
    """Return a block on the bed with a half-round tunnel along y."""
    block = box(2 * radius + 10, length, radius + 10).translate([0, 0, (radius + 10) / 2])
    return block - cylinder_along_y(radius, 2 * length)


def bridge(span, length, height=20.0):
    """Return a level bridge on two piers, open below along y."""
    block = box(span + 20, length, height + 10).translate([0, 0, (height + 10) / 2])
    return block - box(span, 2 * length, 2 * height)


def ring(radius=50.0, tube=9.0, turns=256):
    """Return half a ring about y, which stands on its two ends."""
    circle = m3.CrossSection.circle(tube, 96).translate([radius, 0])
    return circle.revolve(turns, 360).rotate([90, 0, 0]).split_by_plane([0, 0, 1], 0)[0]


def turned(solid, rng):
    """Return a solid turned at random, and where its bed is then."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    return solid.transform(np.column_stack([q, rng.normal(size=3)])), q @ DOWN


def test_a_box_needs_no_supports():
    assert measure_overhang(box(80, 30, 10), DOWN).area == 0


@pytest.mark.parametrize("radius", [6.0, 23.0])
def test_the_ceiling_of_a_tunnel_is_measured(radius):
    overhang = measure_overhang(tunnel(radius, 100), DOWN)
    assert overhang.area == pytest.approx(2 * SLOPE * radius * 100, rel=0.01)
    assert overhang.height == pytest.approx(radius, rel=1e-3)
    # Between the ceiling and the bed: a sector of the circle without the slopes beside it.
    section = radius**2 * (SLOPE + np.sin(SLOPE) * np.cos(SLOPE))
    assert overhang.volume == pytest.approx(section * 100, rel=0.01)
    assert overhang.point == pytest.approx([0, 0, overhang.height], abs=0.05 * radius)


def test_an_arch_needs_supports_at_its_top_only():
    """The underside of a half ring: within 30 degrees of level about its highest point."""
    radius, tube = 50.0, 9.0
    overhang = measure_overhang(ring(radius, tube), DOWN)
    steps = np.radians(np.linspace(-90, 90, 1801))
    u, v = np.meshgrid(steps, steps)  # along the ring, from its top; around the tube, from inside
    is_level = np.cos(u) * np.cos(v) > np.cos(SLOPE)
    area = (tube * (radius - tube * np.cos(v)) * is_level).sum() * np.radians(0.1) ** 2
    assert overhang.area == pytest.approx(area, rel=0.03)
    assert overhang.height == pytest.approx(radius - tube * np.cos(SLOPE), abs=0.3)


@pytest.mark.parametrize(("span", "needs_supports"), [(4.8, False), (5.4, True), (40.0, True)])
def test_printers_bridge_narrow_gaps(span, needs_supports):
    area = measure_overhang(bridge(span, 30), DOWN).area
    assert area == pytest.approx(30 * span if needs_supports else 0)


@pytest.mark.parametrize(("width", "needs_supports"), [(2.4, False), (2.8, True)])
def test_ledges_reach_half_as_far(width, needs_supports):
    ledge = box(width, 30, 5).translate([20 + width / 2, 0, 17.5])
    solid = box(40, 30, 40) + ledge
    area = measure_overhang(solid, DOWN).area
    assert area == pytest.approx(30 * width if needs_supports else 0)


def test_slender_beams_need_supports_over_their_span():
    assert measure_overhang(bridge(40, 2), DOWN).area == pytest.approx(80)


def test_a_slope_from_the_bed_is_supported_at_its_foot():
    """Faces that rise from the bed at 10 degrees: a narrow one prints, a wide one does not."""
    for width, needs_supports in ((2.4, False), (20.0, True)):
        rise = width * np.tan(np.radians(10))
        if needs_supports:
            outline = [[0, 0], [10, 0], [10 + width, rise], [10 + width, 30], [0, 30]]
        else:  # the same foot is high enough above the bed to count
            outline = [[0, 0], [10, 0], [10, 1], [10 + width, 1 + rise], [10 + width, 30], [0, 30]]
        solid = m3.Manifold.extrude(m3.CrossSection([outline]), 40).rotate([90, 0, 0])
        area = 40 * width / np.cos(np.radians(10)) if needs_supports else 0
        assert measure_overhang(solid, DOWN).area == pytest.approx(area)


def test_rounded_edges_on_the_bed_need_no_supports():
    assert measure_overhang(cylinder_along_y(9, 60), DOWN).area == 0


@pytest.mark.slow
def test_measures_do_not_depend_on_the_orientation_of_the_body():
    rng = np.random.default_rng(0)
    for _ in range(VARIANTS):
        span, length = rng.uniform(1, 60, 2)
        radius = rng.uniform(1, 40)
        solid, down = turned(bridge(span, length), rng)
        beyond = (span - MAX_BRIDGE_MM) * length
        if not 0 < beyond < 10:  # else it is small
            area = span * length if beyond > 0 else 0
            assert measure_overhang(solid, down).area == pytest.approx(area, rel=1e-6)
        solid, down = turned(tunnel(radius, length), rng)
        width = 2 * radius * np.sin(SLOPE)
        if abs(width - MAX_BRIDGE_MM) > 0.2 and not 0 < (width - MAX_BRIDGE_MM) * length < 10:
            area = 2 * SLOPE * radius * length if width > MAX_BRIDGE_MM else 0
            assert measure_overhang(solid, down).area == pytest.approx(area, rel=0.03)


def test_an_arch_lies_on_its_flatter_side():
    surface = triangle_kernel.to_surface(ring())
    down = choose_side_down(surface, [DOWN])
    assert np.ptp(surface.vertices @ down) == pytest.approx(18, abs=0.1)
    assert measure_overhang(ring(), down).area == 0


@pytest.mark.parametrize("solid", [tunnel(23, 100), tunnel(4, 30), box(80, 30, 60)])
def test_a_part_without_a_lower_side_lies_on_its_cut_face(solid):
    assert choose_side_down(triangle_kernel.to_surface(solid), [DOWN]) is DOWN


@pytest.mark.parametrize("seed", range(5))
def test_overhangs_of_cut_faces_and_of_skin_are_kept_apart(seed):
    solid, down = turned(bridge(40, 30), np.random.default_rng(seed))
    offset = float(down @ measure_overhang(solid, down).point)
    under, away = (down, offset), (down, offset + 0.1)
    skin, cut = measure_overhang(solid, down), measure_overhang(solid, down, [away, under])
    assert (skin.face, skin.cut_area) == ("skin", 0)
    assert cut.face == "cut face"
    assert cut.cut_area == pytest.approx(cut.area) == pytest.approx(1200)
    assert measure_overhang(solid, down, [away, (-down, -offset)]).face == "skin"
    two = bridge(40, 30) + bridge(40, 30, 25.0).translate([70, 0, 0])
    both = measure_overhang(two, DOWN, [(DOWN, -20.0)])
    assert (both.face, both.cut_area) == ("skin and cut face", pytest.approx(1200))


def test_grooves_do_not_turn_a_part_over():
    """A groove 6 mm wide with a level ceiling is no overhang of the skin."""
    block = box(60, 30, 40)
    grooved = triangle_kernel.to_surface(block - box(70, 6, 4).translate([0, 0, -20]))
    assert choose_side_down(grooved, [DOWN], block) is DOWN
    assert choose_side_down(grooved, [DOWN]) is not DOWN
