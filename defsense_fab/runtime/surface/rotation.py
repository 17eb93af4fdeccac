"""The rotation nearest to a 3 x 3 matrix, in closed form but for one root.

F. L. Markley, "Attitude determination using vector observations: a fast optimal matrix algorithm",
J. Astronautical Sciences 41 (1993): of B = R S the sum lambda of the singular values, the smallest
counted negative where det B < 0, is the largest root of a quartic; R follows from it without
eigenvectors. Never a reflection.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled

# Where a body of which nothing is fixed stands as a whole.


def rigid_fit(points: Float, onto: Float, weights: Float) -> tuple[Float, Float]:
    """Rotation (3, 3) and shift (3,) mm with the least squares of `points` (m, 3) moved `onto`
    (m, 3), by weights (m,) (W. Kabsch, Acta Cryst. A 32 (1976))."""
    w = weights / weights.sum()
    a, b = w @ points, w @ onto
    rotation = nearest_rotations(((onto - b).T @ ((points - a) * w[:, None]))[None])[0]
    return rotation, b - rotation @ a


_ROUNDS = 60  # of Newton's method; most take one to five
_TINY = 1e-9  # of the largest value that the denominator can have: no rotation is nearest


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def nearest_rotation(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> tuple[bool, Any]:
    """Whether there is one, and the rotation R, row by row, with the largest trace of R^T B, of
    B = [[a, b, c], [d, e, f], [g, h, i]]."""
    norm = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
    zero = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    if norm < 1e-200:
        return False, zero
    s = 1.0 / math.sqrt(norm)
    a, b, c, d, e, f, g, h, i = a * s, b * s, c * s, d * s, e * s, f * s, g * s, h * s, i * s
    # Cofactors, and the characteristic polynomial of Davenport's matrix.
    ca, cb, cc = e * i - f * h, f * g - d * i, d * h - e * g
    cd, ce, cf = c * h - b * i, a * i - c * g, b * g - a * h
    cg, ch, ci = b * f - c * e, c * d - a * f, a * e - b * d
    det = a * ca + b * cb + c * cc
    square = ca * ca + cb * cb + cc * cc + cd * cd + ce * ce + cf * cf
    square += cg * cg + ch * ch + ci * ci
    p1, p0 = -8.0 * det, 1.0 - 4.0 * square
    # lambda^2 = 1 + 2 (s2 s3 + s3 s1 + s1 s2): it starts with that of a flat B.
    root = math.sqrt(1.0 + 2.0 * math.sqrt(square))
    for _ in range(_ROUNDS):
        r2 = root * root
        slope = 4.0 * root * (r2 - 1.0) + p1
        if slope <= 0.0:
            break
        step = ((r2 - 2.0) * r2 + p1 * root + p0) / slope
        root -= step
        if abs(step) < 1e-9:  # squared by the last step
            break
    half = 0.5 * (root * root + 1.0)
    below = 0.5 * (root * root - 1.0) * root - det
    if below < _TINY:
        return False, zero
    z = 1.0 / below
    # B B^T, which is symmetric.
    xx, xy, xz = a * a + b * b + c * c, a * d + b * e + c * f, a * g + b * h + c * i
    yy, yz, zz = d * d + e * e + f * f, d * g + e * h + f * i, g * g + h * h + i * i
    return True, (
        (half * a + root * ca - xx * a - xy * d - xz * g) * z,
        (half * b + root * cb - xx * b - xy * e - xz * h) * z,
        (half * c + root * cc - xx * c - xy * f - xz * i) * z,
        (half * d + root * cd - xy * a - yy * d - yz * g) * z,
        (half * e + root * ce - xy * b - yy * e - yz * h) * z,
        (half * f + root * cf - xy * c - yy * f - yz * i) * z,
        (half * g + root * cg - xz * a - yz * d - zz * g) * z,
        (half * h + root * ch - xz * b - yz * e - zz * h) * z,
        (half * i + root * ci - xz * c - yz * f - zz * i) * z,
    )


@compiled()
def nearest_rotations(matrices: Float) -> Float:
    """(m, 3, 3) of matrices (m, 3, 3); the identity where none is nearest."""
    out = np.empty_like(matrices)
    for k in range(len(matrices)):
        b = matrices[k]
        _, r = nearest_rotation(
            b[0, 0], b[0, 1], b[0, 2], b[1, 0], b[1, 1], b[1, 2], b[2, 0], b[2, 1], b[2, 2]
        )
        for i in range(9):
            out[k, i // 3, i % 3] = r[i]
    return out


#: Matrices that are taken at once, each entry of them side by side.
LANES = 16
_STEPS = 6  # of Newton's method: what has not converged then is left to `nearest_rotation`


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def nearest_of_many(entries: Float, settled: Float) -> None:
    """Replace `entries` (9 LANES,) of matrices B by those of their rotations, as `nearest_rotation`
    finds them, where `settled` (LANES,) becomes 1, and by something else where it becomes 0."""
    for k in range(LANES):
        a, b, c = entries[k], entries[LANES + k], entries[2 * LANES + k]
        d, e, f = entries[3 * LANES + k], entries[4 * LANES + k], entries[5 * LANES + k]
        g, h, i = entries[6 * LANES + k], entries[7 * LANES + k], entries[8 * LANES + k]
        norm = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
        s = 1.0 / math.sqrt(norm + 1e-300)
        a, b, c, d, e, f, g, h, i = a * s, b * s, c * s, d * s, e * s, f * s, g * s, h * s, i * s
        ca, cb, cc = e * i - f * h, f * g - d * i, d * h - e * g
        cd, ce, cf = c * h - b * i, a * i - c * g, b * g - a * h
        cg, ch, ci = b * f - c * e, c * d - a * f, a * e - b * d
        det = a * ca + b * cb + c * cc
        square = ca * ca + cb * cb + cc * cc + cd * cd + ce * ce + cf * cf
        square += cg * cg + ch * ch + ci * ci
        p1, p0 = -8.0 * det, 1.0 - 4.0 * square
        root, step = math.sqrt(1.0 + 2.0 * math.sqrt(square)), 0.0
        for _ in range(_STEPS):
            r2 = root * root
            slope = 4.0 * root * (r2 - 1.0) + p1
            step = ((r2 - 2.0) * r2 + p1 * root + p0) / (slope + 1e-300)
            root -= step
        half = 0.5 * (root * root + 1.0)
        below = 0.5 * (root * root - 1.0) * root - det
        z = 1.0 / (below + 1e-300)
        settled[k] = 1.0 if (abs(step) < 1e-9) & (below > _TINY) & (norm > 1e-200) else 0.0
        xx, xy, xz = a * a + b * b + c * c, a * d + b * e + c * f, a * g + b * h + c * i
        yy, yz, zz = d * d + e * e + f * f, d * g + e * h + f * i, g * g + h * h + i * i
        entries[k] = (half * a + root * ca - xx * a - xy * d - xz * g) * z
        entries[LANES + k] = (half * b + root * cb - xx * b - xy * e - xz * h) * z
        entries[2 * LANES + k] = (half * c + root * cc - xx * c - xy * f - xz * i) * z
        entries[3 * LANES + k] = (half * d + root * cd - xy * a - yy * d - yz * g) * z
        entries[4 * LANES + k] = (half * e + root * ce - xy * b - yy * e - yz * h) * z
        entries[5 * LANES + k] = (half * f + root * cf - xy * c - yy * f - yz * i) * z
        entries[6 * LANES + k] = (half * g + root * cg - xz * a - yz * d - zz * g) * z
        entries[7 * LANES + k] = (half * h + root * ch - xz * b - yz * e - zz * h) * z
        entries[8 * LANES + k] = (half * i + root * ci - xz * c - yz * f - zz * i) * z
