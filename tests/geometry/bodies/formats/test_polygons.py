"""Faces of more than three corners are divided within their outline."""

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.formats.polygons import divide_faces, divide_rows
from tests.support.errors import raises

GRIPPER = np.array([[0, 0], [120, 0], [120, 20], [20, 20], [20, 60], [120, 60], [120, 80], [0, 80]])
COLLINEAR = np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [2, 1], [1, 1], [0, 1]])
#: A square with a square hole, whose outline goes to the hole and back.
KEYHOLE = np.array(
    [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0], [3, 3], [3, 6], [6, 6], [6, 3], [3, 3]]
)


def in_space(outline):
    """Place an outline in a plane that is not parallel to any axis."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return np.c_[outline, np.zeros(len(outline))] @ turn.T + [5, 6, 7]


def areas_along_normal(points, triangles):
    x = points[triangles]
    crosses = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) / 2
    normal = crosses.sum(0)
    return crosses @ normal / np.linalg.norm(normal)


@pytest.mark.parametrize(
    ("outline", "area"),
    [(GRIPPER, 5600), (COLLINEAR, 3), (KEYHOLE, 91)],
    ids=["concave", "line", "hole"],
)
@pytest.mark.parametrize("is_reversed", [False, True])
def test_triangles_cover_the_outline_once_from_any_corner(outline, area, is_reversed):
    points = in_space(outline)
    for start in range(len(points)):
        corners = np.roll(np.arange(len(points)), start)[:: -1 if is_reversed else 1]
        triangles = divide_faces(points, corners, np.array([len(points)]))
        areas = areas_along_normal(points, triangles)
        assert len(triangles) == len(points) - 2
        assert areas.min() > 1e-9
        assert areas.sum() == pytest.approx(area)


def test_a_quadrangle_with_a_reflex_corner_is_divided_there():
    points = in_space(np.array([[0, 0], [10, 10], [0, 3], [-10, 10]]))
    for start in range(4):
        triangles = divide_faces(points, np.roll(np.arange(4), start), np.array([4]))
        assert all({0, 2} <= set(t) for t in triangles.tolist())


def test_faces_keep_their_order_and_triangles_their_corners():
    points = in_space(GRIPPER)
    corners = np.array([2, 1, 0, 0, 1, 2, 7, 6, 0, 3])
    triangles = divide_faces(points, corners, np.array([3, 4, 3]))
    assert triangles[0].tolist() == [2, 1, 0]
    assert triangles[3].tolist() == [6, 0, 3]
    assert divide_rows(points, [corners[:6].reshape(2, 3)]).tolist() == [[2, 1, 0], [0, 1, 2]]


def test_a_face_without_area_or_numbers_is_divided_without_error():
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [np.nan, 0, 0], [1e300, 1e300, 0]]
    )
    assert len(divide_faces(points, np.array([0, 1, 2, 3]), np.array([4]))) == 2
    assert len(divide_faces(points, np.array([0, 1, 4, 5]), np.array([4]))) == 2


def test_wrong_faces_are_refused_with_their_line():
    points = in_space(GRIPPER)
    with raises(BodyError, "vertex-missing", line=12, face=2):
        divide_faces(points, np.array([0, 1, 2, 3, 4, 8]), np.array([3, 3]), [10, 12].__getitem__)
    with raises(BodyError, "vertex-missing", line=None, face=1):
        divide_faces(points, np.array([0, 1, -1]), np.array([3]))
    with raises(BodyError, "face-too-few-corners", face=2):
        divide_faces(points, np.array([0, 1, 2, 0, 1]), np.array([3, 2]))


def test_thousands_of_concave_faces_are_divided_quickly():
    import time

    points = np.concatenate([in_space(GRIPPER + k) for k in range(5000)])
    started_at = time.process_time()
    divide_faces(points, np.arange(len(points)), np.full(5000, 8))
    assert time.process_time() - started_at < 5
