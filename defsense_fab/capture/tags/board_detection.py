"""A ChArUco board in an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from .charuco_board import CharucoBoard
from .tag_detection import Image, detector, to_grey

_LEAST = 6  # corners, for a view that is of use
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
        if ids is None or len(ids) < _LEAST:
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
