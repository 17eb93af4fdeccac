"""Tags as printers and paper make them: ink that spreads, paper that curls."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from ...core.errors import CaptureError
from .scene import WHITE, Patch

_FINE = 50  # parts of a cell in which ink spreads


def printed(patch: Patch, ink: float, curl: float) -> Patch:
    """A patch whose black is `ink` mm wider on each side, to the next fiftieth of a cell, and whose
    paper curls by `curl`, 1/mm. Its size and corners are those of the picture with the spread ink.
    Raises CaptureError for ink that goes beyond the white margin."""
    wider = round(ink / patch.cell * _FINE)
    if not 0 <= wider < patch.margin * _FINE:
        raise CaptureError(
            f"ink that spreads by {ink:g} mm leaves no white margin",
            code="ink-too-wide",
            where=f"patch {patch.number}",
            ink=ink,
        )
    if wider == 0:
        return replace(patch, curl=curl)
    fine = np.kron(patch.pattern, np.ones((_FINE, _FINE), np.uint8))
    fine = np.pad(fine, wider, constant_values=WHITE)
    kernel = np.ones((2 * wider + 1, 2 * wider + 1), np.uint8)
    pattern = cv2.erode(fine, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=WHITE)
    size = patch.size * pattern.shape[1] / (patch.pattern.shape[1] * _FINE)
    return replace(
        patch, pattern=np.asarray(pattern, np.uint8), size=size,
        margin=patch.margin * _FINE - wider, curl=curl,
    )  # fmt: skip
