"""Frames of markers laid onto their rest pose by rigid motions, all frames at once.

The rotation that fits best by weighted least squares (Kabsch 1976) is the eigenvector of the
largest eigenvalue of a symmetric 4 x 4 matrix (Horn 1987): always a rotation, never a reflection.
Half the distance to the next eigenvalue says how firmly it is held about its weakest axis: where
the frame has the shape of the rest pose, it is the markers' mean square distance, with weights,
from the line that fits them best.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError

#: Markers nearer to one line than this part of their extent along it do not give a rotation.
NARROW = 0.05
#: Nor do those that leave a rotation with a larger standard deviation about its weakest axis, rad.
DOUBT = 0.1
_CHUNK = 256  # frames aligned at once: what a cache holds


@dataclass(frozen=True)
class Aligned:
    """t frames of m markers in the rest frame: `points` (t, m, 3) mm, NaN where not seen; in rest =
    R p + T, `rotation` (t, 3, 3) and `translation` (t, 3) mm; `residual` (t,) mm, the root mean
    square distance from the rest pose over the `used` (t,) markers; `variance` (t, m, 3) mm^2 of
    the points along the axes and their `covariance` (t, m, 3, 3) mm^2, with what the alignment adds
    (NaN where no sigma was given, or it was not asked for), and `turn` (t,) rad, the standard
    deviation of the rotation about its weakest axis. Frames that are not `ok` (t,) are NaN in all
    but `used`."""

    points: Float
    rotation: Float
    translation: Float
    residual: Float
    variance: Float
    covariance: Float
    turn: Float
    used: Int
    ok: Bool

    @property
    def sigma(self) -> Float:
        """Standard deviations (t, m, 3) mm along the axes of the rest frame."""
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
    doubt: float = DOUBT,
    covariances: bool = True,
) -> Aligned:
    """Frames `points` (t, m, 3) mm, NaN where not seen, onto `rest` (m, 3) mm, NaN where not known.

    Markers are used where `mask` (m,) or (t, m) has them, with `weights` (m,) or (t, m); the others
    go along. A frame is not aligned with fewer than three of them, or where their width w (root
    mean square distance from the line that fits best) is at most `NARROW` of their extent along it:
    with the singular values a >= b >= c of the weighted rest pose about its middle, sqrt(b^2 + c^2)
    <= NARROW a; nor where the frame itself gives no more. With `sigma`, standard deviations
    (t, m, 3) mm or covariances (t, m, 3, 3) mm^2 of the points, nor where noise turns it by more
    than `doubt` rad (equal sigma and weights: sigma / (w sqrt(markers))). Whole `covariances` of
    many frames take much memory.

    Raises CaptureError, with the numbers `ids` (m,) of markers, where the rest pose is such a set
    itself, weights are none, or shapes do not fit.
    """
    t, m = points.shape[:2]
    names = np.arange(m) if ids is None else ids
    _check_shapes(points, rest, weights, mask, sigma, names)
    seen = np.asarray(np.isfinite(points).all(axis=2))
    known = np.asarray(np.isfinite(rest).all(axis=1))
    chosen = known & np.broadcast_to(True if mask is None else mask, (t, m))
    used, w = _normalised(seen & chosen, weights, names)
    ever = known & _weighty(weights, m) & (True if mask is None else np.atleast_2d(mask).any(0))
    _check_rest(rest, ever, names)
    # One value stands for all where nothing is known: a view of it takes no memory.
    variance, covariance = (np.broadcast_to(np.nan, (t, m, *n)) for n in ((3,), (3, 3)))
    if sigma is not None:
        variance = np.empty((t, m, 3))
        covariance = np.empty((t, m, 3, 3)) if covariances else covariance
    out = Aligned(
        np.empty((t, m, 3)), np.empty((t, 3, 3)), np.empty((t, 3)), np.empty(t), variance,
        covariance, np.empty(t), used.sum(axis=1), np.empty(t, bool),
    )  # fmt: skip
    shift = rest[ever].mean(axis=0)  # near zero, squares keep their digits
    for k in range(0, t, _CHUNK):
        part = slice(k, k + _CHUNK)
        there = np.isfinite(points[part]).all(axis=2, keepdims=True)
        frames = np.where(there, points[part], np.nan)
        spread = None if sigma is None else sigma[part]
        _align(frames, rest, shift, used[part], w[part], spread, doubt, _rows(out, part))
    return out


def _rows(of: Aligned, part: slice) -> Aligned:
    """Some of the frames, as views of the same memory."""
    return Aligned(**{f.name: getattr(of, f.name)[part] for f in fields(Aligned)})


def _align(
    points: Float, rest: Float, shift: Float, used: Bool, w: Float, sigma: Float | None,
    doubt: float, into: Aligned,
) -> None:  # fmt: skip
    """Align some frames (t, m, 3) by the `used` (t, m) markers with weights w (t, m) of sum 1, and
    write what is found `into` all but its `used`; `shift` (3,) mm is about the middle of the rest
    pose."""
    t, m = used.shape
    known = np.asarray(np.isfinite(rest).all(axis=1))
    x, y = np.where(known[:, None], rest - shift, 0.0), np.where(used[..., None], points, 0.0)
    middle, center = w @ x, (w[:, None] @ y)[:, 0]
    squares = (w @ np.einsum("mi,mj->mij", x, x).reshape(m, 9)).reshape(t, 3, 3)
    along, width = extents(squares - middle[:, :, None] * middle[:, None])
    y -= center[:, None]
    y *= w[..., None]
    R, hold = _rotation(y.swapaxes(1, 2) @ x)
    middle += shift
    ok = (into.used >= 3) & (np.minimum(width, hold) > NARROW**2 * along)

    R[~ok], center[~ok] = np.nan, np.nan
    out = (points - center[:, None]) @ R.swapaxes(1, 2) + middle[:, None]
    off = out - rest
    away = np.where(used, np.einsum("tmi,tmi->tm", off, off), 0.0).sum(axis=1)
    into.turn[:] = np.nan
    if sigma is not None:
        covariance, into.turn[:] = _uncertainty(turned(sigma, R), out - middle[:, None], w, ok)
        ok &= ~(into.turn > doubt)
        for array in (R, out, center, covariance, into.turn):
            array[~ok] = np.nan
        into.variance[:] = np.einsum("tmii->tmi", covariance)
        if into.covariance.flags.writeable:
            into.covariance[:] = covariance
    into.points[:], into.rotation[:], into.ok[:] = out, R, ok
    into.residual[:] = np.where(ok, np.sqrt(away / np.maximum(into.used, 1)), np.nan)
    into.translation[:] = middle - np.einsum("tij,tj->ti", R, center)


def turned(sigma: Float, rotation: Float) -> Float:
    """Standard deviations (t, m, 3) mm or covariances (t, m, 3, 3) mm^2 of points as covariances
    (t, m, 3, 3) mm^2 of those turned by `rotation` (t, 3, 3)."""
    t, m = sigma.shape[:2]
    if sigma.ndim == 3:  # R diag(v) R^T and R C R^T are linear in v and C
        by = np.einsum("tik,tjk->tijk", rotation, rotation).reshape(t, 9, 3)
        flat = sigma**2
    else:
        by = np.einsum("tik,tjl->tijkl", rotation, rotation).reshape(t, 9, 9)
        flat = sigma.reshape(t, m, 9)
    return np.asarray((flat @ by.swapaxes(1, 2)).reshape(t, m, 3, 3))


def _normalised(used: Bool, weights: Float | None, names: Int) -> tuple[Bool, Float]:
    """Which markers count (t, m), and weights (t, m) of sum 1 over them."""
    given = np.broadcast_to(1.0 if weights is None else weights, used.shape)
    wrong = used & ~(np.isfinite(given) & (given >= 0))
    if wrong.any():
        frame, k = (int(i) for i in np.argwhere(wrong)[0])
        raise CaptureError(
            f"alignment: marker {names[k]} has weight {given[frame, k]:g} in frame {frame}; weights"
            " are 0 or more",
            code="weight-negative",
            marker=int(names[k]),
            frame=frame,
        )
    w = np.where(used, given, 0.0)
    total = w.sum(axis=1, keepdims=True)
    return np.asarray(w > 0), np.asarray(w / np.where(total > 0, total, 1.0))


def _weighty(weights: Float | None, m: int) -> Bool:
    """Markers (m,) that have a weight at all."""
    if weights is None or weights.size == 0:
        return np.ones(m, bool)
    return np.asarray((np.atleast_2d(weights) > 0).any(axis=0))


def extents(scatter: Float) -> tuple[Float, Float]:
    """Mean squares (t,) mm^2 along the best line and away from it, of scatter (t, 3, 3)."""
    along = np.asarray(np.linalg.eigvalsh(scatter)[:, -1])
    return along, np.asarray(np.trace(scatter, axis1=1, axis2=2) - along)


def _rotation(S: Float) -> tuple[Float, Float]:
    """From sums S (t, 3, 3) of products of points and rest, rotations (t, 3, 3) of points onto
    rest, and how firmly each is held (t,) mm^2: s2 + s3 of S's singular values, s3 with the sign
    of its determinant."""
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


def _uncertainty(S: Float, placed: Float, w: Float, ok: Bool) -> tuple[Float, Float]:
    """Covariances (t, m, 3, 3) mm^2 of points aligned with weights w (t, m) of sum 1, and the
    standard deviation (t,) rad of the rotation, to first order, from the points' own covariances S
    and places about the weighted middle.

    An error e of point k moves point i by e for i = k, and by -w (1 - [i] B [k]) e with the motion
    of all; [k] takes the cross product with k, and B is the inverse of sum w (k.k - k k^T).
    """
    S = np.ascontiguousarray(np.moveaxis(S, (0, 1), (2, 3)))  # the fastest order for sums
    on = w > 0
    K, Ku = _crosses(placed), _crosses(np.where(on[..., None], placed, 0.0))
    Kw, Su = Ku * w, np.where(on, S, 0.0)
    inertia = np.einsum("ijtm,kjtm->tik", Kw, Ku)
    inertia[~ok] = np.eye(3)
    B = np.linalg.inv(inertia)
    KS = _product(Ku, Su)
    shift = np.einsum("ijtm,tm->ijt", Su, w * w)[..., None]
    mixed = np.moveaxis(B @ np.einsum("ijtm,tm->tij", KS, w * w), 0, 2)[..., None]
    spin = B @ np.einsum("ijtm,kjtm->tik", KS * w, Kw) @ B
    turning = _product(Ku, np.moveaxis(B, 0, 2)[..., None])
    half = w * (Su - _product(turning, KS)) + _product(K, mixed)
    rocked = _product(_product(K, np.moveaxis(spin, 0, 2)[..., None]), K)  # K^T = -K
    out = S + shift - half - half.swapaxes(0, 1) - rocked
    known = np.isfinite(spin).all(axis=(1, 2))
    turn = np.full(len(w), np.nan)
    turn[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(spin[known])[:, -1], 0.0))
    return np.moveaxis(out, (2, 3), (0, 1)), turn


def _crosses(r: Float) -> Float:
    """The matrices (3, 3, t, m) that take the cross product with r (t, m, 3)."""
    x, y, z = (np.ascontiguousarray(r[..., i]) for i in range(3))
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]])


def _product(a: Float, b: Float) -> Float:
    """Of matrices (3, 3, ...)."""
    return np.asarray(np.einsum("ij...,jk...->ik...", a, b))


def _check_shapes(
    points: Float,
    rest: Float,
    weights: Float | None,
    mask: Bool | None,
    sigma: Float | None,
    names: Int,
) -> None:
    t, m = points.shape[:2]
    each = ((m,), (t, m))
    fits = (
        points.shape == (t, m, 3) and rest.shape == (m, 3) and names.shape == (m,),
        weights is None or weights.shape in each,
        mask is None or mask.shape in each,
        sigma is None or sigma.shape in ((t, m, 3), (t, m, 3, 3)),
    )
    if not all(fits):
        shapes = [None if a is None else a.shape for a in (rest, weights, mask, sigma, names)]
        raise CaptureError(
            "alignment: points {} do not go with rest {}, weights {}, mask {}, sigma {} and"
            " numbers {}".format(points.shape, *shapes),
            code="shape-wrong",
        )


def _check_rest(rest: Float, used: Bool, names: Int) -> None:
    """Raises CaptureError where the rest pose gives no rotation, whatever is seen of it."""
    said = ", ".join(str(n) for n in names[used]) or "none"
    if used.sum() < 3:
        raise CaptureError(
            f"alignment: {used.sum()} markers ({said}) have a rest position and may be used; three"
            " are needed: choose more",
            code="markers-too-few",
            markers=names[used].tolist(),
        )
    placed = rest[used] - rest[used].mean(axis=0)
    along, width = (float(v[0]) for v in extents((placed.T @ placed)[None] / used.sum()))
    if not width > NARROW**2 * along:
        raise CaptureError(
            f"alignment: markers {said} lie on one line at rest, or nearly"
            f" ({np.sqrt(max(width, 0.0)):.2g} mm off it, {np.sqrt(along):.2g} mm along it, root"
            " mean squares); add one beside it",
            code="markers-on-one-line",
            markers=names[used].tolist(),
        )
