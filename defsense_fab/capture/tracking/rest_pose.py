"""Where the markers are at rest, from frames in which the device moved as one piece, if at all.

The mean shape over frames, each laid onto it by the rigid motion that fits best, in turns until it
stays (generalised Procrustes analysis, Gower 1975; markers may be missing). It is placed in the
design's frame by markers that agree on a motion (Fischler & Bolles 1981): those glued somewhere
else do not pull the others along.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from ...core.markers import Markers
from .alignment import NARROW, align, extents

#: Farther from its place in the design, in mm, a marker counts as glued elsewhere.
FAR = 3.0
_SURE = 3.0  # standard deviations
_GLUED = 0.5  # mm, standard deviation of where markers are glued
_ROUNDS, _STILL = 500, 1e-6  # of the mean shape, and mm by which it may change in the last
_ALL = 2000  # triples of markers: of more, so many are drawn


@dataclass(frozen=True)
class RestPose:
    """m markers at rest: `points` (m, 3) mm in the design's frame, or in the camera's at one frame
    where there is no design, NaN for those never seen; `spread` (m,) mm, root mean square distance
    of a marker from its place, over the frames `seen` (m,); `frames`, how many were aligned;
    `away` (m,) mm from the marker's place in the design, NaN where it has none; `moved` (m,), those
    farther away than they may be; their standard deviations `sigma` (m,) mm in most frames, zero
    where it is not known."""

    points: Float
    spread: Float
    seen: Int
    frames: int
    away: Float
    moved: Bool
    sigma: Float


def places(design: Markers, ids: Int) -> Float:
    """Of the markers `ids` (m,) in the design's frame (m, 3) mm, NaN for those not in it."""
    at = {int(i): c for i, c in zip(design.ids, design.centers, strict=True)}
    nowhere = np.full(3, np.nan)
    return np.array([at.get(int(i), nowhere) for i in ids], float).reshape(-1, 3)


def rest_pose(
    points: Float,
    sigma: Float | None = None,
    design: Float | None = None,
    *,
    ids: Int | None = None,
    far: float = FAR,
) -> RestPose:
    """From frames `points` (t, m, 3) mm, NaN where not seen, weighted by `sigma` (t, m, 3) mm where
    it is known of all; placed by `design` (m, 3) mm, NaN for markers not in it. Markers more than
    `far` mm away from there are told. `ids` (m,) are their numbers in messages.

    Raises CaptureError where no frame shows three markers off one line, or where fewer than three,
    or no majority, of the markers lie as in the design.
    """
    names = np.arange(points.shape[1]) if ids is None else ids
    seen = np.asarray(np.isfinite(points).all(axis=2))
    w = _weights(seen, sigma)
    mean = points[_first(points, seen, names)]
    for _ in range(_ROUNDS):
        aligned = align(points, mean, w, ids=names)
        there = seen & aligned.ok[:, None]
        total = np.where(there, w, 0.0).sum(axis=0)[:, None]
        new = np.where(there[..., None], w[..., None] * aligned.points, 0.0).sum(axis=0)
        new = np.where(total > 0, new / np.where(total > 0, total, 1.0), np.nan)
        change = np.abs(new - mean).max(initial=0.0, where=np.isfinite(mean))
        grown = np.isfinite(new).sum() > np.isfinite(mean).sum()
        mean = new
        if change < _STILL and not grown:
            break
    off = np.where(there[..., None], aligned.points - mean, 0.0)
    count = there.sum(axis=0)
    spread = np.sqrt((off**2).sum(axis=(0, 2)) / np.maximum(count, 1))
    spread = np.where(count > 0, spread, np.nan)
    unsure = _sigma(seen, sigma)
    away, moved = np.full(len(names), np.nan), np.zeros(len(names), bool)
    if design is not None:
        mean, away = _placed(mean, design, _GLUED**2 / (_GLUED**2 + unsure**2), names, far)
        moved = away > far + _SURE * unsure
    return RestPose(mean, spread, count, int(aligned.ok.sum()), away, moved, unsure)


def _weights(seen: Bool, sigma: Float | None) -> Float:
    """(t, m), of mean 1 over what was seen."""
    if sigma is None or not seen.any() or not (sigma[seen] > 0).all():
        return np.ones(seen.shape)
    w = 1 / (np.where(seen[..., None], sigma, 1.0) ** 2).mean(axis=2)
    return np.asarray(w / w[seen].mean())


def _sigma(seen: Bool, sigma: Float | None) -> Float:
    """Standard deviations (m,) mm of markers as they are compared with the design: what is wrong
    with a place that one camera saw stays the same over frames, and no mean makes it better."""
    if sigma is None:
        return np.zeros(seen.shape[1])
    variance = np.where(seen, (sigma**2).mean(axis=2), np.nan)
    known = np.isfinite(variance)
    each = zip(variance.T, known.T, strict=True)
    return np.array([np.sqrt(np.median(v[k])) if k.any() else 0.0 for v, k in each])


def _first(points: Float, seen: Bool, names: Int) -> int:
    """The frame to begin with: of those with the most markers, the one that lies the least on one
    line."""
    count = seen.sum(axis=1)
    part = np.where(seen[..., None], points, 0.0)
    part = part - part.sum(axis=1, keepdims=True) / np.maximum(count, 1)[:, None, None]
    part = np.where(seen[..., None], part, 0.0)
    along, width = extents(part.swapaxes(1, 2) @ part)
    fit = np.flatnonzero((count >= 3) & (width > NARROW**2 * along))
    if not len(fit):
        said = ", ".join(str(n) for n in names[seen.any(axis=0)]) or "none"
        raise CaptureError(
            f"rest pose: no frame of {len(points)} shows three markers off one line (seen at all:"
            f" {said}); show more of them to the cameras",
            code="rest-pose-not-visible",
            frames=len(points),
        )
    return int(fit[np.lexsort((width[fit], count[fit]))[-1]])


def _placed(
    shape: Float, design: Float, weights: Float, names: Int, far: float
) -> tuple[Float, Float]:
    """The shape (m, 3) mm moved to the design (m, 3) mm by most of its markers, with `weights`
    (m,); how far each of them is from its place there (m,) mm."""
    common = np.flatnonzero(np.isfinite(shape).all(axis=1) & np.isfinite(design).all(axis=1))
    if len(common) < 3:
        raise CaptureError(
            f"rest pose: {len(common)} markers that were seen are in the design; three are needed:"
            " check that markers.json is that of this device",
            code="markers-too-few",
            count=len(common),
        )
    triples = np.array(list(islice(combinations(common, 3), _ALL + 1)))
    if len(triples) > _ALL:
        rng = np.random.default_rng(0)
        triples = np.array([rng.choice(common, 3, replace=False) for _ in range(_ALL)])
    mask = np.zeros((len(triples), len(shape)), bool)
    mask[np.arange(len(triples))[:, None], triples] = True
    many = np.broadcast_to(shape, (len(triples), *shape.shape))
    tried = align(many, design, None, mask, ids=names)
    off = np.linalg.norm(tried.points[:, common] - design[common], axis=2)
    cost = np.where(tried.ok, (np.minimum(off, far) ** 2).sum(axis=1), np.inf)
    close = np.zeros(len(shape), bool)
    close[common] = off[int(cost.argmin())] <= far
    for _ in range(_ROUNDS):
        if close.sum() < 3 or 2 * close.sum() <= len(common):
            break
        out = align(shape[None], design, weights, close, ids=names)
        away = np.linalg.norm(out.points[0] - design, axis=1)
        again = np.asarray(away <= far)
        if (again == close).all():
            return out.points[0], away
        close = again
    raise CaptureError(
        f"rest pose: only {close.sum()} of {len(common)} markers lie within {far:g} mm of where the"
        " design has them; check the tags' size and numbers, the cameras' calibration, and that"
        " markers.json is that of this device",
        code="markers-misplaced",
        count=int(close.sum()),
        total=len(common),
    )
