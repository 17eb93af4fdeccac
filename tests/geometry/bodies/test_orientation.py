"""Detected orientation of bodies."""

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.orientation import Y_UP, Z_UP, viewing_axes
from tests.conftest import box_surface


def turned(profile, around=24):
    """A body of revolution about z, of heights and radii (k, 2), closed at both ends."""
    heights, radii = np.array(profile, float).T
    angle = np.arange(around) * 2 * np.pi / around
    rings = np.stack(
        [np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)),
         np.repeat(heights[:, None], around, axis=1)], axis=-1,
    ).reshape(-1, 3)  # fmt: skip
    n, faces = len(rings), []
    for j in range(around):
        k = (j + 1) % around
        for i in range(len(heights) - 1):
            a, b, c, d = (r * around + s for r, s in ((i, j), (i, k), (i + 1, k), (i + 1, j)))
            faces += [(a, b, c), (a, c, d)]
        faces += [(n, k, j), (n + 1, n - around + j, n - around + k)]
    ends = [[0, 0, heights[0]], [0, 0, heights[-1]]]
    return Surface(np.concatenate([rings, ends]), np.array(faces))


def y_up(surface):
    """The same with its z along y, and its front, that was at low y, at high z."""
    return Surface(surface.vertices @ np.array(Z_UP).T, surface.faces)


FIGURE = turned([(0, 20), (60, 16), (90, 8), (110, 18), (128, 3)])
EGG = turned([(0, 2), (8, 17), (30, 24), (60, 17), (74, 2)])
PIN = turned([(0, 0.5), (10, 9), (90, 12), (109, 7), (118, 0.5)])


@pytest.mark.parametrize("body", [FIGURE, PIN], ids=["on a flat foot", "tall, on no foot"])
def test_figures_stand_in_either_convention(body):
    assert (viewing_axes(body) == Z_UP).all()
    assert (viewing_axes(y_up(body)) == Y_UP).all()


@pytest.mark.parametrize(
    "body",
    [
        box_surface([0, -15, -15], [150, 15, 15]),
        box_surface([-15, -15, 0], [15, 15, 150]),
        box_surface([0, 0, 0], [70, 80, 10]),
        EGG,
        box_surface([0, 0, 0], [60, 60, 60]),
    ],
    ids=["lying", "tall", "flat", "egg", "cube"],
)
def test_up_is_z_by_default(body):
    assert (viewing_axes(body) == Z_UP).all()


def test_long_bodies_are_seen_from_their_long_side():
    right, up, back = viewing_axes(box_surface([-15, 0, -15], [15, 150, 15]))
    assert right.tolist() == [0, 1, 0]
    assert up.tolist() == [0, 0, 1]
    assert back.tolist() == [1, 0, 0]
    # An animal with y up, long in z.
    body = y_up(FIGURE)
    long = Surface(body.vertices * [1, 1, 4], body.faces)
    right, up, back = viewing_axes(long)
    assert up.tolist() == [0, 1, 0]
    assert abs(right[2]) == 1
    assert np.cross(right, up).tolist() == back.tolist()
