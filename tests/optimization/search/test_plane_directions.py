"""Check simple directions of planes, and layouts in such planes."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from defsense_fab.core.curve import Plane
from defsense_fab.core.mesh import Surface
from defsense_fab.optimization.search.plane_directions import count_slanted, face_directions
from tests.optimization.conftest import search


def surface(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def test_directions_are_those_of_large_flat_faces():
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    box = trimesh.creation.box([80.0, 50.0, 3.0])
    box.vertices = box.vertices @ turn.T
    found = face_directions(surface(box))
    assert np.abs(found @ turn) == pytest.approx(np.eye(3)[[2, 1, 0]], abs=1e-9)


def test_a_body_without_flat_faces_uses_the_coordinate_axes():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20)
    assert (face_directions(surface(ball)) == np.eye(3)).all()


def test_perpendicular_axes_complete_the_directions_of_faces():
    """A rod has only flat ends; a thin wedge has two faces."""
    rod = trimesh.creation.cylinder(15.0, 100.0, sections=96)
    assert np.abs(face_directions(surface(rod))) == pytest.approx(np.eye(3)[[2, 0, 1]], abs=1e-9)
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    rod.vertices = rod.vertices @ turn.T
    found = face_directions(surface(rod))
    assert found @ found.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.abs(found[0] @ turn[:, 2]) == pytest.approx(1.0)
    corners = trimesh.creation.box([100.0, 100.0, 3.0]).vertices
    corners[:, 2] *= np.where(corners[:, 0] > 0, 0.1, 1.0)  # sides of 3 % count for nothing
    found = face_directions(surface(trimesh.convex.convex_hull(corners)))
    assert len(found) == 4  # two faces nearly parallel to each other, two axes
    assert np.abs(found[2:] @ found[0]) == pytest.approx([0, 0], abs=1e-9)


def test_a_scan_has_no_flat_faces():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=20)
    ball.vertices[:, 2] *= 1.3
    assert (face_directions(surface(ball)) == np.eye(3)).all()


def test_a_drawing_does_not_replace_planes_along_the_faces(problem):
    """The drawing may be better; it competes separately."""
    drawn = search(problem, extra=1, candidates=2000).sensors
    normals = np.array([[0.0, 0.6, 0.8]])
    found = search(problem, drawn, normals=normals, starts=1, candidates=500)
    assert np.abs(normals @ found.sensors[0].plane.normal).max() > 1 - 1e-9
    assert np.abs(normals @ drawn[0].plane.normal).max() < 1 - 1e-6
    assert found.initial == drawn


def test_slanted_planes_are_counted_by_their_directions():
    def plane(normal, at=0.0):
        return Plane.from_normal(np.full(3, at), np.array(normal, float), np.array([1.0, 0.3, 0]))

    faces = np.eye(3)
    assert count_slanted([plane([0, 0, -1]), plane([0, 1e-3, 1]), plane([0, 1, 0])], faces) == 0
    assert count_slanted([plane([0, 1, 1]), plane([0, -1, -1], 5.0), plane([0, 0, 1])], faces) == 1
    assert count_slanted([plane([0, 1, 1]), plane([0, 1, -1]), plane([0, 0.01, 1])], faces) == 3


def test_cords_are_found_in_planes_along_the_faces(problem):
    normals = face_directions(problem.surface)
    found = search(problem, extra=2, normals=normals, starts=2, candidates=2000)
    for sensor in found.sensors:
        assert np.abs(normals @ sensor.plane.normal).max() > 1 - 1e-9
    free = search(problem, extra=2, starts=2, candidates=2000)
    assert found.rmse < 2 * free.rmse
