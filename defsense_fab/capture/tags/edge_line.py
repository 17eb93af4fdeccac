"""The line of one edge of a tag, fitted to the pixels beside it.

Across an edge the image goes from the black border to the white around it as a step that lens,
motion and pixels have blurred and that the camera may have sharpened: with d the distance from the
line, low + step (Phi(d / s) + k (Phi(d / s) - Phi(d / S))), S^2 = s^2 + mask^2, of which k is the
overshoot on both sides as unsharp masking makes it. Line, levels, blur, overshoot and the light's
change along the edge are fitted to all pixels beside it at once (Gauss-Newton), in the coordinates
of a camera without distortion, in which edges are straight. A pixel as bright or as dark as the
camera can tell says no more than that (a censored residual). What lies on an edge is left out.

Neighbouring pixels err together where a camera demosaics, sharpens and compresses: how much that
adds to the variance is told by sums over pieces of the edge (cluster-robust, Liang & Zeger 1986).
"""

from __future__ import annotations

import math

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows
from .small_systems import solve

#: px: pixels nearer to a corner than this, or this part of the edge, see the other edge too.
_END, _END_PART = 2.0, 0.1
#: px: band of pixels beside an edge: at least, at most, and how much less than a tag's cell.
_NARROW, _WIDE, _SPARE = 1.5, 4.0, 1.3
#: Rounds; steps in the first ones, whose result is a start, and most in those that must converge.
_ROUNDS, _STEPS, _MORE_STEPS = 3, 4, 24
#: Times the least sum of squares that counts as no worse; steps that may fail, and in a row where
#: there are more steps; damping of the next one, and its factor from step to step.
_WORSE, _FAILURES, _MORE_FAILURES, _DAMPED, _TRIES = 1.001, 4, 8, 0.1, 6.0
#: Standard deviations that a line may be away from where its pixels put it: on the way on, edges
#: that are clipped or out of focus come no nearer to the truth.
_LITTLE = 1.0
_FEW = 12  # pixels that tell too little
_SHARP, _BLURRED = 0.3, 4.0  # px, bounds of s
_CONTRAST = 12.0  # grey levels, least step
_MOVED = 3.0  # px that a line may move from where the detector saw it
#: Standard deviations of the blur that are kept from the next cell and from the next edge; px, band
#: that is left at least.
_CLEAR, _CLEAR_END, _LEAST = 1.7, 2.2, 1.25
#: px, standard deviation of what the model leaves out, of a line's offset; and what is added, per
#: blur, by the part of the next cell's step that reaches into the band, and by overshoot, whose
#: shape differs from camera to camera.
_SYSTEMATIC, _BLEEDS, _SHAPE = 0.001, 0.1, 0.018
#: Residuals, as parts of the step and in grey levels, that a pixel may have at first, and later, in
#: standard deviations, or as a part of the step where that is more; and what all may have.
_ODD_STEP, _ODD_GREY, _ODD_SIGMAS, _ODD_PART = 0.45, 8.0, 4.0, 0.15
_ODD_FIT, _ODD_NOISE = 0.2, 6.0
#: Parts of the pixels left out: that call for more rounds; above which an edge is not used; and
#: what they add to the standard deviation, per blur.
_CLEAN, _HIDDEN, _HIDES, _MORE = 0.02, 0.35, 0.5, 2
#: An edge in pieces, what part of one may be left out without the rest of it, and the pieces whose
#: pixels err together.
_PIECES, _PART, _CLUSTERS = 16, 0.12, 6
_LEAST_NOISE = 1.0  # grey levels
MOST = 6000  # pixels beside an edge: of more, those of slices that are even along it
_THINNER = 1.1  # by which fewer, until they have room
#: px, change of the line at its ends below which a round has converged: the first ones, and others.
_ENOUGH = (0.1, 0.02, 2e-3)
_FAR, _PER = 6.0, 256.0  # of the table of Phi and its derivative: its end, entries in a unit


def _step() -> Float:
    d = np.arange(-_FAR, _FAR + 1.5 / _PER, 1 / _PER)
    phi = [0.5 + 0.5 * math.erf(x / math.sqrt(2)) for x in d]
    return np.array([phi, np.exp(-d * d / 2) / math.sqrt(2 * math.pi)])


_PHI, _DENSITY = _step()  # which numba takes as constants
FREE = 7  # offset, angle, two levels, blur, how the light changes along the edge, overshoot
_UNEVEN = 0.0015  # per px, standard deviation of that change
#: Standard deviations of the overshoot, and at first, until the line is near; px, the mask that
#: makes it.
_OVERSHOOT, _SMALL, _MASK = 0.7, 0.02, 1.5
_USUAL, _UNUSUAL = 0.8, 0.7  # px, blur that is expected, and its standard deviation
_BEYOND = 0.5  # of the step as first seen: standard deviation of where its clipped end would be
_BRIGHTEST, _DARKEST = 253.5, 1.5  # grey levels beyond which a camera can tell no more
_GUESS = 4.0  # grey levels squared, of the noise before it is known


@compiled()
def fit_line(  # type: ignore[no-untyped-def]
    image, plane, seen, ideal, k, cx, cy, cells, near, rows, xs, ys, grey, line, spread, more
):
    """Fit edge k, from corner k to the next; whether that went well.

    `seen` and `ideal` (4, 2) px: corners in the image and without distortion; `cx`, `cy` px: their
    middle. `line` (6,): its normal outwards, its offset along that, length, and the middle of the
    edge; `spread` (3,): variances of offset and angle about that middle and their covariance, by
    independent pixels; `more` (2,): the variance of the offset as pieces of the edge tell it over
    that, and the standard deviation, px, of what the model leaves out. `near`, `rows`, `xs`, `ys`,
    `grey` are room for pixels.
    """
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
    q = np.zeros(FREE)  # offset, angle, low, step, blur, light, overshoot
    q[4], expected = 1.0, 0.0
    A, B = np.empty((FREE, FREE)), np.empty((FREE + 1, FREE + 1))
    total, variance = 0, _GUESS
    middling, found = 1e9, 0
    dropped, hidden = 0.0, np.zeros(_PIECES, np.bool_)
    for turn in range(_ROUNDS + _MORE):
        if turn >= _ROUNDS and dropped < _CLEAN:
            break
        if turn:
            band = min(max(across / cells - _CLEAR * q[4], _LEAST), _WIDE)
            half = length / 2 - min(max(_END, _END_PART * length, _CLEAR_END * q[4]), length / 4)
        ax, ay = nx - q[1] * -ny, ny - q[1] * nx  # n turned by the angle, to first order
        norm = math.hypot(ax, ay)
        ax, ay = ax / norm, ay / norm
        # The search begins wider: the detector's corners are a pixel off.
        wide = band + (1.0 if turn == 0 else 0.0)
        count, darkest, brightest = 0, 0.0, 0.0
        dark, bright = 0, 0
        if turn == 0:  # all that any round can want
            apart = max(2 * reach * length / MOST, 1.0)
            found = MOST + 1
            while found > MOST:
                found = _beside(
                    image, plane, seen, k, e, mx, my, nx, ny, length, reach, apart, near
                )
                apart *= _THINNER
        for m in range(found):
            x, y, value = near[m, 0], near[m, 1], near[m, 2]
            d = ax * x + ay * y - q[0]
            if -wide <= d <= wide and abs(-ay * x + ax * y) <= half:
                xs[count], ys[count], grey[count] = x, y, value
                count += 1
                if d > wide / 2:
                    brightest += value
                    bright += 1
                elif d < -wide / 2:
                    darkest += value
                    dark += 1
        if count < _FEW or not dark or not bright:
            return False
        # The frame turns with the line: angles are small again.
        nx, ny, q[1] = ax, ay, 0.0
        if turn == 0:
            q[2], q[3] = darkest / dark, brightest / bright - darkest / dark
            if q[3] < _CONTRAST:
                return False
            expected = q[3]
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
            limit = _ODD_STEP * q[3] + _ODD_GREY
        elif turn > 1:
            limit = max(min(_ODD_SIGMAS * math.sqrt(variance), middling), _ODD_PART * q[3])
        told, total, variance, converged = _converge(
            xs, ys, grey, shown, nx, ny, length, q, expected, turn, variance, limit, rows, A, B
        )
        if told < _FEW:
            return False
        dropped = 1 - total / count
        if turn == 1 or (turn and dropped > _CLEAN):
            middling = _ODD_SIGMAS * _hide(xs, ys, grey, count, nx, ny, half, q, limit, hidden)
    if not converged or dropped > _HIDDEN or math.sqrt(variance) > _ODD_FIT * q[3] + _ODD_NOISE:
        return False
    if q[3] < _CONTRAST or abs(q[0]) > _MOVED or q[4] >= _BLURRED:
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
    # Equations that say next to nothing have no inverse that could be trusted.
    if not (0 < spread[0] < _MOVED**2 and spread[0] * spread[2] > spread[1] ** 2):
        return False
    sums = np.zeros(_CLUSTERS)
    for m in range(shown):
        part = 0.0
        for a in range(FREE):
            part += inverse[0, a] * rows[a, m]
        s = -ny * xs[m] + nx * ys[m]
        piece = min(max(int((s + half) * _CLUSTERS / (2 * half)), 0), _CLUSTERS - 1)
        sums[piece] += part * rows[FREE, m]
    # Offset and angle were fitted to the same pieces.
    more[0] = (sums**2).sum() / spread[0] * _CLUSTERS / (_CLUSTERS - 2)
    leak = 0.5 - 0.5 * math.erf((across / cells - band) / q[4] * 0.7071067811865476)
    hides = _HIDES * max(dropped - _CLEAN, 0.0)
    more[1] = _SYSTEMATIC + q[4] * (_BLEEDS * leak + hides + _SHAPE * abs(q[6]))
    return True


@compiled()
def _beside(  # type: ignore[no-untyped-def]
    image, plane, seen, k, e, mx, my, nx, ny, length, reach, apart, near
):
    """Put the pixels beside an edge into `near` (MOST, 3), of each `apart` px along it those of one
    px; how many there are, MOST + 1 where they have no room."""
    h, w = image.shape
    j0 = max(int(min(seen[k, 0], seen[e, 0]) - reach), 0)
    j1 = min(int(max(seen[k, 0], seen[e, 0]) + reach) + 2, w)
    i0 = max(int(min(seen[k, 1], seen[e, 1]) - reach), 0)
    i1 = min(int(max(seen[k, 1], seen[e, 1]) + reach) + 2, h)
    slant = seen[e, 1] - seen[k, 1]
    run = (seen[e, 0] - seen[k, 0]) / slant if abs(slant) > 1 else 1e9
    aside = (reach + 2) * math.hypot(1.0, run)  # along a row, with room for distortion
    found = 0
    for i in range(i0, i1):
        center = seen[k, 0] + (i - seen[k, 1]) * run
        for j in range(int(max(center - aside, j0)), int(min(center + aside + 2, j1))):
            x, y = plane[i, j, 0] - mx, plane[i, j, 1] - my
            d, s = nx * x + ny * y, -ny * x + nx * y
            if not -reach <= d <= reach or 2 * abs(s) > length:
                continue
            if apart > 1 and (s + length) % apart >= 1:
                continue
            if found == MOST:
                return MOST + 1
            near[found, 0], near[found, 1], near[found, 2] = x, y, image[i, j]
            found += 1
    return found


@compiled()
def _hide(xs, ys, grey, count, nx, ny, half, q, limit, hidden):  # type: ignore[no-untyped-def]
    """Mark the pieces (_PIECES,) of an edge that something lies on: where part of a piece is
    hidden, none of it is an edge. The noise, as the median of all residuals tells it."""
    hidden[:] = False
    width = 2 * half / _PIECES
    out, all_, often = np.zeros(_PIECES), np.zeros(_PIECES), np.zeros(1024, np.int64)
    for m in range(count):
        s = -ny * xs[m] + nx * ys[m]
        d = nx * xs[m] + ny * ys[m] - q[0]
        p = _phi(d / q[4])
        p += q[6] * (p - _phi(d / math.hypot(q[4], _MASK)))
        piece = min(max(int((s + half) / width), 0), _PIECES - 1)
        all_[piece] += 1
        r = grey[m] - (q[2] + q[3] * p) * (1 + q[5] * s)
        r = 0.0 if _censored(grey[m], r) else abs(r)
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
    return max(1.4826 * half_way / 4, _LEAST_NOISE)


@compiled()
def _converge(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, length, q, expected, turn, variance, limit, rows, A, B
):
    """Levenberg-Marquardt on q (FREE,), with the normal equations in A. How many pixels tell
    something (0 where that came to nothing), how many are not left out, the variance of the
    residuals, and whether it converged. First rounds, whose result is a start, need not; the others
    have more steps where they want them, as edges do that are out of focus."""
    g, delta, best = np.empty(FREE), np.empty(FREE), q.copy()
    damped, least, damping, told, kept = np.empty((FREE, FREE)), np.inf, 0.0, 0, 0
    steps, failures, allowed, converged = 0, 0, _STEPS, False
    enough, first = _ENOUGH[min(turn, len(_ENOUGH) - 1)], turn < _ROUNDS - 1
    while True:
        now, here, cost = _equations(xs, ys, grey, count, nx, ny, q, limit, rows, B)
        if now < _FEW or not cost <= _WORSE * least:
            failures += 1
            if least == np.inf:
                break
            if failures > (_FAILURES if allowed == _STEPS else _MORE_FAILURES):
                converged = first or _near(A, g, variance, B, length, enough)
                if converged or allowed > _STEPS:
                    break
                allowed = _MORE_STEPS
            damping = max(_TRIES * damping, _DAMPED)
        else:
            converged = steps > 0 and abs(delta[0]) + abs(delta[1]) * length / 2 < enough
            copy_row(q, best)
            least, told, kept = cost, now, here
            copy_rows(B, A)
            copy_row(B[FREE], g)  # B is symmetric
            for a in range(FREE):
                A[a, a] += 1e-9 * A[a, a] + 1e-12
            variance = B[FREE, FREE] / (told - 5) + 1 / 12  # rounding to whole grey levels
            # What is known beforehand; it counts where pixels are clipped, or few.
            for a, away, sigma in (
                (3, q[3] - expected, _BEYOND * expected),
                (4, q[4] - _USUAL, _UNUSUAL),
                (5, q[5], _UNEVEN),
                (6, q[6], _OVERSHOOT if turn else _SMALL),
            ):
                A[a, a] += variance / sigma**2
                g[a] -= away * variance / sigma**2
            if not (converged or first) and steps >= _STEPS:
                converged = _near(A, g, variance, B, length, enough)
                allowed = _MORE_STEPS
            if converged or steps == allowed:
                break
            steps += 1
            if allowed > _STEPS:
                failures, damping = 0, damping / _TRIES
            else:
                damping = damping / _TRIES if damping > _DAMPED else 0.0
        copy_rows(A, damped)
        for a in range(FREE):
            damped[a, a] *= 1 + damping
        if not solve(damped, g, B, delta):
            break
        copy_row(best, q)
        q[0] += min(max(delta[0], -1.0), 1.0)
        q[1] += min(max(delta[1], -2.0 / length), 2.0 / length)
        q[2] += delta[2]
        q[3] = max(q[3] + delta[3], _CONTRAST / 2)
        q[4] = min(max(q[4] + min(max(delta[4], -0.3), 0.3), _SHARP), _BLURRED)
        q[5] += delta[5]
        q[6] += min(max(delta[6], -0.4), 0.4)
    copy_row(best, q)
    if failures:  # the rows are those of a step that failed
        _equations(xs, ys, grey, count, nx, ny, q, limit, rows, B)
    return told, kept, variance, converged


@compiled()
def _near(A, g, variance, L, length, enough):  # type: ignore[no-untyped-def]
    """Whether the line is less than part of its standard deviation away from where the equations
    A x = g of the pixels put it."""
    unit, x, step = np.zeros(FREE), np.empty(FREE), np.empty(FREE)
    unit[0] = 1.0
    if not (solve(A, unit, L, x) and solve(A, g, L, step)):
        return False
    moved = abs(step[0]) + abs(step[1]) * length / 2
    return moved < max(_LITTLE * math.sqrt(variance * x[0]), enough)


@compiled()
def _phi(d):  # type: ignore[no-untyped-def]
    return _PHI[int((min(max(d, -_FAR), _FAR) + _FAR) * _PER + 0.5)]


@compiled()
def _censored(value, residual):  # type: ignore[no-untyped-def]
    return (value > _BRIGHTEST and residual < 0) or (value < _DARKEST and residual > 0)


@compiled(fastmath=True)
def _equations(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, q, limit, rows, B
):
    """Put the normal equations of a step into B (FREE + 1, FREE + 1), with the residuals last; how
    many pixels tell something, how many are not left out, and the sum of squares of all, none above
    the limit's. Columns and no branches: the processor takes several pixels at once."""
    offset, angle, low, step, blur, light, overshoot = q
    by_offset, by_angle, by_low, by_step, by_blur, by_light, by_overshoot, left = (
        rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7]
    )  # fmt: skip
    wide = math.sqrt(blur * blur + _MASK * _MASK)
    inverse, inverse_wide, told, kept, cost = 1 / blur, 1 / wide, 0.0, 0.0, 0.0
    grown, part_wide = (1 + overshoot) * inverse, overshoot * inverse_wide
    blur_wide = part_wide * blur * inverse_wide
    for m in range(count):
        s = -ny * xs[m] + nx * ys[m]
        away = nx * xs[m] + ny * ys[m] - offset - angle * s
        d, dw = away * inverse, away * inverse_wide
        at = (min(max(d, -_FAR), _FAR) + _FAR) * _PER
        entry = np.int32(at + 0.5)
        part = (at - entry) / _PER
        f = _DENSITY[entry]
        p = _PHI[entry] + part * f  # Taylor's series: 5e-7 off at most
        f -= part * d * f
        at = (min(max(dw, -_FAR), _FAR) + _FAR) * _PER
        entry = np.int32(at + 0.5)
        part = (at - entry) / _PER
        fw = _DENSITY[entry]
        pw = _PHI[entry] + part * fw
        fw -= part * dw * fw
        bright, up = 1 + light * s, p + overshoot * (p - pw)
        level = low + step * up
        r = grey[m] - level * bright
        inside = 1.0 if abs(r) < limit else 0.0
        high = 1.0 if grey[m] > _BRIGHTEST and r < 0 else 0.0
        deep = 1.0 if grey[m] < _DARKEST and r > 0 else 0.0
        weight = inside * (1 - high) * (1 - deep)
        clipped = max(high, deep)
        kept += max(inside, clipped)
        cost += (1 - clipped) * min(r * r, limit * limit)
        told += weight
        bright *= weight
        slope = -step * bright * (f * grown - fw * part_wide)
        by_offset[m], by_angle[m] = slope, slope * s
        by_low[m], by_step[m], by_light[m] = bright, up * bright, level * s * weight
        by_blur[m] = -step * bright * (f * d * grown - fw * dw * blur_wide)
        by_overshoot[m] = step * bright * (p - pw)
        left[m] = r * weight
    for a in range(FREE + 1):
        for b in range(a, FREE + 1):
            total = 0.0
            for m in range(count):
                total += rows[a, m] * rows[b, m]
            B[a, b] = B[b, a] = total
    return int(told), int(kept), cost
