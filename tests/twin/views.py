"""Cameras, rotations and tags for tests of simulated cameras."""

import numpy as np

from defsense_fab.core.camera import Camera

STRONG_DISTORTION = (-0.35, 0.15, 0.004, -0.003, -0.02)

#: Axes of a patch that a camera on the negative y axis sees upright.
UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])


def camera(
    eye, target=(0, 0, 0), focal=320.0, size=(320, 240), lens=STRONG_DISTORTION, name="left"
):
    """Return a camera at a point (3,) mm that looks at another one, with z up in its images."""
    eye, target = np.array(eye, float), np.array(target, float)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    matrix = np.array([[focal, 0, size[0] / 2 + 2], [0, 1.01 * focal, size[1] / 2 - 3], [0, 0, 1]])
    return Camera(name, size, matrix, np.array(lens, float), rotation, -rotation @ eye)


def turn(x=0.0, y=0.0, z=0.0):
    """Return a rotation (3, 3) about the axes x, y and z in this order, radians."""
    out = np.eye(3)
    for k, a in enumerate((x, y, z)):
        i, j = (k + 1) % 3, (k + 2) % 3
        R = np.eye(3)
        R[i, i] = R[j, j] = np.cos(a)
        R[j, i], R[i, j] = np.sin(a), -np.sin(a)
        out = R @ out
    return out


def tag(seed=0, cells=6):
    """Return a random pattern (cells, cells) with a black border."""
    rng = np.random.default_rng(seed)
    out = np.zeros((cells, cells), np.uint8)
    out[1:-1, 1:-1] = 255 * rng.integers(0, 2, (cells - 2, cells - 2))
    return out
