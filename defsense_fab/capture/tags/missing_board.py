"""Explain why a board was found in none of some images."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from .detection import Image, opencv_detector, to_grey
from .tag_patterns import FAMILIES, CharucoBoard, dictionary

#: Corners of the smallest chessboard that is detected each way, and the corners that it must have:
#: tags and textures often look like 3 x 3.
_MIN_CORNERS_ACROSS, _MIN_CORNERS = 3, 12
_SQUARES_FLAGS = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
_MIN_TAGS = 2  # of one family in an image; single ones are mostly textures
#: Boards use the lowest numbers of a family, which larger ones of as many cells share.
_DISTINCT_FAMILIES = [name for name in FAMILIES if not name.endswith(("_100", "_250", "_1000"))]


def explain_missing_board(images: Iterable[Image], board: CharucoBoard) -> str:
    """Return what images show instead of a board.

    Args:
        images: Grey (h, w) or color (h, w, 3) images.
        board: Board that was not found in them.

    Returns:
        A phrase such as "they show squares, but no tags"; empty if there is no explanation.
    """
    for image in images:
        grey = to_grey(image)
        if board.inverted:
            grey = np.asarray(255 - grey, np.uint8)
        if not _has_squares(grey):
            continue
        if _count_tags(grey, board.dictionary):
            return ""
        counts = {name: _count_tags(grey, name) for name in _DISTINCT_FAMILIES}
        family = max(counts, key=counts.__getitem__)
        if counts[family] < _MIN_TAGS:
            return "they show squares, but no tags"
        return f"they show tags of {family}, but none of {board.dictionary}"
    return ""


def _count_tags(grey: Image, family: str) -> int:
    _, ids, _ = opencv_detector(dictionary(family)).detectMarkers(grey)
    return 0 if ids is None else len(ids)


def _has_squares(grey: Image) -> bool:
    smallest = _MIN_CORNERS_ACROSS, _MIN_CORNERS_ACROSS
    is_found, corners = cv2.findChessboardCornersSB(grey, smallest, flags=_SQUARES_FLAGS)
    return bool(is_found) and len(corners) >= _MIN_CORNERS
