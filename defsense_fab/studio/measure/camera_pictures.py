"""What a camera sees, small, with the tags that were found."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...capture.sessions.guided_recording import CameraView

WIDTH = 320  # pixels
#: Told apart by all: tags that several cameras see, and those that one does.
_SEVERAL, _ONE = (0, 158, 115), (230, 159, 0)


def small_picture(view: CameraView) -> NDArray[np.uint8]:
    """(h, WIDTH, 3) RGB; grey while there is no picture."""
    if view.image is None:
        return np.full((WIDTH * 9 // 16, WIDTH, 3), 128, np.uint8)
    h, w = view.image.shape[:2]
    tall = max(2, round(WIDTH * h / w))
    small = cv2.resize(view.image, (WIDTH, tall), interpolation=cv2.INTER_AREA)
    if small.ndim == 2:
        small = np.repeat(small[:, :, None], 3, axis=2)
    small = np.ascontiguousarray(small[:, :, ::-1])
    scale = np.array([WIDTH / w, tall / h])
    for quad, shared in zip(view.outlines, view.shared, strict=True):
        at = np.round((np.asarray(quad) + 0.5) * scale - 0.5).astype(np.int32)
        cv2.polylines(small, [at], True, _SEVERAL if shared else _ONE, 2)
    return np.asarray(small, np.uint8)


def camera_words(view: CameraView) -> str:
    """Its name, and what it finds."""
    if view.image is None:
        return f"{view.name}: no picture"
    return f"{view.name}: {len(view.ids)} tags, {view.rate:.0f} pictures/s"
