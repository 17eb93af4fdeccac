"""Stretches of a section whose deformation is known exactly."""

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.errors import LayoutError
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.workflow.design.body_section import BodySection, Quantity, directions_along
from tests.conftest import box_surface
from tests.support.errors import raises

A = np.array([[0.10, 0.20, 0.00], [0.00, -0.05, 0.03], [0.02, 0.00, 0.04]])
B = np.array([[-0.08, 0.00, 0.05], [0.10, 0.00, 0.00], [0.00, 0.06, 0.12]])
PLANE = Plane.from_normal(np.array([1.0, 0.5, 0.2]), np.array([0.1, -1.0, 0.3]), np.eye(3)[0])
ALONG = np.array([0.6, 0.0, -1.1])


@pytest.fixture(scope="module")
def body():
    """A box of 30 x 20 x 10 mm; at rest, and under two affine maps."""
    mesh = tetrahedralize(box_surface([-15, -10, -5], [15, 10, 5]), 6.0).mesh
    quadratic = QuadraticMesh.from_linear(mesh)
    fields = np.stack([quadratic.nodes @ m.T for m in (A, B)])
    return BodySection(PointLocator(quadratic), fields, ("rest", "a@1", "b@1"))


def stretches(m):
    return np.linalg.svd(np.eye(3) + m, compute_uv=False)


def length(m):
    return np.linalg.norm((np.eye(3) + m) @ ALONG) / np.linalg.norm(ALONG)


def test_stretches_of_an_affine_field_are_exact(body):
    at = body.cut(PLANE).subdivide(3.0).at
    for state, m in enumerate((np.zeros((3, 3)), A, B)):
        for kind, expected in (
            ("along", length(m)),
            ("largest", stretches(m)[0]),
            ("smallest", stretches(m)[2]),
        ):
            found = body.values(at, Quantity(kind), state, ALONG)
            np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_variance_over_rest_and_two_states_is_exact(body):
    at = body.cut(PLANE).at
    for kind, values in (
        ("along", [1.0, length(A), length(B)]),
        ("largest", [1.0, stretches(A)[0], stretches(B)[0]]),
    ):
        quantity = Quantity(kind, variance=True)
        expected = np.mean((np.array(values) - np.mean(values)) ** 2)
        np.testing.assert_allclose(body.values(at, quantity, 1, ALONG), expected, atol=1e-14)
        assert body.spread(quantity, None, ALONG) == pytest.approx(expected, abs=1e-14)


def test_a_range_covers_all_states_or_one(body):
    quantity = Quantity("along")
    far = [abs(length(m) - 1) for m in (A, B)]
    assert body.spread(quantity, 1, ALONG) == pytest.approx(far[0])
    assert body.spread(quantity, None, ALONG) == pytest.approx(max(far))
    assert body.span(quantity, 1, ALONG) == pytest.approx((length(A), length(A)))
    ends = [1.0, length(A), length(B)]
    assert body.span(quantity, None, ALONG) == pytest.approx((min(ends), max(ends)))


def test_a_section_moves_with_the_state(body):
    section = body.cut(PLANE)
    moved = body.positions(section.at, section.points, 2)
    np.testing.assert_allclose(moved, section.points @ (np.eye(3) + B).T, atol=1e-9)
    np.testing.assert_allclose(body.carried(section.points, 2), moved, atol=1e-9)
    np.testing.assert_array_equal(body.positions(section.at, section.points, 0), section.points)


def test_the_grid_lies_in_the_plane_and_inside(body):
    points, at = body.grid(PLANE, 0.5)
    np.testing.assert_allclose((points - PLANE.origin) @ PLANE.normal, 0, atol=1e-9)
    assert (np.abs(points) <= np.array([15, 10, 5]) + 1e-6).all()
    assert len(at.cell) == len(points) == pytest.approx(body.cut(PLANE).area * 4, rel=0.05)


def test_half_a_body_lies_behind_the_plane(body):
    vertices, faces = body.half(PLANE)
    assert ((vertices[faces] - PLANE.origin) @ PLANE.normal).max() < 1e-6
    assert len(faces) > 10


def test_a_plane_outside_the_body_is_refused(body):
    beyond = Plane.from_normal(np.array([0, 0, 9.0]), np.eye(3)[2], np.eye(3)[0])
    with raises(LayoutError, "plane-misses-body") as caught:
        body.cut(beyond)
    assert caught.value.data["distance"] == pytest.approx(-4.0)
    below = Plane.from_normal(np.array([-17.0, 0, 0]), np.eye(3)[0], np.eye(3)[1])
    with raises(LayoutError, "plane-misses-body") as caught:
        body.cut(below)
    assert caught.value.data["distance"] == pytest.approx(2.0)


def test_directions_follow_a_cord():
    path = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0], [3, 2, 0], [3, 3, 0]])
    found = directions_along(path, np.array([[1.0, 0.4, 0.3], [3.3, 2.1, 0]]))
    np.testing.assert_allclose(found, [[1, 0, 0], [0, 1, 0]])
