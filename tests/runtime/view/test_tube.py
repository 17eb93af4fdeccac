"""Tube meshes around the paths of cords."""

import numpy as np
import pytest

from defsense_fab.runtime.view.cord_mesh import tube_faces, tube_vertices


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rings_lie_across_the_path_at_the_radius(axis):
    t = np.linspace(0, 3, 40)
    path = np.roll(np.stack([20 * t, 5 * np.sin(t), 0 * t], axis=1), axis, axis=1)
    rings = tube_vertices(path, 1.5).reshape(40, 8, 3)
    assert np.linalg.norm(rings - path[:, None], axis=2) == pytest.approx(1.5)
    along = np.gradient(path, axis=0)
    assert np.einsum("pri,pi->pr", rings - path[:, None], along) == pytest.approx(0, abs=1e-9)
    # No ring is rotated relative to the one before.
    assert np.linalg.norm(np.diff(rings, axis=0), axis=2).max() < 3


def test_faces_join_neighbouring_rings():
    faces = tube_faces(5)
    assert faces.shape == (2 * 8 * 4, 3)
    assert faces.min() == 0
    assert faces.max() == 39
    assert np.ptp(faces, axis=1).max() < 16
