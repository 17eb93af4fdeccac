"""Points in a rectangle of the picture, and the triangle that a ray hits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.workflow.view import View, in_rectangle, intersect_ray
from tests.conftest import box_surface

AHEAD = View(np.array([0.0, 0.0, -10.0]), np.eye(3), np.pi / 2, 2.0)  # along z, y down


def test_rectangle_selects_visible_points_in_front_of_the_camera():
    points = np.array(
        [[0, 0, 0], [9, 0, 0], [-9, 4, 0], [0, 0, 30], [0, 0, -20], [0, -9, 0]], float
    )
    inside = in_rectangle(points, AHEAD, np.array([0.4, 0.4]), np.array([0.6, 0.6]))
    assert inside.tolist() == [True, False, False, True, False, False]
    # 9 of 20 mm to the right of the middle in a picture 40 mm wide, 20 high, at a depth of 10.
    right = in_rectangle(points, AHEAD, np.array([0.72, 0.49]), np.array([0.73, 0.51]))
    assert right.tolist() == [False, True, False, False, False, False]
    upper = in_rectangle(points, AHEAD, np.array([0.49, 0.04]), np.array([0.51, 0.06]))
    assert upper.tolist() == [False, False, False, False, False, True]


def test_rotated_camera():
    turn = Rotation.from_euler("y", 90, degrees=True)  # looks along x
    x, y, z, w = turn.as_quat()
    camera = SimpleNamespace(position=(0, 0, 0), wxyz=(w, x, y, z), fov=np.pi / 2, aspect=1.0)
    view = View.of(camera)
    points = np.array([[10.0, 0, 0], [0, 0, 10.0], [10.0, 0, -5.0]])
    assert in_rectangle(points, view, np.zeros(2), np.ones(2)).tolist() == [True, False, True]
    right = in_rectangle(points, view, np.array([0.7, 0.4]), np.array([0.8, 0.6]))
    assert right.tolist() == [False, False, True]


def test_ray_hits_the_nearest_triangle():
    body = box_surface([0, -1, -1], [4, 1, 1])
    met = intersect_ray(
        body.vertices, body.faces, np.array([-5.0, 0.3, 0.2]), np.array([1.0, 0, 0])
    )
    assert met is not None
    face, weights = met
    assert weights @ body.vertices[body.faces[face]] == pytest.approx([0, 0.3, 0.2])
    assert (
        intersect_ray(body.vertices, body.faces, np.array([-5.0, 0, 0]), np.array([-1.0, 0, 0]))
        is None
    )
    assert (
        intersect_ray(body.vertices, body.faces, np.array([-5.0, 5, 0]), np.array([1.0, 0, 0]))
        is None
    )


def test_ray_hits_an_edge_that_two_triangles_share():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    down = np.array([0.0, 0, -1])
    for share in np.linspace(0, 1, 11):
        origin = np.array([share, 1 - share, 5.0])
        assert intersect_ray(points, triangles, origin, down) is not None
