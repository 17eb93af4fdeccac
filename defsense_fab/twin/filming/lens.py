"""What a lens shows, and where its model ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.camera import Camera, distort

_STEP = 8  # px between exact rays; in between they are interpolated


def reach_of_lens(camera: Camera) -> float:
    """How far from the axis, on the plane at depth one, the model of the lens holds: further out
    it would fold back into the image."""
    r = np.linspace(0, 4, 4001)
    shown = distort(np.stack([r, 0 * r], axis=-1), camera.distortions, fisheye=camera.fisheye)[0][
        :, 0
    ]
    back = np.flatnonzero(~(np.diff(shown) > 0))
    return float(r[back[0]]) if len(back) else float(r[-1])


def project(camera: Camera, points: Float, limit: float) -> Float:
    """Points (..., 3) mm in the camera's frame to px (..., 2); NaN behind it or beyond the lens."""
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = points[..., :2] / points[..., 2:]
    seen = (points[..., 2] > 0) & ((plane * plane).sum(-1) < limit * limit)
    return camera.to_pixels(np.where(seen[..., None], plane, np.nan))


def plane_of_pixels(camera: Camera, pad: int) -> NDArray[np.float32]:
    """Undistorted points at depth one (h + 2 pad, w + 2 pad, 2) of the pixels and of `pad` more
    around the image; interpolated, which will do for depths."""
    width, height = (n + 2 * pad for n in camera.size)
    x, y = (np.arange(0, n + _STEP, _STEP) for n in (width, height))
    exact = camera.to_plane(np.stack(np.meshgrid(x - pad, y - pad), axis=-1).astype(float))
    rows, columns = _hats(height, len(y)), _hats(width, len(x))
    return np.stack([rows @ exact[..., k] @ columns.T for k in (0, 1)], axis=-1).astype(np.float32)


def _hats(count: int, knots: int) -> Float:
    """Weights (count, knots) of linear interpolation between knots every `_STEP`."""
    away = np.abs(np.arange(count)[:, None] / _STEP - np.arange(knots))
    return np.asarray(np.maximum(1 - away, 0))
