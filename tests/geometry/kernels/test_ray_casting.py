"""Rays meet the triangles that they meet, however few of them are looked at."""

import numpy as np
import trimesh

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels.surface_queries import cast_ray


def test_no_triangle_is_left_out_that_a_ray_meets():
    """Two of a convex body for each line through it, where its supporting planes say."""
    ball = trimesh.creation.icosphere(4, 20.0)
    far = np.array([700.0, -300.0, 90.0])
    surface = Surface(np.array(ball.vertices) + far, np.array(ball.faces, np.int64))
    normals, offsets = np.array(ball.face_normals), np.einsum(
        "ij,ij->i", ball.face_normals, ball.triangles[:, 0]
    )  # fmt: skip
    rng = np.random.default_rng(1)
    for _ in range(40):
        start, d = rng.uniform(-9, 9, 3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        rate, room = normals @ d, offsets - normals @ start
        leaves = (room[rate > 1e-9] / rate[rate > 1e-9]).min()
        found = cast_ray(start + far, d, surface)
        assert len(found) == 1
        np.testing.assert_allclose(found[0], leaves, atol=1e-9)


def test_another_surface_is_not_taken_for_the_last():
    for half in (1.0, 2.0, 3.0):
        box = trimesh.creation.box((2 * half,) * 3)
        surface = Surface(np.array(box.vertices), np.array(box.faces, np.int64))
        found = cast_ray(np.array([0.1, 0.05, 0.0]), np.array([1.0, 0, 0]), surface)
        np.testing.assert_allclose(found, [half - 0.1])
