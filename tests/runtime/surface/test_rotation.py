"""Nearest rotations against singular values, for flat, reflected and zero matrices, too."""

import numpy as np
import pytest

from defsense_fab.runtime.surface.rotation import nearest_rotations


def by_singular_values(matrices):
    u, _, v = np.linalg.svd(matrices)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return u @ v


@pytest.mark.parametrize("values", [(3, 2, 1), (1, 1, 1), (1, 0.7, 0), (1, 0.01, 0), (3, 2, -1)])
def test_agrees_with_singular_values(values):
    rng = np.random.default_rng(0)
    u, v = (np.linalg.qr(rng.standard_normal((200, 3, 3)))[0] for _ in range(2))
    u, v = (a * np.sign(np.linalg.det(a))[:, None, None] for a in (u, v))
    matrices = 1e-3 * (u * np.array(values, float)) @ v
    found = nearest_rotations(matrices)
    assert np.abs(found - by_singular_values(matrices)).max() < 1e-9
    assert np.allclose(np.linalg.det(found), 1.0)


def test_identity_if_no_rotation_is_nearest():
    matrices = np.stack([np.zeros((3, 3)), np.diag([1.0, 0.0, 0.0]), np.diag([-1.0, -1.0, -1.0])])
    assert np.array_equal(nearest_rotations(matrices), np.stack([np.eye(3)] * 3))
