"""Which directions of planes are simple, and layouts that keep to them."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from defsense_fab.core.curve import Plane
from defsense_fab.core.mesh import Surface
from defsense_fab.optimize.refinement.refine import optimise
from defsense_fab.optimize.search.plane_directions import face_directions, slanted


def surface(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def test_directions_are_those_of_large_flat_faces():
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    box = trimesh.creation.box([80.0, 50.0, 3.0])
    box.vertices = box.vertices @ turn.T
    found = face_directions(surface(box))
    assert len(found) == 2  # the narrow sides along x hold less than 5 % of the surface
    assert np.abs(found @ turn[:, 2]) == pytest.approx([1, 0], abs=1e-9)
    assert np.abs(found @ turn[:, 1]) == pytest.approx([0, 1], abs=1e-9)


def test_a_body_without_flat_faces_has_the_axes_of_its_coordinates():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20)
    assert (face_directions(surface(ball)) == np.eye(3)).all()


def test_slanted_planes_are_counted_by_their_directions():
    def plane(normal, at=0.0):
        return Plane.from_normal(np.full(3, at), np.array(normal, float), np.array([1.0, 0.3, 0]))

    faces = np.eye(3)
    assert slanted([plane([0, 0, -1]), plane([0, 1e-3, 1]), plane([0, 1, 0])], faces) == 0
    assert slanted([plane([0, 1, 1]), plane([0, -1, -1], 5.0), plane([0, 0, 1])], faces) == 1
    assert slanted([plane([0, 1, 1]), plane([0, 1, -1]), plane([0, 0.01, 1])], faces) == 3


def test_cords_are_found_in_planes_along_the_faces(problem):
    normals = face_directions(problem.surface)
    found = optimise(
        problem,
        (),
        np.random.default_rng(0),
        lambda *_: None,
        extra=2,
        normals=normals,
        starts=2,
        candidates=2000,
    )
    for sensor in found.sensors:
        assert np.abs(normals @ sensor.plane.normal).max() > 1 - 1e-9
    free = optimise(
        problem, (), np.random.default_rng(0), lambda *_: None, extra=2, starts=2, candidates=2000
    )
    assert found.rmse < 2 * free.rmse
