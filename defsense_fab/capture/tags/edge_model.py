"""Model of the brightness across one edge of a tag, and its least-squares fit.

With d the distance from the line, s the blur and S^2 = s^2 + mask^2, the brightness is low + step
(Phi(d / s) + k (Phi(d / s) - Phi(d / S))), changing linearly along the edge. The factor k is the
overshoot on both sides, as unsharp masking makes it. A pixel that is as bright or as dark as the
camera can show carries no more information than that (a censored residual).

The parameters are `q`: offset and angle of the line, low level, step, blur, change of the light
along the edge, and overshoot.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_row, copy_rows

PARAMETERS = 7
ROUNDS = 3
MIN_PIXELS = 12  # fewer carry too little information
MIN_BLUR_PX, MAX_BLUR_PX = 0.3, 4.0
MIN_CONTRAST = 12.0  # grey levels of the step
#: Steps of the first rounds, whose result is only a start, and of rounds that must converge.
FIRST_STEPS, MAX_STEPS = 4, 24
MAX_COST_GROWTH = 1.001  # of the best sum of squares, that counts as no worse
#: Steps that may fail: in all, and in a row where there are more steps.
FIRST_FAILURES, MAX_FAILURES = 4, 8
MIN_DAMPING, DAMPING_FACTOR = 0.1, 6.0
#: Standard deviations that a line may be away from the optimum. Beyond this, edges that are clipped
#: or out of focus come no nearer to the truth.
CONVERGED_SIGMAS = 1.0
#: Change of the line at its ends, px, below which a round has converged: the first rounds, others.
CONVERGED_PX = (0.1, 0.02, 2e-3)
MASK_PX = 1.5  # of unsharp masking
# Standard deviations of what is known before the fit.
STEP_PRIOR = 0.5  # of the step as first measured: its clipped end may be beyond
EXPECTED_BLUR_PX, BLUR_PRIOR_PX = 0.8, 0.7
LIGHT_PRIOR = 0.0015  # per px
OVERSHOOT_PRIOR, FIRST_OVERSHOOT_PRIOR = 0.7, 0.02  # the second until the line is near
BRIGHTEST, DARKEST = 253.5, 1.5  # grey levels beyond which a camera cannot show more
TABLE_END, TABLE_RESOLUTION = 6.0, 256.0  # of the tables: largest argument, entries per unit


def _tables() -> Float:
    """Return the normal distribution and its density (2, entries)."""
    d = np.arange(-TABLE_END, TABLE_END + 1.5 / TABLE_RESOLUTION, 1 / TABLE_RESOLUTION)
    phi = [0.5 + 0.5 * math.erf(x / math.sqrt(2)) for x in d]
    return np.array([phi, np.exp(-d * d / 2) / math.sqrt(2 * math.pi)])


_PHI, _DENSITY = _tables()  # constants of the compiled functions


@compiled()
def phi(d):  # type: ignore[no-untyped-def]
    """Return the normal distribution at d, to the table's resolution."""
    return _PHI[int((min(max(d, -TABLE_END), TABLE_END) + TABLE_END) * TABLE_RESOLUTION + 0.5)]


@compiled()
def is_censored(value, residual):  # type: ignore[no-untyped-def]
    """Return whether a clipped pixel agrees with a model that is beyond the camera's range."""
    return (value > BRIGHTEST and residual < 0) or (value < DARKEST and residual > 0)


@compiled()
def converge(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, length, q, expected, turn, variance, limit, rows, A, B
):
    """Fit q (PARAMETERS,) in place by the Levenberg-Marquardt method.

    The first rounds, whose result is a start, need not converge. Others take more steps if they
    need them, as edges do that are out of focus.

    Args:
        xs: Pixels' horizontal positions relative to the middle of the edge, px.
        ys: Their vertical positions, px.
        grey: Their grey levels.
        count: Number of pixels.
        nx: Horizontal component of the line's outward normal.
        ny: Vertical component of the line's outward normal.
        length: Length of the edge, px.
        q: Parameters; input is the start.
        expected: Step as first measured, grey levels.
        turn: Number of the round.
        variance: Variance of the residuals before the round.
        limit: Residual from which a pixel is left out, grey levels.
        rows: Room for derivatives and residuals (PARAMETERS + 1, pixels).
        A: Room for the normal equations (PARAMETERS, PARAMETERS).
        B: Room for the normal equations with the residuals.

    Returns:
        How many pixels carry information (0 if the fit failed), how many are not left out, the
        variance of the residuals, and whether it converged.
    """
    g, delta, best = np.empty(PARAMETERS), np.empty(PARAMETERS), q.copy()
    damped, best_cost, damping = np.empty((PARAMETERS, PARAMETERS)), np.inf, 0.0
    informative, used = 0, 0
    steps, failures, max_steps, converged = 0, 0, FIRST_STEPS, False
    tolerance = CONVERGED_PX[min(turn, len(CONVERGED_PX) - 1)]
    is_start = turn < ROUNDS - 1
    while True:
        now_informative, now_used, cost = normal_equations(
            xs, ys, grey, count, nx, ny, q, limit, rows, B
        )
        if now_informative < MIN_PIXELS or not cost <= MAX_COST_GROWTH * best_cost:
            failures += 1
            if best_cost == np.inf:
                break
            if failures > (FIRST_FAILURES if max_steps == FIRST_STEPS else MAX_FAILURES):
                converged = is_start or _is_near_optimum(A, g, variance, B, length, tolerance)
                if converged or max_steps > FIRST_STEPS:
                    break
                max_steps = MAX_STEPS
            damping = max(DAMPING_FACTOR * damping, MIN_DAMPING)
        else:
            converged = steps > 0 and abs(delta[0]) + abs(delta[1]) * length / 2 < tolerance
            copy_row(q, best)
            best_cost, informative, used = cost, now_informative, now_used
            copy_rows(B, A)
            copy_row(B[PARAMETERS], g)  # B is symmetric
            for a in range(PARAMETERS):
                A[a, a] += 1e-9 * A[a, a] + 1e-12
            # The last term is for rounding to whole grey levels.
            variance = B[PARAMETERS, PARAMETERS] / (informative - 5) + 1 / 12
            # Prior knowledge matters where pixels are clipped or few.
            for a, deviation, sigma in (
                (3, q[3] - expected, STEP_PRIOR * expected),
                (4, q[4] - EXPECTED_BLUR_PX, BLUR_PRIOR_PX),
                (5, q[5], LIGHT_PRIOR),
                (6, q[6], OVERSHOOT_PRIOR if turn else FIRST_OVERSHOOT_PRIOR),
            ):
                A[a, a] += variance / sigma**2
                g[a] -= deviation * variance / sigma**2
            if not (converged or is_start) and steps >= FIRST_STEPS:
                converged = _is_near_optimum(A, g, variance, B, length, tolerance)
                max_steps = MAX_STEPS
            if converged or steps == max_steps:
                break
            steps += 1
            if max_steps > FIRST_STEPS:
                failures, damping = 0, damping / DAMPING_FACTOR
            else:
                damping = damping / DAMPING_FACTOR if damping > MIN_DAMPING else 0.0
        copy_rows(A, damped)
        for a in range(PARAMETERS):
            damped[a, a] *= 1 + damping
        if not solve_symmetric(damped, g, B, delta):
            break
        copy_row(best, q)
        q[0] += min(max(delta[0], -1.0), 1.0)
        q[1] += min(max(delta[1], -2.0 / length), 2.0 / length)
        q[2] += delta[2]
        q[3] = max(q[3] + delta[3], MIN_CONTRAST / 2)
        q[4] = min(max(q[4] + min(max(delta[4], -0.3), 0.3), MIN_BLUR_PX), MAX_BLUR_PX)
        q[5] += delta[5]
        q[6] += min(max(delta[6], -0.4), 0.4)
    copy_row(best, q)
    if failures:  # the rows are those of a step that failed
        normal_equations(xs, ys, grey, count, nx, ny, q, limit, rows, B)
    return informative, used, variance, converged


@compiled()
def _is_near_optimum(A, g, variance, L, length, tolerance):  # type: ignore[no-untyped-def]
    """Return whether the line is near the solution of A x = g, by its standard deviation."""
    unit, x, step = np.zeros(PARAMETERS), np.empty(PARAMETERS), np.empty(PARAMETERS)
    unit[0] = 1.0
    if not (solve_symmetric(A, unit, L, x) and solve_symmetric(A, g, L, step)):
        return False
    moved = abs(step[0]) + abs(step[1]) * length / 2
    return moved < max(CONVERGED_SIGMAS * math.sqrt(variance * x[0]), tolerance)


@compiled(fastmath=True)
def normal_equations(  # type: ignore[no-untyped-def]
    xs, ys, grey, count, nx, ny, q, limit, rows, B
):
    """Put the normal equations of a step into B (PARAMETERS + 1, PARAMETERS + 1), residuals last.

    It works on columns and has no branches, so the processor handles several pixels at once.

    Returns:
        How many pixels carry information, how many are not left out, and the sum of squares of all,
        none above the limit's.
    """
    offset, angle, low, step, blur, light, overshoot = q
    by_offset, by_angle, by_low, by_step, by_blur, by_light, by_overshoot, residual = (
        rows[0],
        rows[1],
        rows[2],
        rows[3],
        rows[4],
        rows[5],
        rows[6],
        rows[7],
    )
    wide_blur = math.sqrt(blur * blur + MASK_PX * MASK_PX)
    inverse, inverse_wide, informative, used, cost = 1 / blur, 1 / wide_blur, 0.0, 0.0, 0.0
    grown, part_wide = (1 + overshoot) * inverse, overshoot * inverse_wide
    blur_wide = part_wide * blur * inverse_wide
    for m in range(count):
        s = -ny * xs[m] + nx * ys[m]
        distance = nx * xs[m] + ny * ys[m] - offset - angle * s
        d, dw = distance * inverse, distance * inverse_wide
        place = (min(max(d, -TABLE_END), TABLE_END) + TABLE_END) * TABLE_RESOLUTION
        entry = np.int32(place + 0.5)
        part = (place - entry) / TABLE_RESOLUTION
        f = _DENSITY[entry]
        p = _PHI[entry] + part * f  # Taylor series: error at most 5e-7
        f -= part * d * f
        place = (min(max(dw, -TABLE_END), TABLE_END) + TABLE_END) * TABLE_RESOLUTION
        entry = np.int32(place + 0.5)
        part = (place - entry) / TABLE_RESOLUTION
        fw = _DENSITY[entry]
        pw = _PHI[entry] + part * fw
        fw -= part * dw * fw
        gain, profile = 1 + light * s, p + overshoot * (p - pw)
        level = low + step * profile
        r = grey[m] - level * gain
        inside = 1.0 if abs(r) < limit else 0.0
        too_bright = 1.0 if grey[m] > BRIGHTEST and r < 0 else 0.0
        too_dark = 1.0 if grey[m] < DARKEST and r > 0 else 0.0
        weight = inside * (1 - too_bright) * (1 - too_dark)
        clipped = max(too_bright, too_dark)
        used += max(inside, clipped)
        cost += (1 - clipped) * min(r * r, limit * limit)
        informative += weight
        gain *= weight
        slope = -step * gain * (f * grown - fw * part_wide)
        by_offset[m], by_angle[m] = slope, slope * s
        by_low[m], by_step[m], by_light[m] = gain, profile * gain, level * s * weight
        by_blur[m] = -step * gain * (f * d * grown - fw * dw * blur_wide)
        by_overshoot[m] = step * gain * (p - pw)
        residual[m] = r * weight
    for a in range(PARAMETERS + 1):
        for b in range(a, PARAMETERS + 1):
            total = 0.0
            for m in range(count):
                total += rows[a, m] * rows[b, m]
            B[a, b] = B[b, a] = total
    return int(informative), int(used), cost


@compiled()
def solve_symmetric(A, g, L, x):  # type: ignore[no-untyped-def]
    """Solve A x = g for a few unknowns by Cholesky's factors; a library's call would take longer.

    Args:
        A: Symmetric matrix (n, n).
        g: Right side (n,).
        L: Room for the factor.
        x: Solution (n,), written in place.

    Returns:
        Whether A is positive definite.
    """
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
