"""Fit a line to one edge of a tag, by the pixels near it.

Across an edge the image goes from the black border to the white around it, in a step that lens,
motion and pixels have blurred and that the camera may have sharpened (`edge_model`). Line, levels,
blur, overshoot and the light's change along the edge are fitted to all pixels near it at once
(Gauss-Newton), in the coordinates of a camera without distortion, in which edges are straight.
Parts of the edge that something hides are left out.

Errors of neighboring pixels are correlated where a camera demosaics, sharpens and compresses. Sums
over pieces of the edge show by how much that increases the variance (cluster-robust, Liang & Zeger
1986).
"""

from __future__ import annotations

import math

import numpy as np

from ...core.machine.compiled import compiled
from .edge_model import (
    MASK_PX,
    MAX_BLUR_PX,
    MIN_CONTRAST,
    MIN_PIXELS,
    PARAMETERS,
    ROUNDS,
    converge,
    is_censored,
    phi,
)

MIN_LENGTH_PX = 6
#: Pixels nearer to a corner than this, or than this share of the edge, see the other edge too.
CORNER_PX, CORNER_SHARE = 2.0, 0.1
#: Limits of the band of pixels along an edge, and by how much it is narrower than a tag's cell.
MIN_BAND_PX, MAX_BAND_PX, CELL_MARGIN_PX = 1.5, 4.0, 1.3
#: The same once the blur is known: distances from the next cell and from the next edge, in standard
#: deviations of the blur, and the narrowest band.
CELL_MARGIN_BLURS, CORNER_MARGIN_BLURS, MIN_REFINED_BAND_PX = 1.7, 2.2, 1.25
FIRST_EXTRA_BAND_PX = 1.0  # in the first round, because the detector's corners are a pixel off
MAX_MOVE_PX = 3.0  # of a line from where the detector saw it
#: Standard deviation of a line's offset that the model does not explain, px; and per blur, by the
#: part of the next cell's step that reaches into the band, and by the overshoot, whose shape
#: differs from camera to camera.
SYSTEMATIC_SIGMA_PX, BLEED_SIGMA, OVERSHOOT_SIGMA = 0.001, 0.1, 0.018
#: Largest residual of a pixel: in the second round, as a share of the step and in grey levels; then
#: in standard deviations, but at least a share of the step.
FIRST_OUTLIER_SHARE, FIRST_OUTLIER_GREY, OUTLIER_SIGMAS, OUTLIER_SHARE = 0.45, 8.0, 4.0, 0.15
#: Largest standard deviation of all residuals, as a share of the step and in grey levels.
MAX_RESIDUAL_SHARE, MAX_RESIDUAL_GREY = 0.2, 6.0
#: Shares of pixels left out: that call for more rounds, and above which an edge is not used; what
#: they add to the standard deviation, per blur; and the number of additional rounds.
CLEAN_SHARE, MAX_HIDDEN_SHARE, HIDDEN_SIGMA, EXTRA_ROUNDS = 0.02, 0.35, 0.5, 2
#: Pieces of an edge, the share of a piece that may be hidden before all of it is left out, and the
#: pieces within which errors of pixels are correlated.
PIECES, MAX_PIECE_SHARE, CLUSTERS = 16, 0.12, 6
MIN_NOISE = 1.0  # grey levels
#: Pixels near an edge. Of more, only those of slices that are even along it are used; slices are
#: thinned by this factor until the pixels fit.
MAX_PIXELS, THINNING_FACTOR = 6000, 1.1
FIRST_VARIANCE = 4.0  # grey levels squared, before the noise is known


@compiled()
def fit_line(  # type: ignore[no-untyped-def]
    image, plane, corners, ideal, k, cx, cy, cells, pixels, rows, xs, ys, grey, line, spread, extra
):
    """Fit edge k, from corner k to the next.

    Args:
        image: Grey image (h, w).
        plane: Position of each pixel without distortion (h, w, 2), px.
        corners: Corners in the image (4, 2), px.
        ideal: Corners without distortion (4, 2), px.
        k: Number of the edge.
        cx: Horizontal middle of the ideal corners, px.
        cy: Vertical middle of the ideal corners, px.
        cells: Cells across a tag, with its border.
        pixels: Room for pixels (MAX_PIXELS, 3).
        rows: Room for derivatives (PARAMETERS + 1, MAX_PIXELS).
        xs: Room for positions of pixels (MAX_PIXELS,), px.
        ys: Room for positions of pixels (MAX_PIXELS,), px.
        grey: Room for grey levels of pixels (MAX_PIXELS,).
        line: Result (6,): outward normal, offset along it, length, and middle of the edge, px.
        spread: Result (3,): variance of the offset, covariance of offset and angle, and variance of
            the angle about that middle, by independent pixels.
        extra: Result (2,): ratio of the offset's variance by pieces of the edge to that variance,
            and the standard deviation that the model does not explain, px.

    Returns:
        Whether the fit succeeded.
    """
    e = (k + 1) % 4
    tx, ty = ideal[e, 0] - ideal[k, 0], ideal[e, 1] - ideal[k, 1]
    length = math.hypot(tx, ty)
    if length < MIN_LENGTH_PX:
        return False
    mx, my = (ideal[e, 0] + ideal[k, 0]) / 2, (ideal[e, 1] + ideal[k, 1]) / 2
    nx, ny = -ty / length, tx / length
    if nx * (mx - cx) + ny * (my - cy) < 0:  # the normal points out of the tag
        nx, ny = -nx, -ny
    across = 2 * abs(nx * (mx - cx) + ny * (my - cy))
    band = min(max(across / cells - CELL_MARGIN_PX, MIN_BAND_PX), MAX_BAND_PX)
    half = length / 2 - max(CORNER_PX, CORNER_SHARE * length)
    reach = band + MAX_MOVE_PX + 1
    q = np.zeros(PARAMETERS)  # offset, angle, low, step, blur, light, overshoot
    q[4], expected = 1.0, 0.0
    A, B = np.empty((PARAMETERS, PARAMETERS)), np.empty((PARAMETERS + 1, PARAMETERS + 1))
    used, variance = 0, FIRST_VARIANCE
    robust_limit, found = 1e9, 0
    dropped, hidden = 0.0, np.zeros(PIECES, np.bool_)
    for turn in range(ROUNDS + EXTRA_ROUNDS):
        if turn >= ROUNDS and dropped < CLEAN_SHARE:
            break
        if turn:
            band = across / cells - CELL_MARGIN_BLURS * q[4]
            band = min(max(band, MIN_REFINED_BAND_PX), MAX_BAND_PX)
            margin = max(CORNER_PX, CORNER_SHARE * length, CORNER_MARGIN_BLURS * q[4])
            half = length / 2 - min(margin, length / 4)
        ax, ay = nx - q[1] * -ny, ny - q[1] * nx  # n turned by the angle, to first order
        norm = math.hypot(ax, ay)
        ax, ay = ax / norm, ay / norm
        width = band + (FIRST_EXTRA_BAND_PX if turn == 0 else 0.0)
        if turn == 0:  # all pixels that any round can need
            spacing = max(2 * reach * length / MAX_PIXELS, 1.0)
            found = MAX_PIXELS + 1
            while found > MAX_PIXELS:
                found = _collect_pixels(
                    image, plane, corners, k, e, mx, my, nx, ny, length, reach, spacing, pixels
                )
                spacing *= THINNING_FACTOR
        count, low, high = _select_band(pixels, found, ax, ay, q[0], width, half, xs, ys, grey)
        if count < MIN_PIXELS or low < 0 or high < 0:
            return False
        # The frame turns with the line, so angles stay small.
        nx, ny, q[1] = ax, ay, 0.0
        if turn == 0:
            q[2], q[3] = low, high - low
            if q[3] < MIN_CONTRAST:
                return False
            expected = q[3]
        visible = _move_hidden_last(xs, ys, grey, count, nx, ny, half, hidden)
        # Pixels of a finger on the edge, for example, are left out, more strictly in each round.
        limit = 1e9
        if turn == 1:
            limit = FIRST_OUTLIER_SHARE * q[3] + FIRST_OUTLIER_GREY
        elif turn > 1:
            limit = min(OUTLIER_SIGMAS * math.sqrt(variance), robust_limit)
            limit = max(limit, OUTLIER_SHARE * q[3])
        informative, used, variance, converged = converge(
            xs, ys, grey, visible, nx, ny, length, q, expected, turn, variance, limit, rows, A, B
        )
        if informative < MIN_PIXELS:
            return False
        dropped = 1 - used / count
        if turn == 1 or (turn and dropped > CLEAN_SHARE):
            noise = _mark_hidden_pieces(xs, ys, grey, count, nx, ny, half, q, limit, hidden)
            robust_limit = OUTLIER_SIGMAS * noise
    max_residual = MAX_RESIDUAL_SHARE * q[3] + MAX_RESIDUAL_GREY
    if not converged or dropped > MAX_HIDDEN_SHARE or math.sqrt(variance) > max_residual:
        return False
    if q[3] < MIN_CONTRAST or abs(q[0]) > MAX_MOVE_PX or q[4] >= MAX_BLUR_PX:
        return False
    ax, ay = nx + q[1] * ny, ny - q[1] * nx
    norm = math.hypot(ax, ay)
    nx, ny = ax / norm, ay / norm
    line[0], line[1] = nx, ny
    line[2] = nx * mx + ny * my + q[0] / norm
    line[3], line[4], line[5] = length, mx, my
    inverse = np.linalg.inv(A)
    spread[0], spread[1] = variance * inverse[0, 0], variance * inverse[0, 1]
    spread[2] = variance * inverse[1, 1]
    # Equations with almost no information have no inverse that could be trusted.
    if not (0 < spread[0] < MAX_MOVE_PX**2 and spread[0] * spread[2] > spread[1] ** 2):
        return False
    sums = np.zeros(CLUSTERS)
    for m in range(visible):
        part = 0.0
        for a in range(PARAMETERS):
            part += inverse[0, a] * rows[a, m]
        s = -ny * xs[m] + nx * ys[m]
        piece = min(max(int((s + half) * CLUSTERS / (2 * half)), 0), CLUSTERS - 1)
        sums[piece] += part * rows[PARAMETERS, m]
    # Offset and angle were fitted to the same pieces.
    extra[0] = (sums**2).sum() / spread[0] * CLUSTERS / (CLUSTERS - 2)
    leak = 0.5 - 0.5 * math.erf((across / cells - band) / q[4] * 0.7071067811865476)
    hiding = HIDDEN_SIGMA * max(dropped - CLEAN_SHARE, 0.0)
    per_blur = BLEED_SIGMA * leak + hiding + OVERSHOOT_SIGMA * abs(q[6])
    extra[1] = SYSTEMATIC_SIGMA_PX + q[4] * per_blur
    return True


@compiled()
def _collect_pixels(  # type: ignore[no-untyped-def]
    image, plane, corners, k, e, mx, my, nx, ny, length, reach, spacing, pixels
):
    """Put the pixels near an edge into `pixels`, of each `spacing` px along it those of one px.

    Returns:
        Their number; MAX_PIXELS + 1 if they do not fit.
    """
    h, w = image.shape
    j0 = max(int(min(corners[k, 0], corners[e, 0]) - reach), 0)
    j1 = min(int(max(corners[k, 0], corners[e, 0]) + reach) + 2, w)
    i0 = max(int(min(corners[k, 1], corners[e, 1]) - reach), 0)
    i1 = min(int(max(corners[k, 1], corners[e, 1]) + reach) + 2, h)
    rise = corners[e, 1] - corners[k, 1]
    run = (corners[e, 0] - corners[k, 0]) / rise if abs(rise) > 1 else 1e9
    row_reach = (reach + 2) * math.hypot(1.0, run)  # along a row, with room for distortion
    found = 0
    for i in range(i0, i1):
        center = corners[k, 0] + (i - corners[k, 1]) * run
        for j in range(int(max(center - row_reach, j0)), int(min(center + row_reach + 2, j1))):
            x, y = plane[i, j, 0] - mx, plane[i, j, 1] - my
            d, s = nx * x + ny * y, -ny * x + nx * y
            if not -reach <= d <= reach or 2 * abs(s) > length:
                continue
            if spacing > 1 and (s + length) % spacing >= 1:
                continue
            if found == MAX_PIXELS:
                return MAX_PIXELS + 1
            pixels[found, 0], pixels[found, 1], pixels[found, 2] = x, y, image[i, j]
            found += 1
    return found


@compiled()
def _select_band(  # type: ignore[no-untyped-def]
    pixels, found, ax, ay, offset, width, half, xs, ys, grey
):
    """Copy the pixels within a band along the line.

    Returns:
        Their number, and the mean grey levels of the band's dark and bright ends; -1 for an end
        without pixels.
    """
    count, darkest, brightest = 0, 0.0, 0.0
    dark, bright = 0, 0
    for m in range(found):
        x, y, value = pixels[m, 0], pixels[m, 1], pixels[m, 2]
        d = ax * x + ay * y - offset
        if -width <= d <= width and abs(-ay * x + ax * y) <= half:
            xs[count], ys[count], grey[count] = x, y, value
            count += 1
            if d > width / 2:
                brightest += value
                bright += 1
            elif d < -width / 2:
                darkest += value
                dark += 1
    return count, darkest / dark if dark else -1.0, brightest / bright if bright else -1.0


@compiled()
def _move_hidden_last(xs, ys, grey, count, nx, ny, half, hidden):  # type: ignore[no-untyped-def]
    """Move the pixels of hidden pieces to the end; return the number of the others."""
    visible = count
    if hidden.any():
        scale = PIECES / (2 * half)
        m = 0
        while m < visible:
            s = -ny * xs[m] + nx * ys[m]
            if hidden[min(max(int((s + half) * scale), 0), PIECES - 1)]:
                visible -= 1
                xs[m], xs[visible] = xs[visible], xs[m]
                ys[m], ys[visible] = ys[visible], ys[m]
                grey[m], grey[visible] = grey[visible], grey[m]
            else:
                m += 1
    return visible


@compiled()
def _mark_hidden_pieces(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, half, q, limit, hidden
):
    """Mark the pieces (PIECES,) of an edge that something hides, in place.

    If a part of a piece is hidden, none of it is used.

    Returns:
        The noise, grey levels, by the median of all residuals.
    """
    hidden[:] = False
    width = 2 * half / PIECES
    outliers, totals = np.zeros(PIECES), np.zeros(PIECES)
    histogram = np.zeros(1024, np.int64)
    for m in range(count):
        s = -ny * xs[m] + nx * ys[m]
        d = nx * xs[m] + ny * ys[m] - q[0]
        p = phi(d / q[4])
        p += q[6] * (p - phi(d / math.hypot(q[4], MASK_PX)))
        piece = min(max(int((s + half) / width), 0), PIECES - 1)
        totals[piece] += 1
        r = grey[m] - (q[2] + q[3] * p) * (1 + q[5] * s)
        r = 0.0 if is_censored(grey[m], r) else abs(r)
        histogram[min(int(4 * r), len(histogram) - 1)] += 1
        if r >= limit:
            outliers[piece] += 1
    for piece in range(PIECES):
        if outliers[piece] > MAX_PIECE_SHARE * totals[piece]:
            hidden[max(piece - 1, 0) : piece + 2] = True
    below, median = 0, 0
    while 2 * below < count and median < len(histogram):
        below += histogram[median]
        median += 1
    return max(1.4826 * median / 4, MIN_NOISE)
