"""Detect tags and ChArUco boards in images."""

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

Image = NDArray[np.uint8]
PLANE_BLOCK_ROWS = 8  # fit in the processor's cache
WHOLE_IMAGE_INTERVAL = 10  # images after which a whole image is searched again
MAX_PLACE_AGE = 30  # images after which a tag's place is forgotten
#: Margin around the last places of tags: relative to the largest side of a tag, and at least, px.
SEARCH_MARGIN, MIN_SEARCH_MARGIN_PX = 0.6, 40
MIN_BOARD_CORNERS = 6  # of a useful view
#: Share of the white between a corner and the next tag in which the corner is refined.
CORNER_WINDOW = 0.8
#: Limits of half that window, px. With less room the detector's corners stay, whose windows follow
#: the board's slant.
MIN_CORNER_WINDOW_PX, MAX_CORNER_WINDOW_PX = 4, 9


@dataclass(frozen=True)
class TagView:
    """The n tags in one image.

    Attributes:
        ids: Numbers of the tags (n,).
        corners: Corners (n, 4, 2), px, as a camera without distortion sees them, clockwise from the
            tag's top left.
        covariance: Covariances (n, 5, 2, 2), px^2, of each corner and last of their mean.
        image_corners: Corners in the image itself (n, 4, 2), px.
    """

    ids: Int
    corners: Float
    covariance: Float
    image_corners: Float

    def only(self, mask: Bool) -> TagView:
        """Return the tags of a mask (n,)."""
        return TagView(
            self.ids[mask], self.corners[mask], self.covariance[mask], self.image_corners[mask]
        )


NO_TAGS = TagView(
    np.zeros(0, int), np.zeros((0, 4, 2)), np.zeros((0, 5, 2, 2)), np.zeros((0, 4, 2))
)


class Detector:
    """Finds tags of a dictionary in the images of a camera."""

    def __init__(self, camera: Camera, dictionary: Dictionary) -> None:
        self.camera = camera
        self._cells = dictionary.cells + 2
        self._detector = opencv_detector(dictionary)
        self._plane = _undistorted_pixels(camera)
        # Compile now, not at the first tag of a recording: that takes seconds on a new machine.
        refine(np.zeros((1, 1), np.uint8), self._plane[:1, :1], np.zeros((0, 4, 2)), self._cells)

    def find(self, image: Image, box: tuple[int, int, int, int] | None = None) -> TagView:
        """Find all tags that can be read.

        Args:
            image: Grey (h, w) or color (h, w, 3) image.
            box: Part x0, y0, x1, y1, px, to search; the whole image by default.

        Raises:
            CaptureError: If the image has another size than the camera.
        """
        grey = to_grey(image)
        if grey.shape[::-1] != self.camera.size:
            raise image_size_error(self.camera, (grey.shape[1], grey.shape[0]))
        x0, y0, x1, y1 = box or (0, 0, *self.camera.size)
        found, numbers, _ = self._detector.detectMarkers(np.ascontiguousarray(grey[y0:y1, x0:x1]))
        if numbers is None or not len(numbers):
            return NO_TAGS
        ids = np.asarray(numbers).reshape(-1).astype(np.int64)
        quads = np.stack([np.asarray(q, float).reshape(4, 2) for q in found])
        image_corners = quads + np.array([x0, y0])
        corners, covariance, _ = refine(grey, self._plane, image_corners, self._cells)
        view = TagView(ids, corners, covariance, image_corners)
        # Tags with infinite corners are outside of the range of the lens model.
        return view.only(np.asarray(np.isfinite(corners).all(axis=(1, 2))))


def _undistorted_pixels(camera: Camera) -> Float:
    """Return the position of each pixel without distortion (h, w, 2), px.

    Blocks of rows stay in the processor's cache, and each takes only the steps that it needs.
    """
    width, height = camera.size
    out = np.empty((height, width, 2))
    for top in range(0, height, PLANE_BLOCK_ROWS):
        rows = np.arange(top, min(top + PLANE_BLOCK_ROWS, height))
        grid = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).astype(float)
        out[rows] = camera.to_plane(grid) * camera.focal + camera.matrix[:2, 2]
    return out


def opencv_detector(dictionary: Dictionary) -> cv2.aruco.ArucoDetector:
    """Return OpenCV's detector with settings that also read blurred and slanted tags.

    `edge_fit` refines the corners. Fewer thresholds than OpenCV's three are faster, but lose tags
    that are close together.
    """
    settings = cv2.aruco.DetectorParameters()
    settings.perspectiveRemovePixelPerCell = 8
    settings.perspectiveRemoveIgnoredMarginPerCell = 0.3
    return cv2.aruco.ArucoDetector(dictionary.table, settings)


def to_grey(image: Image) -> Image:
    """Return an image (h, w) or (h, w, 3) BGR as grey (h, w), contiguous in memory."""
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image)


def image_size_error(
    camera: Camera, size: tuple[int, int], source: object = "", hint: str = ""
) -> CaptureError:
    """Return the error for images of another size, px, than the camera's.

    Args:
        camera: Calibrated camera.
        size: Width and height of the images, px.
        source: File of the images; by default the error names the camera.
        hint: Possible cause, added to the problem.
    """
    return CaptureError(
        f"the calibration of camera {camera.name} is for {camera.size[0]} x {camera.size[1]}"
        f" pixels, but the images have {size[0]} x {size[1]}{hint}",
        code="image-size-differs",
        where=source or f"camera {camera.name}",
        action="Calibrate at the resolution at which you record",
        camera=camera.name,
        size=tuple(size),
    )


class TagFollower:
    """Finds tags in the images of a camera, in the order of time.

    Mostly only the part around the tags' last places is searched, which is faster. If a tag is
    missing there, the whole image is searched; a tag that appears elsewhere is found within ten
    images. A number that was printed twice is found as often as it is visible.
    """

    def __init__(self, camera: Camera, dictionary: Dictionary) -> None:
        self._detector = Detector(camera, dictionary)
        self._size = camera.size
        self._number = 0
        # By tag: the image in which it was last seen, and its corners there, for each print.
        self._last: dict[int, tuple[int, list[Float]]] = {}

    def find(self, image: Image) -> TagView:
        """Find all tags that can be read in the next image.

        Raises:
            CaptureError: If the image has another size than the camera.
        """
        now = self._number
        self._number += 1
        expected = Counter(
            {tag: len(prints) for tag, (when, prints) in self._last.items() if when == now - 1}
        )
        view = None
        if expected and now % WHOLE_IMAGE_INTERVAL:
            view = self._detector.find(image, self._search_box())
            if not expected <= Counter(view.ids.tolist()):
                view = None
        if view is None:
            view = self._detector.find(image)
        for tag in set(view.ids.tolist()):
            self._last[tag] = now, list(view.image_corners[view.ids == tag])
        self._last = {
            tag: place for tag, place in self._last.items() if now - place[0] < MAX_PLACE_AGE
        }
        return view

    def _search_box(self) -> tuple[int, int, int, int]:
        """Return the box around the last places, within the image."""
        corners = np.array([c for _, prints in self._last.values() for c in prints])
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        margin = max(SEARCH_MARGIN * float(sides.max()), MIN_SEARCH_MARGIN_PX)
        low = np.maximum(np.floor(corners.min(axis=(0, 1)) - margin), 0).astype(int)
        high = np.minimum(np.ceil(corners.max(axis=(0, 1)) + margin), self._size).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])


@dataclass(frozen=True)
class BoardView:
    """Corners of a board in an image.

    Attributes:
        ids: Numbers of the corners (k,).
        corners: Positions (k, 2), px.
    """

    ids: Int
    corners: Float


class BoardFinder:
    """Finds one board in images."""

    def __init__(self, board: CharucoBoard) -> None:
        self.board = board
        settings = opencv_detector(board.family).getDetectorParameters()
        self._detector = cv2.aruco.CharucoDetector(
            board.charuco, cv2.aruco.CharucoParameters(), settings
        )

    def find(self, image: Image) -> BoardView | None:
        """Find the board's visible corners; None if they are too few, or all in a line."""
        grey = to_grey(image)
        if self.board.inverted:
            grey = 255 - grey
        corners, ids, _, _ = self._detector.detectBoard(grey)
        if ids is None or len(ids) < MIN_BOARD_CORNERS:
            return None
        ids = np.asarray(ids).reshape(-1).astype(np.int64)
        pixels = np.asarray(corners, np.float32).reshape(-1, 2)
        flat = self.board.corners[ids, :2]
        spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
        if spread[1] < 0.5 * self.board.square:
            return None
        _refine_corners(grey, pixels, self._half_windows(flat, pixels))
        return BoardView(ids, pixels.astype(float))

    def _half_windows(self, flat: Float, pixels: NDArray[np.float32]) -> Int:
        """Return half windows (k,), px, that do not reach the tags; 0 where there is no room.

        Inside of a tag no four squares meet. The windows follow from the distance of neighboring
        corners in the image.
        """
        b = self.board
        side = b.scale * b.square
        distance = np.linalg.norm(flat[:, None] - flat[None], axis=2) / side
        pixel_distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
        is_neighbor = (distance > 0.5) & (distance < 1.8)
        with np.errstate(divide="ignore", invalid="ignore"):
            px = np.where(is_neighbor, pixel_distance / distance, np.inf).min(axis=1)
        px = np.where(np.isfinite(px), px, np.median(px[np.isfinite(px)]))
        white = CORNER_WINDOW * (b.square - b.marker) / 2 / b.square
        half = np.minimum(white * px, MAX_CORNER_WINDOW_PX).astype(np.int64)
        return np.asarray(np.where(half >= MIN_CORNER_WINDOW_PX, half, 0))


def _refine_corners(grey: Image, pixels: NDArray[np.float32], half: Int) -> None:
    """Move corners (k, 2), px, in place to where the gradients around them meet."""
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    for size in np.unique(half[half > 0]):
        rows = np.flatnonzero(half == size)
        part = np.ascontiguousarray(pixels[rows])
        cv2.cornerSubPix(grey, part, (int(size), int(size)), (-1, -1), stop)
        pixels[rows] = part
