"""Corners of a tag from lines fitted to its four edges (`edge_line`).

Corners are where two lines cross. Covariances follow from those of the lines: of each corner, and
of the mean of the four, to which errors of a line's angle add nothing. If an edge cannot be fitted,
the line through the detector's corners replaces it, with the standard deviation that such lines
have. So no tag is lost that the detector has read.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_rows
from .edge_line import MAX_PIXELS, fit_line
from .edge_model import PARAMETERS

#: Standard deviation of the offset of a line through the detector's corners, and its distance
#: inside of the edge, px: the detector's contours run through the outermost dark pixels.
DETECTED_SIGMA_PX, DETECTED_INSET_PX = 0.35, 0.35
MIN_INFLATION = 0.9  # of variances, by the pieces of the edges
MIN_SINE = 0.1  # of the angle between two lines that cross in a corner
MIN_DETECTED_SINE = 0.03  # of the angle between two edges of the detector
MAX_CORNER_SIGMA_PX = 2.0  # above it the detector's corner is better


def refine(
    image: NDArray[np.uint8], plane: Float, corners: Float, cells: int
) -> tuple[Float, Float, Int]:
    """Refine the corners of n tags.

    Args:
        image: Grey image (h, w).
        plane: Position of each pixel without distortion (h, w, 2), px.
        corners: Corners that the detector found in the image (n, 4, 2), px.
        cells: Cells across a tag, with its border.

    Returns:
        Corners without distortion (n, 4, 2), px; covariances (n, 5, 2, 2), px^2, of each corner and
        last of their mean; and how many edges of each tag were fitted (n,).
    """
    count = len(corners)
    out, covariance = np.full((count, 4, 2), np.nan), np.full((count, 5, 2, 2), np.nan)
    fitted = np.zeros(count, np.int64)
    _refine(image, plane, np.ascontiguousarray(corners, float), cells, out, covariance, fitted)
    return out, covariance, fitted


@compiled()
def _refine(image, plane, corners, cells, out, covariance, fitted):  # type: ignore[no-untyped-def]
    """Refine the corners of each tag and write the results in place."""
    xs, ys, grey = np.empty(MAX_PIXELS), np.empty(MAX_PIXELS), np.empty(MAX_PIXELS)
    pixels, rows = np.empty((MAX_PIXELS, 3)), np.empty((PARAMETERS + 1, MAX_PIXELS))
    lines, spread, extra = np.empty((4, 6)), np.empty((4, 3)), np.empty((4, 2))
    ideal, is_fitted = np.empty((4, 2)), np.zeros(4, np.bool_)
    for tag in range(len(corners)):
        for k in range(4):
            _undistort(plane, corners[tag, k], ideal[k])
        cx, cy = ideal[:, 0].mean(), ideal[:, 1].mean()
        count, inflation = 0, 0.0
        for k in range(4):
            is_fitted[k] = fit_line(
                image,
                plane,
                corners[tag],
                ideal,
                k,
                cx,
                cy,
                cells,
                pixels,
                rows,
                xs,
                ys,
                grey,
                lines[k],
                spread[k],
                extra[k],
            )
            if is_fitted[k]:
                count += 1
                inflation += extra[k, 0]
        for k in range(4):
            if is_fitted[k]:  # errors of pixels are correlated alike on all edges
                for v in range(3):
                    spread[k, v] *= max(inflation / count, MIN_INFLATION)
                spread[k, 0] += extra[k, 1] ** 2
                spread[k, 2] += (2 * extra[k, 1] / lines[k, 3]) ** 2
            else:
                _use_detected_line(ideal, k, cx, cy, lines[k], spread[k])
        if count and _cross_lines(lines, spread, out[tag], covariance[tag]):
            fitted[tag] = count
            continue
        for k in range(4):
            _use_detected_line(ideal, k, cx, cy, lines[k], spread[k])
        if not _cross_lines(lines, spread, out[tag], covariance[tag]):
            copy_rows(ideal, out[tag])
            _use_detected_covariance(lines, covariance[tag])


@compiled()
def _undistort(plane, corner, out):  # type: ignore[no-untyped-def]
    """Interpolate the position of a corner (2,), px, without distortion."""
    h, w = plane.shape[:2]
    x, y = corner
    i, j = max(min(int(y), h - 2), 0), max(min(int(x), w - 2), 0)
    fx, fy = x - j, y - i
    for c in range(2):
        out[c] = (1 - fy) * ((1 - fx) * plane[i, j, c] + fx * plane[i, j + 1, c]) + fy * (
            (1 - fx) * plane[i + 1, j, c] + fx * plane[i + 1, j + 1, c]
        )


@compiled()
def _use_detected_line(ideal, k, cx, cy, line, spread):  # type: ignore[no-untyped-def]
    """Write the line through the detector's corners k and k + 1."""
    e = (k + 1) % 4
    tx, ty = ideal[e, 0] - ideal[k, 0], ideal[e, 1] - ideal[k, 1]
    length = max(np.hypot(tx, ty), 1e-6)
    mx, my = (ideal[e, 0] + ideal[k, 0]) / 2, (ideal[e, 1] + ideal[k, 1]) / 2
    nx, ny = -ty / length, tx / length
    if nx * (mx - cx) + ny * (my - cy) < 0:  # the normal points out of the tag
        nx, ny = -nx, -ny
    line[0], line[1], line[2] = nx, ny, nx * mx + ny * my + DETECTED_INSET_PX
    line[3], line[4], line[5] = length, mx, my
    spread[0], spread[1], spread[2] = (
        DETECTED_SIGMA_PX**2,
        0.0,
        (2 * DETECTED_SIGMA_PX / length) ** 2,
    )


@compiled()
def _use_detected_covariance(lines, covariance):  # type: ignore[no-untyped-def]
    """Write the covariance (5, 2, 2) of the detector's corners, and of their mean.

    Two lines that meet at a small angle, as on a slanted tag, hardly show where along them they do.
    """
    covariance[4] = 0.0
    for k in range(4):
        a, b = lines[(k + 3) % 4], lines[k]
        xx, yy = (
            a[0] ** 2 + b[0] ** 2 + MIN_DETECTED_SINE**2,
            a[1] ** 2 + b[1] ** 2 + MIN_DETECTED_SINE**2,
        )
        xy = a[0] * a[1] + b[0] * b[1]
        each = 2 * DETECTED_SIGMA_PX**2 / (xx * yy - xy * xy)
        covariance[k, 0, 0], covariance[k, 1, 1] = each * yy, each * xx
        covariance[k, 0, 1] = covariance[k, 1, 0] = -each * xy
        for c in range(2):
            for d in range(2):
                covariance[4, c, d] += covariance[k, c, d] / 16


@compiled()
def _cross_lines(lines, spread, out, covariance):  # type: ignore[no-untyped-def]
    """Write the corners (4, 2) where lines cross and the covariance (5, 2, 2).

    Returns:
        Whether all lines cross at a well-determined point.
    """
    mean = np.zeros((4, 2, 2))  # derivatives of the mean corner by offset and angle of each line
    for k in range(4):
        p = (k + 3) % 4  # line k runs from corner k to k + 1
        a, b = lines[p], lines[k]
        det = a[0] * b[1] - a[1] * b[0]
        if abs(det) < MIN_SINE:
            return False
        x = (a[2] * b[1] - a[1] * b[2]) / det
        y = (a[0] * b[2] - a[2] * b[0]) / det
        out[k, 0], out[k, 1] = x, y
        covariance[k] = 0.0
        # Line p moves by dc + s da at the corner; s is its distance from the line's middle.
        for line, sign in ((p, 1.0), (k, -1.0)):
            o = b if line == p else a
            gx, gy = sign * o[1] / det, -sign * o[0] / det
            n, v = lines[line], spread[line]
            s = -(x - n[4]) * n[1] + (y - n[5]) * n[0]
            for c, slope in ((0, gx), (1, gy)):
                mean[line, c, 0] += slope / 4
                mean[line, c, 1] += slope * s / 4
            variance = v[0] + 2 * s * v[1] + s * s * v[2]
            covariance[k, 0, 0] += gx * gx * variance
            covariance[k, 0, 1] += gx * gy * variance
            covariance[k, 1, 0] += gx * gy * variance
            covariance[k, 1, 1] += gy * gy * variance
        if not max(covariance[k, 0, 0], covariance[k, 1, 1]) < MAX_CORNER_SIGMA_PX**2:
            return False
    covariance[4] = 0.0
    for line in range(4):
        v = spread[line]
        for c in range(2):
            for d in range(2):
                a, b = mean[line, c], mean[line, d]
                covariance[4, c, d] += (
                    a[0] * b[0] * v[0] + (a[0] * b[1] + a[1] * b[0]) * v[1] + a[1] * b[1] * v[2]
                )
    return True
