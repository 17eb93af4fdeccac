"""Find the rotation nearest to a 3 x 3 matrix, in closed form except for one root.

Of B = R S, the sum lambda of the singular values, the smallest counted negative if det B < 0, is
the largest root of a quartic. R follows from it without eigenvectors, and is never a reflection.

References:
    F. L. Markley, "Attitude determination using vector observations: a fast optimal matrix
    algorithm", J. Astronautical Sciences 41 (1993).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled


def rigid_fit(points: Float, onto: Float, weights: Float) -> tuple[Float, Float]:
    """Align points rigidly with others, by weighted least squares.

    Args:
        points: Points to move (m, 3), mm.
        onto: Points to move them onto (m, 3), mm.
        weights: Weights (m,).

    Returns:
        Rotation (3, 3) and shift (3,), mm.

    References:
        W. Kabsch, Acta Cryst. A 32 (1976).
    """
    w = weights / weights.sum()
    a, b = w @ points, w @ onto
    rotation = nearest_rotations(((onto - b).T @ ((points - a) * w[:, None]))[None])[0]
    return rotation, b - rotation @ a


_MAX_NEWTON_STEPS = 60  # most matrices need one to five
_MIN_DENOMINATOR = 1e-9  # of its largest value; denominator it no rotation is nearest


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def nearest_rotation(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> tuple[bool, Any]:
    """Find the rotation R with the largest trace of R^T B, B = [[a, b, c], [d, e, f], [g, h, i]].

    Returns:
        Whether there is one, and R row by row.
    """
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
    # lambda^2 = 1 + 2 (s2 s3 + s3 s1 + s1 s2); the start is that of a flat B.
    root = math.sqrt(1.0 + 2.0 * math.sqrt(square))
    for _ in range(_MAX_NEWTON_STEPS):
        r2 = root * root
        slope = 4.0 * root * (r2 - 1.0) + p1
        if slope <= 0.0:
            break
        step = ((r2 - 2.0) * r2 + p1 * root + p0) / slope
        root -= step
        if abs(step) < 1e-9:  # the last step squares the error
            break
    half = 0.5 * (root * root + 1.0)
    denominator = 0.5 * (root * root - 1.0) * root - det
    if denominator < _MIN_DENOMINATOR:
        return False, zero
    z = 1.0 / denominator
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
    """Return the nearest rotations (m, 3, 3) of matrices (m, 3, 3); identities where none exist."""
    out = np.empty_like(matrices)
    for k in range(len(matrices)):
        b = matrices[k]
        _, r = nearest_rotation(
            b[0, 0], b[0, 1], b[0, 2], b[1, 0], b[1, 1], b[1, 2], b[2, 0], b[2, 1], b[2, 2]
        )
        for i in range(9):
            out[k, i // 3, i % 3] = r[i]
    return out


#: Number of matrices that are processed together, with corresponding entries side by side.
LANES = 16
_FIXED_NEWTON_STEPS = 6  # matrices that need more are left to `nearest_rotation`


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def nearest_of_many(entries: Float, converged: Float) -> None:
    """Replace matrices by their nearest rotations, as of `nearest_rotation`.

    Args:
        entries: Entries of the matrices (9 LANES,), replaced.
        converged: Set to 1 for each matrix whose rotation was found, else to 0 (LANES,).
    """
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
        for _ in range(_FIXED_NEWTON_STEPS):
            r2 = root * root
            slope = 4.0 * root * (r2 - 1.0) + p1
            step = ((r2 - 2.0) * r2 + p1 * root + p0) / (slope + 1e-300)
            root -= step
        half = 0.5 * (root * root + 1.0)
        denominator = 0.5 * (root * root - 1.0) * root - det
        z = 1.0 / (denominator + 1e-300)
        converged[k] = (
            1.0 if (abs(step) < 1e-9) & (denominator > _MIN_DENOMINATOR) & (norm > 1e-200) else 0.0
        )
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
