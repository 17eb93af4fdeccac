"""The tags in an image, with corners that know how exact they are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from .edge_fit import refine
from .tag_dictionary import Dictionary

Image = NDArray[np.uint8]
_ROWS = 8


@dataclass(frozen=True)
class TagView:
    """The n tags of one image: numbers `ids` (n,); `corners` (n, 4, 2) px as a camera without
    distortion sees them, from the tag's top left clockwise, and the `covariance` (n, 5, 2, 2) px^2
    of each, and last of their mean; `seen` (n, 4, 2) px, corners in the image itself."""

    ids: Int
    corners: Float
    covariance: Float
    seen: Float

    def only(self, which: Bool) -> TagView:
        """Some of the tags, by a mask (n,)."""
        return TagView(
            self.ids[which], self.corners[which], self.covariance[which], self.seen[which]
        )


NOTHING = TagView(
    np.zeros(0, int), np.zeros((0, 4, 2)), np.zeros((0, 5, 2, 2)), np.zeros((0, 4, 2))
)  # fmt: skip


class Detector:
    """Finds tags of a dictionary in the images of a camera."""

    def __init__(self, camera: Camera, dictionary: Dictionary) -> None:
        self.camera = camera
        self._cells = dictionary.cells + 2
        self._detector = detector(dictionary)
        self._plane = _plane(camera)
        # Compiled now, not at the first tag of a recording: that takes seconds on a new machine.
        refine(np.zeros((1, 1), np.uint8), self._plane[:1, :1], np.zeros((0, 4, 2)), self._cells)

    def find(self, image: Image, box: tuple[int, int, int, int] | None = None) -> TagView:
        """All tags that can be read, or those within a `box` x0, y0, x1, y1 px alone. Raises
        CaptureError for an image of another size."""
        grey = to_grey(image)
        if grey.shape[::-1] != self.camera.size:
            raise CaptureError(
                wrong_size(self.camera, grey.shape[1], grey.shape[0]),
                code="image-size-differs",
                size=(grey.shape[1], grey.shape[0]),
            )
        x0, y0, x1, y1 = box or (0, 0, *self.camera.size)
        quads, numbers, _ = self._detector.detectMarkers(np.ascontiguousarray(grey[y0:y1, x0:x1]))
        if numbers is None or not len(numbers):
            return NOTHING
        ids = np.asarray(numbers).reshape(-1).astype(np.int64)
        seen = np.stack([np.asarray(q, float).reshape(4, 2) for q in quads]) + np.array([x0, y0])
        corners, covariance, _ = refine(grey, self._plane, seen, self._cells)
        view = TagView(ids, corners, covariance, seen)
        # Others are beyond what the model of the lens reaches.
        return view.only(np.asarray(np.isfinite(corners).all(axis=(1, 2))))


def _plane(camera: Camera) -> Float:
    """Where each pixel is without distortion (h, w, 2) px; in pieces that stay in the processor's
    cache, each with as many steps as it needs."""
    width, height = camera.size
    out = np.empty((height, width, 2))
    for top in range(0, height, _ROWS):
        rows = np.arange(top, min(top + _ROWS, height))
        grid = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).astype(float)
        out[rows] = camera.to_plane(grid) * camera.focal + camera.matrix[:2, 2]
    return out


def detector(dictionary: Dictionary) -> cv2.aruco.ArucoDetector:
    """OpenCV's, set to read blurred and slanted tags, too, whose corners `edge_fit` makes exact.
    Fewer thresholds than its three are quicker, and lose tags that stand close together."""
    settings = cv2.aruco.DetectorParameters()
    settings.perspectiveRemovePixelPerCell = 8
    settings.perspectiveRemoveIgnoredMarginPerCell = 0.3
    return cv2.aruco.ArucoDetector(dictionary.table, settings)


def to_grey(image: Image) -> Image:
    """An image (h, w) or (h, w, 3) BGR as grey (h, w), as it is in memory."""
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image)


def wrong_size(camera: Camera, width: int, height: int) -> str:
    """What to say of an image of another size than the camera's."""
    return (
        f"camera {camera.name}: its calibration is for {camera.size[0]} x {camera.size[1]} pixels,"
        f" the images have {width} x {height}; calibrate at the resolution that you record with"
    )
