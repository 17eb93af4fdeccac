"""Align frames of markers with their rest pose by rigid motions, all frames at once.

The rotation that fits best by weighted least squares (Kabsch 1976) is the eigenvector of the
largest eigenvalue of a symmetric 4 x 4 matrix (Horn 1987): always a rotation, never a reflection.
Half the distance to the next eigenvalue shows how well the rotation is determined about its weakest
axis. For a frame of the shape of the rest pose, it is the markers' weighted mean square distance
from the line that fits them best.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError

#: Smallest width of the markers, relative to their extent along the line that fits them best.
#: Narrower markers do not determine a rotation.
MIN_WIDTH = 0.05
#: Largest standard deviation of the rotation about its weakest axis, rad.
MAX_ROTATION_SIGMA = 0.1
CHUNK_FRAMES = 256  # aligned at once, to fit in the cache


@dataclass(frozen=True)
class Aligned:
    """t frames of m markers in the rest frame: rest = R p + T.

    Attributes:
        points: Positions (t, m, 3), mm, NaN where not visible.
        rotation: Rotations R (t, 3, 3).
        translation: Translations T (t, 3), mm.
        residual: Root mean square distances from the rest pose over the used markers (t,), mm.
        variance: Variances of the positions along the axes (t, m, 3), mm^2, including that of the
            alignment; NaN without sigma.
        covariance: Covariances of the positions (t, m, 3, 3), mm^2; NaN without sigma or if not
            requested.
        rotation_sigma: Standard deviations of the rotation about its weakest axis (t,), rad.
        used: Numbers of markers used (t,).
        ok: Whether a frame was aligned (t,). Other frames are NaN in all arrays but `used`.
    """

    points: Float
    rotation: Float
    translation: Float
    residual: Float
    variance: Float
    covariance: Float
    rotation_sigma: Float
    used: Int
    ok: Bool

    @property
    def sigma(self) -> Float:
        """Standard deviations along the axes of the rest frame (t, m, 3), mm."""
        out = np.maximum(self.variance, 0.0)
        return np.asarray(np.sqrt(out, out=out))


def align(
    points: Float,
    rest: Float,
    weights: Float | None = None,
    mask: Bool | None = None,
    *,
    sigma: Float | None = None,
    ids: Int | None = None,
    with_covariances: bool = True,
) -> Aligned:
    """Align frames of markers with a rest pose.

    A frame is not aligned if it shows fewer than three of the selected markers, or if their width w
    (the root mean square distance from the line that fits best) is at most `MIN_WIDTH` of their
    extent along it. With the singular values a >= b >= c of the weighted, centered rest pose, this
    is sqrt(b^2 + c^2) <= MIN_WIDTH a. The same limit holds for the frame itself. With `sigma`, a
    frame is not aligned either if noise turns it by more than `MAX_ROTATION_SIGMA` (for equal sigma
    and weights: sigma / (w sqrt(markers))).

    Args:
        points: Positions (t, m, 3), mm, NaN where not visible.
        rest: Rest pose (m, 3), mm, NaN where not known.
        weights: Weights (m,) or (t, m); equal by default.
        mask: Markers that are used (m,) or (t, m), all by default; the others are moved along.
        sigma: Standard deviations (t, m, 3), mm, or covariances (t, m, 3, 3), mm^2, of the points.
        ids: Numbers of the markers (m,), for messages.
        with_covariances: Whether to return whole covariances, which take much memory.

    Raises:
        CaptureError: If the rest pose itself does not determine a rotation, a weight is invalid, or
            shapes do not fit.
    """
    t, m = points.shape[:2]
    numbers = np.arange(m) if ids is None else ids
    _check_shapes(points, rest, weights, mask, sigma, numbers)
    visible = np.asarray(np.isfinite(points).all(axis=2))
    has_rest = np.asarray(np.isfinite(rest).all(axis=1))
    selected = has_rest & np.broadcast_to(True if mask is None else mask, (t, m))
    used, w = _normalize_weights(visible & selected, weights, numbers)
    usable = (
        has_rest & _has_weight(weights, m) & (True if mask is None else np.atleast_2d(mask).any(0))
    )
    _check_rest(rest, usable, numbers)
    # Without sigma, a view of one value takes no memory.
    variance, covariance = (np.broadcast_to(np.nan, (t, m, *n)) for n in ((3,), (3, 3)))
    if sigma is not None:
        variance = np.empty((t, m, 3))
        covariance = np.empty((t, m, 3, 3)) if with_covariances else covariance
    out = Aligned(
        np.empty((t, m, 3)),
        np.empty((t, 3, 3)),
        np.empty((t, 3)),
        np.empty(t),
        variance,
        covariance,
        np.empty(t),
        used.sum(axis=1),
        np.empty(t, bool),
    )
    shift = rest[usable].mean(axis=0)  # near zero, so that squares keep their digits
    for k in range(0, t, CHUNK_FRAMES):
        part = slice(k, k + CHUNK_FRAMES)
        is_visible = np.isfinite(points[part]).all(axis=2, keepdims=True)
        frames = np.where(is_visible, points[part], np.nan)
        part_sigma = None if sigma is None else sigma[part]
        _align(
            frames,
            rest,
            shift,
            used[part],
            w[part],
            part_sigma,
            _part_of(out, part),
        )
    return out


def _part_of(of: Aligned, part: slice) -> Aligned:
    """Return some of the frames as views of the same memory."""
    return Aligned(**{f.name: getattr(of, f.name)[part] for f in fields(Aligned)})


def _align(
    points: Float,
    rest: Float,
    shift: Float,
    used: Bool,
    w: Float,
    sigma: Float | None,
    result: Aligned,
) -> None:
    """Align frames (t, m, 3) and write the results.

    Args:
        points: Positions (t, m, 3), mm.
        rest: Rest pose (m, 3), mm.
        shift: Point near the middle of the rest pose (3,), mm.
        used: Markers used (t, m).
        w: Weights (t, m) of sum 1.
        sigma: Standard deviations or covariances of the points.
        result: Receives all but its `used`.
    """
    t, m = used.shape
    has_rest = np.asarray(np.isfinite(rest).all(axis=1))
    x, y = np.where(has_rest[:, None], rest - shift, 0.0), np.where(used[..., None], points, 0.0)
    rest_center, center = w @ x, (w[:, None] @ y)[:, 0]
    squares = (w @ np.einsum("mi,mj->mij", x, x).reshape(m, 9)).reshape(t, 3, 3)
    along, width = scatter_extents(squares - rest_center[:, :, None] * rest_center[:, None])
    y -= center[:, None]
    y *= w[..., None]
    R, firmness = _rotation(y.swapaxes(1, 2) @ x)
    rest_center += shift
    ok = (result.used >= 3) & (np.minimum(width, firmness) > MIN_WIDTH**2 * along)

    R[~ok], center[~ok] = np.nan, np.nan
    out = (points - center[:, None]) @ R.swapaxes(1, 2) + rest_center[:, None]
    deviation = out - rest
    squares_sum = np.where(used, np.einsum("tmi,tmi->tm", deviation, deviation), 0.0).sum(axis=1)
    result.rotation_sigma[:] = np.nan
    if sigma is not None:
        covariance, result.rotation_sigma[:] = _propagate(
            rotate_covariances(sigma, R), out - rest_center[:, None], w, ok
        )
        ok &= ~(result.rotation_sigma > MAX_ROTATION_SIGMA)
        for array in (R, out, center, covariance, result.rotation_sigma):
            array[~ok] = np.nan
        result.variance[:] = np.einsum("tmii->tmi", covariance)
        if result.covariance.flags.writeable:
            result.covariance[:] = covariance
    result.points[:], result.rotation[:], result.ok[:] = out, R, ok
    result.residual[:] = np.where(ok, np.sqrt(squares_sum / np.maximum(result.used, 1)), np.nan)
    result.translation[:] = rest_center - np.einsum("tij,tj->ti", R, center)


def rotate_covariances(sigma: Float, rotation: Float) -> Float:
    """Return the covariances of rotated points.

    Args:
        sigma: Standard deviations (t, m, 3), mm, or covariances (t, m, 3, 3), mm^2.
        rotation: Rotations (t, 3, 3).

    Returns:
        Covariances (t, m, 3, 3), mm^2.
    """
    t, m = sigma.shape[:2]
    if sigma.ndim == 3:  # R diag(v) R^T and R C R^T are linear in v and C
        by = np.einsum("tik,tjk->tijk", rotation, rotation).reshape(t, 9, 3)
        flat = sigma**2
    else:
        by = np.einsum("tik,tjl->tijkl", rotation, rotation).reshape(t, 9, 9)
        flat = sigma.reshape(t, m, 9)
    return np.asarray((flat @ by.swapaxes(1, 2)).reshape(t, m, 3, 3))


def _normalize_weights(used: Bool, weights: Float | None, names: Int) -> tuple[Bool, Float]:
    """Return which markers count (t, m), and their weights (t, m) of sum 1."""
    given = np.broadcast_to(1.0 if weights is None else weights, used.shape)
    wrong = used & ~(np.isfinite(given) & (given >= 0))
    if wrong.any():
        frame, k = (int(i) for i in np.argwhere(wrong)[0])
        raise CaptureError(
            f"marker {names[k]} has weight {given[frame, k]:g} in frame {frame}",
            code="out-of-range",
            where="alignment",
            action="Give weights of 0 or more",
            marker=int(names[k]),
            frame=frame,
        )
    w = np.where(used, given, 0.0)
    total = w.sum(axis=1, keepdims=True)
    return np.asarray(w > 0), np.asarray(w / np.where(total > 0, total, 1.0))


def _has_weight(weights: Float | None, m: int) -> Bool:
    """Return which markers (m,) have a weight in some frame."""
    if weights is None or weights.size == 0:
        return np.ones(m, bool)
    return np.asarray((np.atleast_2d(weights) > 0).any(axis=0))


def scatter_extents(scatter: Float) -> tuple[Float, Float]:
    """Return mean squares (t,), mm^2, along the best line and off it, for scatter (t, 3, 3)."""
    along = np.asarray(np.linalg.eigvalsh(scatter)[:, -1])
    return along, np.asarray(np.trace(scatter, axis1=1, axis2=2) - along)


def _rotation(S: Float) -> tuple[Float, Float]:
    """Return the rotations of points onto the rest pose.

    Args:
        S: Sums (t, 3, 3) of products of points and rest.

    Returns:
        Rotations (t, 3, 3), and how firmly each is determined (t,), mm^2: s2 + s3 of the singular
        values of S, with s3 having the sign of its determinant.
    """
    N = np.empty((len(S), 4, 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        N[:, i + 1, i + 1] = S[:, i, i] - S[:, j, j] - S[:, k, k]
        N[:, 0, i + 1] = N[:, i + 1, 0] = S[:, j, k] - S[:, k, j]
        N[:, j + 1, k + 1] = N[:, k + 1, j + 1] = S[:, j, k] + S[:, k, j]
    N[:, 0, 0] = np.trace(S, axis1=1, axis2=2)
    values, vectors = np.linalg.eigh(N)
    a, b, c, d = vectors[:, :, 3].T
    R = np.empty_like(S)
    R[:, 0, 0], R[:, 0, 1], R[:, 0, 2] = (
        1 - 2 * (c * c + d * d),
        2 * (b * c - a * d),
        2 * (b * d + a * c),
    )
    R[:, 1, 0], R[:, 1, 1], R[:, 1, 2] = (
        2 * (b * c + a * d),
        1 - 2 * (b * b + d * d),
        2 * (c * d - a * b),
    )
    R[:, 2, 0], R[:, 2, 1], R[:, 2, 2] = (
        2 * (b * d - a * c),
        2 * (c * d + a * b),
        1 - 2 * (b * b + c * c),
    )
    return R, (values[:, 3] - values[:, 2]) / 2


def _propagate(S: Float, placed: Float, w: Float, ok: Bool) -> tuple[Float, Float]:
    """Return the uncertainty of aligned points, to first order.

    An error e of point k moves point i by e for i = k, and by -w (1 - [i] B [k]) e with the motion
    of all points; [k] takes the cross product with k, and B is the inverse of sum w (k.k - k k^T).

    Args:
        S: Covariances of the points (t, m, 3, 3), mm^2.
        placed: Positions about the weighted middle (t, m, 3), mm.
        w: Weights (t, m) of sum 1.
        ok: Frames to evaluate (t,).

    Returns:
        Covariances of the aligned points (t, m, 3, 3), mm^2, and the standard deviations of the
        rotation (t,), rad.
    """
    S = np.ascontiguousarray(np.moveaxis(S, (0, 1), (2, 3)))  # the fastest order for sums
    on = w > 0
    K, Ku = _cross_matrices(placed), _cross_matrices(np.where(on[..., None], placed, 0.0))
    Kw, Su = Ku * w, np.where(on, S, 0.0)
    inertia = np.einsum("ijtm,kjtm->tik", Kw, Ku)
    inertia[~ok] = np.eye(3)
    B = np.linalg.inv(inertia)
    KS = _matrix_product(Ku, Su)
    shift = np.einsum("ijtm,tm->ijt", Su, w * w)[..., None]
    mixed = np.moveaxis(B @ np.einsum("ijtm,tm->tij", KS, w * w), 0, 2)[..., None]
    spin = B @ np.einsum("ijtm,kjtm->tik", KS * w, Kw) @ B
    turning = _matrix_product(Ku, np.moveaxis(B, 0, 2)[..., None])
    half = w * (Su - _matrix_product(turning, KS)) + _matrix_product(K, mixed)
    rocked = _matrix_product(_matrix_product(K, np.moveaxis(spin, 0, 2)[..., None]), K)  # K^T = -K
    out = S + shift - half - half.swapaxes(0, 1) - rocked
    known = np.isfinite(spin).all(axis=(1, 2))
    turn = np.full(len(w), np.nan)
    turn[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(spin[known])[:, -1], 0.0))
    return np.moveaxis(out, (2, 3), (0, 1)), turn


def _cross_matrices(r: Float) -> Float:
    """Return the matrices (3, 3, t, m) that take the cross product with r (t, m, 3)."""
    x, y, z = (np.ascontiguousarray(r[..., i]) for i in range(3))
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]])


def _matrix_product(a: Float, b: Float) -> Float:
    """Multiply matrices (3, 3, ...)."""
    return np.asarray(np.einsum("ij...,jk...->ik...", a, b))


def _check_shapes(
    points: Float,
    rest: Float,
    weights: Float | None,
    mask: Bool | None,
    sigma: Float | None,
    numbers: Int,
) -> None:
    t, m = points.shape[:2]
    per_marker = ((m,), (t, m))
    is_valid = (
        points.shape == (t, m, 3) and rest.shape == (m, 3) and numbers.shape == (m,),
        weights is None or weights.shape in per_marker,
        mask is None or mask.shape in per_marker,
        sigma is None or sigma.shape in ((t, m, 3), (t, m, 3, 3)),
    )
    if not all(is_valid):
        shapes = [None if a is None else a.shape for a in (rest, weights, mask, sigma, numbers)]
        raise CaptureError(
            "points {} do not fit rest {}, weights {}, mask {}, sigma {} and numbers {}".format(
                points.shape, *shapes
            ),
            code="wrong-shape",
            where="alignment",
            action="Pass arrays of the same frames and markers",
        )


def _check_rest(rest: Float, usable: Bool, numbers: Int) -> None:
    """Raise CaptureError for a rest pose that does not determine a rotation."""
    listed = ", ".join(str(n) for n in numbers[usable]) or "none"
    if usable.sum() < 3:
        raise CaptureError(
            f"{usable.sum()} markers ({listed}) have a rest position and may be used, but three are"
            " needed",
            code="too-few-markers",
            where="alignment",
            action="Choose more markers",
            markers=numbers[usable].tolist(),
        )
    centered = rest[usable] - rest[usable].mean(axis=0)
    along, width = (
        float(v[0]) for v in scatter_extents((centered.T @ centered)[None] / usable.sum())
    )
    if not width > MIN_WIDTH**2 * along:
        raise CaptureError(
            f"markers {listed} are nearly on one line at rest"
            f" ({np.sqrt(max(width, 0.0)):.2g} mm off it, {np.sqrt(along):.2g} mm along it, root"
            " mean squares)",
            code="markers-on-one-line",
            where="alignment",
            action="Add a marker off the line",
            markers=numbers[usable].tolist(),
        )
