"""What is behind everything: a wall with a gradient and blotches, out of focus, at rest."""

from __future__ import annotations

import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ..scenes.scene import Backdrop


def wall(backdrop: Backdrop, camera: Camera, pad: int) -> NDArray[np.float32]:
    """Grey levels (h + 2 pad, w + 2 pad) of the image and `pad` px around it."""
    width, height = camera.size
    x, y = ((np.arange(-pad, n + pad) / n - 0.5).astype(np.float32) for n in camera.size)
    out = backdrop.level + backdrop.slope[0] * x + backdrop.slope[1] * y[:, None]
    if backdrop.texture:
        rng = np.random.default_rng([backdrop.seed, zlib.crc32(camera.name.encode())])
        shape = [2 + n // backdrop.grain for n in (height, width)]
        coarse = rng.normal(0, backdrop.texture, shape).astype(np.float32)
        out += cv2.resize(coarse, (len(x), len(y)), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(np.clip(out, 0, 255), np.float32)
