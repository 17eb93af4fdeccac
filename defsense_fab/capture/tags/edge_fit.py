"""Corners of a tag from lines fitted to its four edges.

Across an edge the image goes from the black border to the white around it as a step that lens,
motion and pixels have blurred: a + b Phi(d / s), with d the distance from the line. Line, levels,
blur and the light's change along the edge are fitted to all pixels beside it at once
(Gauss-Newton), in the coordinates of a camera without distortion, in which edges are straight. What
lies on an edge is left out. Corners are where two lines cross; their covariance follows from that
of the lines, for each corner by itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float
from ...core.compiled import compiled

#: px: pixels nearer to a corner than this, or this part of the edge, see the other edge too.
_END, _END_PART = 2.0, 0.1
#: px: band of pixels beside an edge: at least, at most, and how much less than a tag's cell.
_NARROW, _WIDE, _SPARE = 1.5, 4.0, 1.3
_ROUNDS, _STEPS = 3, 3
_SHARP, _BLURRED = 0.3, 4.0  # px, bounds of s
_CONTRAST = 12.0  # grey levels, least step
_MOVED = 3.0  # px that a line may move from where the detector saw it
#: Standard deviations of the blur that are kept from the next cell and from the next edge; px, band
#: that is left at least.
_CLEAR, _CLEAR_END, _LEAST = 1.7, 2.2, 1.25
#: px, standard deviation of what the model leaves out, of a line's offset; and what is added, per
#: blur, by the part of the next cell's step that reaches into the band.
_SYSTEMATIC, _BLEEDS = 0.002, 0.2
#: Residuals, as parts of the step and in grey levels, that a pixel may have at first, and later, in
#: standard deviations; and what all may have.
_ODD_STEP, _ODD_GREY, _ODD_SIGMAS = 0.25, 8.0, 4.0
_ODD_FIT, _ODD_NOISE = 0.08, 4.0
#: Parts of the pixels left out: that call for more rounds; above which an edge is not used; and
#: what they add to the standard deviation, per blur.
_CLEAN, _HIDDEN, _HIDES, _MORE = 0.02, 0.35, 0.5, 2
#: An edge in pieces, and what part of one may be left out without the rest of it.
_PIECES, _PART = 16, 0.12
_LEAST_NOISE = 1.0  # grey levels
_UNSURE = 1.0  # px, standard deviation of a corner of which nothing is said
_MOST = 6000
_ENOUGH = 1e-3  # px, change of the line at its ends below which a round has converged
_FAR, _PER = 6.0, 256.0  # of the table of Phi and its derivative: its end, entries in a unit


def _step() -> Float:
    d = np.arange(-_FAR, _FAR + 1.5 / _PER, 1 / _PER)
    phi = [0.5 + 0.5 * math.erf(x / math.sqrt(2)) for x in d]
    return np.array([phi, np.exp(-d * d / 2) / math.sqrt(2 * math.pi)])


_PHI, _DENSITY = _step()  # which numba takes as constants
_FREE = 6  # offset, angle, two levels, blur, and how the light changes along the edge
_UNEVEN = 0.0015  # per px, standard deviation of that change
_GUESS = 4.0  # grey levels squared, of the noise before it is known


def refine(
    image: NDArray[np.uint8], plane: Float, corners: Float, cells: int
) -> tuple[Float, Float, Bool]:
    """Corners (n, 4, 2) without distortion, px; the covariance (n, 4, 2, 2) px^2 of each; and which
    tags (n,) could be fitted.

    `image` (h, w); `plane` (h, w, 2) the place of each pixel without distortion, px; `corners`
    (n, 4, 2) px as the detector found them in the image; `cells` across a tag, its border with it.
    """
    count = len(corners)
    out, covariance = np.full((count, 4, 2), np.nan), np.full((count, 4, 2, 2), np.nan)
    good = np.zeros(count, np.bool_)
    _refine(image, plane, np.ascontiguousarray(corners, float), cells, out, covariance, good)
    return out, covariance, good


@compiled()
def _refine(image, plane, corners, cells, out, covariance, good):  # type: ignore[no-untyped-def]
    h, w = image.shape
    xs, ys, grey = np.empty(_MOST), np.empty(_MOST), np.empty(_MOST)
    near, rows = np.empty((_MOST, 3)), np.empty((_FREE + 1, _MOST))
    lines = np.empty((4, 4))  # nx, ny, nx * mx + ny * my + c; length
    spread = np.empty((4, 3))  # variances and covariance of offset and angle
    middle = np.empty((4, 2))
    for tag in range(len(corners)):
        ideal = np.empty((4, 2))
        inside = True
        for k in range(4):
            x, y = corners[tag, k, 0], corners[tag, k, 1]
            i, j = int(y), int(x)
            if x < 0 or y < 0 or i >= h - 1 or j >= w - 1:
                inside = False
                break
            fx, fy = x - j, y - i
            for c in range(2):
                ideal[k, c] = (1 - fy) * (
                    (1 - fx) * plane[i, j, c] + fx * plane[i, j + 1, c]
                ) + fy * ((1 - fx) * plane[i + 1, j, c] + fx * plane[i + 1, j + 1, c])
        if not inside:
            continue
        cx, cy = ideal[:, 0].mean(), ideal[:, 1].mean()
        fitted = True
        for k in range(4):
            if not _line(
                image, plane, corners[tag], ideal, k, cx, cy, cells, near, rows, xs, ys, grey,
                lines[k], spread[k], middle[k],
            ):  # fmt: skip
                fitted = False
                break
        if not fitted:
            continue
        J = np.zeros((8, 8))  # of the corners by offset and angle of each line
        for k in range(4):
            p = (k + 3) % 4  # line k runs from corner k to k + 1
            a, b = lines[p], lines[k]
            det = a[0] * b[1] - a[1] * b[0]
            if abs(det) < 0.1:
                fitted = False
                break
            x = (a[2] * b[1] - a[1] * b[2]) / det
            y = (a[0] * b[2] - a[2] * b[0]) / det
            out[tag, k, 0], out[tag, k, 1] = x, y
            # Line p moves by dc + s da at the corner, s being its distance from the line's middle.
            for line, sign in ((p, 1.0), (k, -1.0)):
                o = b if line == p else a
                gx, gy = sign * o[1] / det, -sign * o[0] / det
                n = lines[line]
                s = -(x - middle[line, 0]) * n[1] + (y - middle[line, 1]) * n[0]
                J[2 * k, 2 * line], J[2 * k + 1, 2 * line] = gx, gy
                J[2 * k, 2 * line + 1], J[2 * k + 1, 2 * line + 1] = gx * s, gy * s
        if not fitted:
            continue
        S = np.zeros((8, 8))
        for k in range(4):
            S[2 * k, 2 * k], S[2 * k + 1, 2 * k + 1] = spread[k, 0], spread[k, 2]
            S[2 * k, 2 * k + 1] = S[2 * k + 1, 2 * k] = spread[k, 1]
        unsure = False
        for k in range(4):
            D = J[2 * k : 2 * k + 2]
            covariance[tag, k] = D @ S @ D.T
            for c in range(2):
                unsure = unsure or not covariance[tag, k, c, c] < _UNSURE**2
        good[tag] = not unsure


@compiled()
def _line(  # type: ignore[no-untyped-def]
    image, plane, seen, ideal, k, cx, cy, cells, near, rows, xs, ys, grey, line, spread, middle
):
    """Fit edge k, from corner k to the next; whether that went well."""
    h, w = image.shape
    e = (k + 1) % 4
    tx, ty = ideal[e, 0] - ideal[k, 0], ideal[e, 1] - ideal[k, 1]
    length = math.hypot(tx, ty)
    if length < 6:
        return False
    mx, my = (ideal[e, 0] + ideal[k, 0]) / 2, (ideal[e, 1] + ideal[k, 1]) / 2
    nx, ny = -ty / length, tx / length
    if nx * (mx - cx) + ny * (my - cy) < 0:  # out of the tag
        nx, ny = -nx, -ny
    across = 2 * abs(nx * (mx - cx) + ny * (my - cy))
    band = min(max(across / cells - _SPARE, _NARROW), _WIDE)
    half = length / 2 - max(_END, _END_PART * length)
    reach = band + _MOVED + 1
    j0 = max(int(min(seen[k, 0], seen[e, 0]) - reach), 0)
    j1 = min(int(max(seen[k, 0], seen[e, 0]) + reach) + 2, w)
    i0 = max(int(min(seen[k, 1], seen[e, 1]) - reach), 0)
    i1 = min(int(max(seen[k, 1], seen[e, 1]) + reach) + 2, h)
    offset, angle, low, step, blur = 0.0, 0.0, 0.0, 0.0, 1.0
    A, g = np.empty((_FREE, _FREE)), np.empty(_FREE)
    B, delta = np.empty((_FREE + 1, _FREE + 1)), np.empty(_FREE)
    light, total, variance = 0.0, 0, _GUESS
    middling, often, found = 1e9, np.zeros(1024, np.int64), 0
    dropped, hidden = 0.0, np.zeros(_PIECES, np.bool_)
    for turn in range(_ROUNDS + _MORE):
        if turn >= _ROUNDS and dropped < _CLEAN:
            break
        if turn:
            band = min(max(across / cells - _CLEAR * blur, _LEAST), _WIDE)
            half = length / 2 - min(max(_END, _END_PART * length, _CLEAR_END * blur), length / 4)
        ax, ay = nx - angle * -ny, ny - angle * nx  # n turned by the angle, to first order
        norm = math.hypot(ax, ay)
        ax, ay = ax / norm, ay / norm
        # The search begins wider: the detector's corners are a pixel off.
        wide = band + (1.0 if turn == 0 else 0.0)
        count, darkest, brightest = 0, 0.0, 0.0
        dark, bright = 0, 0
        if turn == 0:  # all that any round can want
            found = 0
            slant = seen[e, 1] - seen[k, 1]
            run = (seen[e, 0] - seen[k, 0]) / slant if abs(slant) > 1 else 1e9
            aside = (reach + 2) * math.hypot(1.0, run)  # along a row, with room for distortion
            for i in range(i0, i1):
                center = seen[k, 0] + (i - seen[k, 1]) * run
                for j in range(int(max(center - aside, j0)), int(min(center + aside + 2, j1))):
                    x, y = plane[i, j, 0] - mx, plane[i, j, 1] - my
                    d = nx * x + ny * y
                    beside = -reach <= d <= reach and 2 * abs(-ny * x + nx * y) <= length
                    if beside and found < _MOST:
                        near[found, 0], near[found, 1], near[found, 2] = x, y, image[i, j]
                        found += 1
        for m in range(found):
            x, y, value = near[m, 0], near[m, 1], near[m, 2]
            d = ax * x + ay * y - offset
            if -wide <= d <= wide and abs(-ay * x + ax * y) <= half:
                xs[count], ys[count], grey[count] = x, y, value
                count += 1
                if d > wide / 2:
                    brightest += value
                    bright += 1
                elif d < -wide / 2:
                    darkest += value
                    dark += 1
        if count < 12 or not dark or not bright:
            return False
        # The frame turns with the line: angles are small again.
        nx, ny, angle = ax, ay, 0.0
        if turn == 0:
            low, step = darkest / dark, brightest / bright - darkest / dark
            if step < _CONTRAST:
                return False
        shown = count
        if hidden.any():  # pixels of hidden pieces go to the end
            scale = _PIECES / (2 * half)
            m = 0
            while m < shown:
                s = -ny * xs[m] + nx * ys[m]
                if hidden[min(max(int((s + half) * scale), 0), _PIECES - 1)]:
                    shown -= 1
                    xs[m], xs[shown] = xs[shown], xs[m]
                    ys[m], ys[shown] = ys[shown], ys[m]
                    grey[m], grey[shown] = grey[shown], grey[m]
                else:
                    m += 1
        # What lies on the edge, such as a finger, is left out, more strictly from round to round.
        limit = 1e9
        if turn == 1:
            limit = _ODD_STEP * step + _ODD_GREY
        elif turn > 1:
            limit = min(_ODD_SIGMAS * math.sqrt(variance), middling)
        for _ in range(_STEPS):
            used = _equations(
                xs, ys, grey, shown, nx, ny, offset, angle, blur, low, step, light, limit, rows, B
            )
            if used < 12:
                return False
            A[:], g[:] = B[:_FREE, :_FREE], B[:_FREE, _FREE]
            square, total = B[_FREE, _FREE], used
            for a in range(_FREE):
                A[a, a] += 1e-9 * A[a, a] + 1e-12
            A[5, 5] += variance / _UNEVEN**2
            g[5] -= light * variance / _UNEVEN**2
            variance = square / (total - 5) + 1 / 12  # rounding to whole grey levels
            if not _solve(A, g, B, delta):
                return False
            offset += min(max(delta[0], -1.0), 1.0)
            angle += min(max(delta[1], -2.0 / length), 2.0 / length)
            low += delta[2]
            step += delta[3]
            light += delta[5]
            blur = min(max(blur + min(max(delta[4], -0.5), 0.5), _SHARP), _BLURRED)
            if not step > _CONTRAST / 2:
                return False
            if abs(delta[0]) + abs(delta[1]) * length / 2 < _ENOUGH:
                break
        dropped = 1 - total / count
        if turn == 1 or (turn and dropped > _CLEAN):
            # Where part of a piece of the edge is hidden, none of that piece is an edge.
            hidden[:] = False
            width = 2 * half / _PIECES
            out, all_ = np.zeros(_PIECES), np.zeros(_PIECES)
            often[:] = 0
            for m in range(count):
                s = -ny * xs[m] + nx * ys[m]
                d = (nx * xs[m] + ny * ys[m] - offset) / blur
                p = _PHI[int((min(max(d, -_FAR), _FAR) + _FAR) * _PER + 0.5)]
                piece = min(max(int((s + half) / width), 0), _PIECES - 1)
                all_[piece] += 1
                r = abs(grey[m] - (low + step * p) * (1 + light * s))
                often[min(int(4 * r), len(often) - 1)] += 1
                if r >= limit:
                    out[piece] += 1
            for piece in range(_PIECES):
                if out[piece] > _PART * all_[piece]:
                    hidden[max(piece - 1, 0) : piece + 2] = True
            below, half_way = 0, 0
            while 2 * below < count and half_way < len(often):
                below += often[half_way]
                half_way += 1
            middling = _ODD_SIGMAS * max(1.4826 * half_way / 4, _LEAST_NOISE)
    if dropped > _HIDDEN or math.sqrt(variance) > _ODD_FIT * step + _ODD_NOISE:
        return False
    if step < _CONTRAST or abs(offset) > _MOVED or blur >= _BLURRED:
        return False
    ax, ay = nx + angle * ny, ny - angle * nx
    norm = math.hypot(ax, ay)
    nx, ny = ax / norm, ay / norm
    line[0], line[1] = nx, ny
    line[2] = nx * mx + ny * my + offset / norm
    line[3] = length
    middle[0], middle[1] = mx, my
    inverse = np.linalg.inv(A)
    leak = 0.5 - 0.5 * math.erf((across / cells - band) / blur * 0.7071067811865476)
    left_out = _SYSTEMATIC + blur * (_BLEEDS * leak + _HIDES * max(dropped - _CLEAN, 0.0))
    spread[0] = variance * inverse[0, 0] + left_out**2
    spread[1] = variance * inverse[0, 1]
    spread[2] = variance * inverse[1, 1] + (2 * left_out / length) ** 2
    # Equations that say next to nothing have no inverse that could be trusted.
    return 0 < spread[0] < _MOVED**2 and spread[0] * spread[2] > spread[1] ** 2


@compiled(fastmath=True)
def _equations(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, offset, angle, blur, low, step, light, limit, rows, B
):
    """Put the normal equations of a step into B (7, 7), with the residuals last; how many pixels
    are in them. Columns and no branches: the processor takes several pixels at once."""
    by_offset, by_angle, by_low, by_step, by_blur, by_light, left = (
        rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6]
    )  # fmt: skip
    inverse, used = 1 / blur, 0.0
    for m in range(count):
        s = -ny * xs[m] + nx * ys[m]
        d = (nx * xs[m] + ny * ys[m] - offset - angle * s) * inverse
        at = (min(max(d, -_FAR), _FAR) + _FAR) * _PER
        entry = np.int32(at + 0.5)
        part = (at - entry) / _PER
        f = _DENSITY[entry]
        p = _PHI[entry] + part * f  # Taylor's series: 5e-7 off at most
        f -= part * d * f
        bright, level = 1 + light * s, low + step * p
        r = grey[m] - level * bright
        weight = 1.0 if abs(r) < limit else 0.0
        bright *= weight
        f *= -step * inverse * bright
        by_offset[m], by_angle[m], by_blur[m] = f, f * s, f * d
        by_low[m], by_step[m], by_light[m] = bright, p * bright, level * s * weight
        left[m] = r * weight
        used += weight
    for a in range(_FREE + 1):
        for b in range(a, _FREE + 1):
            total = 0.0
            for m in range(count):
                total += rows[a, m] * rows[b, m]
            B[a, b] = B[b, a] = total
    return int(used)


@compiled()
def _solve(A, g, L, x):  # type: ignore[no-untyped-def]
    """x of A x = g, A (n, n) symmetric, by Cholesky's factors, for which L has room; whether A is
    positive definite. For matrices this small a library's call takes longer than its work."""
    n = len(g)
    for a in range(n):
        for b in range(a + 1):
            total = A[a, b]
            for c in range(b):
                total -= L[a, c] * L[b, c]
            if a > b:
                L[a, b] = total / L[b, b]
            elif total > 0:
                L[a, a] = math.sqrt(total)
            else:
                return False
        total = g[a]
        for c in range(a):
            total -= L[a, c] * x[c]
        x[a] = total / L[a, a]
    for a in range(n - 1, -1, -1):
        total = x[a]
        for c in range(a + 1, n):
            total -= L[c, a] * x[c]
        x[a] = total / L[a, a]
    return True
