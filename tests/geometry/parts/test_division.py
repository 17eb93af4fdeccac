"""The order in which a body is divided, and in which it is therefore assembled."""

import math

import manifold3d as m3
import numpy as np
import pytest

from defsense_fab.geometry.channels.channel_ends import Pockets
from defsense_fab.geometry.channels.cord_channels import make_channels
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.kernels.triangle_kernel import find_film
from defsense_fab.geometry.parts.division import cut_orders, plan_division
from defsense_fab.geometry.parts.piece_opening import PieceOpener, make_thread
from tests.geometry.parts.cords import cord

ALONG = [[2, 0], [50, 0], [100, 0], [148, 0]]


@pytest.mark.parametrize("through", [True, False])
def test_short_cord_lies_in_one_joint_and_long_one_in_two(bar, through):
    """30 mm across the bar, through the upper one of two planes of 150 mm along it."""
    cords = [
        cord("high", [0, 0, 1], [0, 10, 1], [1, 0, 0], ALONG),
        cord("low", [0, 0, 1], [0, 10, -11], [1, 0, 0], ALONG),
        cord("short", [1, 0, 0], [75, 0, 0], [0, 1, 0], [[-13, -6], [0, 0], [13, 9]]),
    ]
    channels = make_channels(cords, bar, 2.2, 1.0, Pockets(2.75, 7.0))
    assert channels[2].between < 34 < channels[0].between
    body = triangle_kernel.to_manifold(bar, "bar")

    def parts_and_joints(across):
        planned = plan_division(body, channels, 1.1, 1.0, 0.15, False, through, across)
        return len(planned.leaves), [sum(k in c.cords for c in planned.cuts) for k in range(3)]

    assert parts_and_joints(0.0) == (5, [1, 1, 2])
    assert parts_and_joints(34.0) == (5, [2, 1, 1])


@pytest.mark.parametrize("planes", range(1, 8))
def test_all_orders_of_few_planes_and_one_of_many(planes):
    orders = cut_orders(planes)
    assert orders[0] == tuple(range(planes))
    assert {tuple(sorted(o)) for o in orders} == {tuple(range(planes))}
    assert len(orders) == len(set(orders)) == (math.factorial(planes) if planes <= 4 else 1)


def test_planes_of_short_cords_are_cut_first_among_many():
    assert cut_orders(6, [4, 1]) == [(0, 1, 2, 3, 4, 5), (4, 1, 0, 2, 3, 5)]


@pytest.fixture
def grip():
    """An oval handle, flat at the back, on a round foot."""
    oval = m3.CrossSection.circle(1.0, 128).scale((18.0, 13.0))
    flat = m3.CrossSection.square((80.0, 40.0)).translate((-40.0, 6.5))
    return m3.Manifold.extrude(oval - flat, 110.0) + m3.Manifold.cylinder(10.0, 32.0, 32.0, 128)


def test_parts_end_where_they_are_cut(grip):
    """The slanted plane of B also cuts the foot, but only the handle comes off."""
    along = [[0, 0], [8, 0], [24, -1.5], [45, -1.8], [63, -1.9], [82, -1.4], [98, 0], [106, 0]]
    across = [[0, 0], [6.7, 0], [11.6, -1.3], [16.7, -1.5], [23.2, -1.6], [33.6, 0], [40.3, 0]]
    cords = [
        cord("A", [-0.121, -0.9926, -0.002], [1, -10.3, 2], [-0.014, -0.0003, 1], along),
        cord("B", [-0.7009, -0.13, 0.7013], [12.8, 3, 45], [-0.7049, -0.0234, -0.7089], across),
    ]
    surface = triangle_kernel.to_surface(grip)
    channels = make_channels(cords, surface, 2.2, 1.0, Pockets(2.75, 7.0))
    planned = plan_division(grip, channels, 1.1, 1.0, 0.15, through=True)
    assert len(planned.leaves) == 3
    foot = next(p for p in planned.leaves if p.bounding_box()[4] > 30)
    assert foot.bounding_box()[5] == pytest.approx(50, abs=2)
    for leaf in planned.leaves:
        assert leaf.volume() > 1000
        assert len(leaf.decompose()) == 1
        assert find_film(leaf, np.array([0, 0, -1.0]), 30, allowed=2.0) is None


@pytest.mark.parametrize(
    ("height", "tilt", "margin"),
    [
        (-2.0, (0.3, 0.7, 13.7), None),
        (-2.0, (0.3, 0.7, 13.7), 45.0),
        (-2.0, (0.3, 0.7, 13.7), 40.0),  # to the middle of the other leg
        (-0.005, (0.0, 0.0, 13.7), None),
        (-0.005, (0.0, 0.0, 13.7), 45.0),
        (0.0, (0.0, 0.0, 0.0), None),
    ],
)
def test_one_leg_of_two_comes_off(height, tilt, margin):
    """A bar at z = 0 on two round legs; the plane of the cord is horizontal."""
    leg = m3.Manifold.cylinder(20.0, 9.0, 9.7, 64).translate((-20.0, 0.0, -20.0))
    bar = m3.Manifold.cube((60.0, 20.0, 10.0)).translate((-30.0, -10.0, 0.0))
    body = (leg + leg.translate((40.0, 0.0, 0.0)) + bar).rotate(tilt)
    middle = leg.rotate(tilt).bounding_box()
    x, y = (middle[0] + middle[3]) / 2, (middle[1] + middle[4]) / 2
    sensor = cord("A", [0, 0, 1], [x, y, height], [0, 1, 0], [[-6, 0], [6, 0]])
    line = np.array([[x, y + dy, height] for dy in np.linspace(-6, 6, 7)])
    thread = make_thread([line], sensor.plane.normal)
    halves = PieceOpener([sensor.plane], [[0]], [thread], margin, 0.15).open(body, 0).halves
    (taken,), (rest,) = halves.below, halves.above
    assert halves.taken == (taken,)
    expected = body.trim_by_plane((0.0, 0.0, -1.0), -height).decompose()[0].volume()
    assert taken.volume() == pytest.approx(expected, rel=1e-3)
    assert rest.volume() == pytest.approx(body.volume() - taken.volume(), abs=0.5)
    assert find_film(rest, np.array([0, 0, -1.0]), 30, allowed=0.5) is None
