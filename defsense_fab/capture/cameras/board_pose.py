"""A board before one camera."""

from __future__ import annotations

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera


def board_pose(camera: Camera, points: Float, corners: Float) -> tuple[Float, Float, Float] | None:
    """Rotation (3, 3) and translation (3,) mm from the board to the camera's frame by which its
    `points` (n, 3) mm come nearest to the `corners` (n, 2) px, and where they are shown (n, 2) px;
    None where there is none."""
    plane = camera.to_plane(corners)
    good = np.isfinite(plane).all(axis=1)
    if good.sum() < 4:
        return None
    found, r, t = cv2.solvePnP(points[good], plane[good], np.eye(3), None)
    if not found:
        return None
    R, t = cv2.Rodrigues(r)[0], np.asarray(t, float).ravel()
    at = points @ R.T + t
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = camera.to_pixels(np.where(at[:, 2:] > 0, at[:, :2] / at[:, 2:], np.nan))
    return np.asarray(R, float), t, shown
