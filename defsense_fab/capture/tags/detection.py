"""The tags in an image, with corners that know how exact they are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError
from .edge_fit import refine
from .tag_patterns import CharucoBoard, Dictionary

# A ChArUco board in an image.

_LEAST_BOARD_DETECTION = 6  # corners, for a view that is of use
_NEAR = 0.8  # of the white between a corner and the next tag: what a corner is refined in
#: px, bounds of half of that window: where less is clear the detector's corners stay, whose windows
#: follow the board's slant.
_SMALL, _LARGE = 4, 9


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in an image: their numbers `ids` (k,) and places `corners` (k, 2) px."""

    ids: Int
    corners: Float


class BoardFinder:
    """Finds one board in images."""

    def __init__(self, board: CharucoBoard) -> None:
        self.board = board
        settings = detector(board.family).getDetectorParameters()
        self._detector = cv2.aruco.CharucoDetector(
            board.charuco, cv2.aruco.CharucoParameters(), settings
        )

    def find(self, image: Image) -> BoardView | None:
        """The board's corners that can be seen; None where they are too few, or all in a line."""
        grey = to_grey(image)
        if self.board.inverted:
            grey = 255 - grey
        corners, ids, _, _ = self._detector.detectBoard(grey)
        if ids is None or len(ids) < _LEAST_BOARD_DETECTION:
            return None
        ids = np.asarray(ids).reshape(-1).astype(np.int64)
        places = np.asarray(corners, np.float32).reshape(-1, 2)
        flat = self.board.corners[ids, :2]
        spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
        if spread[1] < 0.5 * self.board.square:
            return None
        _refine(grey, places, self._windows(flat, places))
        return BoardView(ids, places.astype(float))

    def _windows(self, flat: Float, places: NDArray[np.float32]) -> Int:
        """Half windows (k,) px that keep clear of the tags, whose inside is no corner of four
        squares: by how near the next corners are in the image. 0 where there is no room."""
        b = self.board
        side = b.scale * b.square
        apart = np.linalg.norm(flat[:, None] - flat[None], axis=2) / side
        shown = np.linalg.norm(places[:, None] - places[None], axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            px = np.where((apart > 0.5) & (apart < 1.8), shown / apart, np.inf).min(axis=1)
        px = np.where(np.isfinite(px), px, np.median(px[np.isfinite(px)]))
        clear = _NEAR * (b.square - b.marker) / 2 / b.square
        half = np.minimum(clear * px, _LARGE).astype(np.int64)
        return np.asarray(np.where(half >= _SMALL, half, 0))


def _refine(grey: Image, places: NDArray[np.float32], half: Int) -> None:
    """Move corners (k, 2) px to where the gradients around them say that they are."""
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    for size in np.unique(half[half > 0]):
        some = np.flatnonzero(half == size)
        part = np.ascontiguousarray(places[some])
        cv2.cornerSubPix(grey, part, (int(size), int(size)), (-1, -1), stop)
        places[some] = part


# The tags in one image after another: looked for near where they were, which is sooner done.

#: Images after which the whole one is looked at again, and a place is forgotten.
_WHOLE, _KEPT = 10, 30
_BESIDE = 0.6  # of the largest side of a tag: how far outside the last places is looked, and
_LEAST = 40  # px, at least


class TagFollower:
    """Finds tags of a dictionary in the images of a camera, one after the other in time. Of most
    images only the part around the tags' last places is looked at; a tag that is missing there has
    the whole image looked at, and one that appears elsewhere is found within ten images. A number
    that was printed twice is found as often as it is seen."""

    def __init__(self, camera: Camera, dictionary: Dictionary) -> None:
        self._detector = Detector(camera, dictionary)
        self._size = camera.size
        self._number = 0
        # Tag: image that it was last seen in, and its corners there, of each of its prints.
        self._last: dict[int, tuple[int, list[Float]]] = {}

    def find(self, image: Image) -> TagView:
        """All tags that can be read. Raises CaptureError for an image of another size."""
        now = self._number
        self._number += 1
        expected = Counter(
            {tag: len(at) for tag, (when, at) in self._last.items() if when == now - 1}
        )
        view = None
        if expected and now % _WHOLE:
            view = self._detector.find(image, self._box())
            if not expected <= Counter(view.ids.tolist()):
                view = None
        if view is None:
            view = self._detector.find(image)
        for tag in set(view.ids.tolist()):
            self._last[tag] = now, list(view.seen[view.ids == tag])
        self._last = {t: seen for t, seen in self._last.items() if now - seen[0] < _KEPT}
        return view

    def _box(self) -> tuple[int, int, int, int]:
        """Around the last places, within the image."""
        corners = np.array([c for _, at in self._last.values() for c in at])
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        around = max(_BESIDE * float(sides.max()), _LEAST)
        low = np.maximum(np.floor(corners.min(axis=(0, 1)) - around), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(axis=(0, 1)) + around), self._size).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])


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
