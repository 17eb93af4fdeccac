"""A session's tracks in the rest frame: by the anchor's tags, frame by frame by all markers where
these are not seen.

A tag that several cameras see is four corners, which tell how it is turned: one of the anchor is
enough.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ...core.markers import Markers, Tracks
from ..tracking.alignment import Aligned, align
from ..tracking.rest_pose import find_rest_pose

_FEW = 10  # frames by the anchor, in which what all markers make of them can be compared
_COMPARED, _SETS = 300, 8  # frames by the anchor, and sets of other markers, that are compared
_SURE = 1.0  # mm: standard deviation above which a place at rest tells less than the design
_BLOCK = 5_000  # frames looked at together
_RARE = 0.05  # of the frames, that must show the anchor


@dataclass(frozen=True)
class LaidOnRest:
    """The tracks as `aligned`, `by` the anchor's markers or all, and the share `by_all` of frames
    that the anchor could not align; `off` mm, root mean square, by which that puts places
    elsewhere, as frames tell that the anchor does align, None where all are by all; markers
    `glued` elsewhere than designed, and warnings."""

    aligned: Aligned
    by: str
    by_all: float
    off: float | None
    glued: list[dict[str, Any]]
    warnings: list[str]


def lay_on_rest(
    m: Markers, tracks: Tracks, corners: NDArray[np.float32], resting: Bool, anchor: str
) -> LaidOnRest:
    """Tracks of the markers `m`, which is at rest in the frames `resting` (t,), by the `anchor`,
    `all`, or `auto`; `corners` (t, a, 4, 3) mm of the anchor's a tags, NaN where fewer than two
    cameras saw them. Raises CaptureError where the markers asked for do not do."""
    frames = resting if resting.sum() >= 5 else np.ones(len(tracks.time), bool)
    rest = find_rest_pose(tracks.points[frames], tracks.sigma[frames], m.centers, ids=m.ids)
    # Markers that were hidden at rest, or seen by one camera, are where the design has them.
    there = np.isfinite(rest.points[:, 0]) & ((rest.sigma < _SURE) | rest.is_misplaced)
    pose = np.where(there[:, None], rest.points, m.centers)
    glued = [
        {"tag": int(i), "away": float(d)}
        for i, d, far in zip(m.ids, rest.distance, rest.is_misplaced, strict=True)
        if far
    ]
    warnings = [
        f"tag {p['tag']} is {p['away']:.1f} mm from where the design has it: its place as measured"
        " is used"
        for p in glued
    ]
    weights = _weights(tracks.sigma)

    def by_all() -> Aligned:
        return align(
            tracks.points, pose, weights, sigma=tracks.sigma, ids=m.ids, with_covariances=False
        )

    if anchor == "anchor" or (anchor == "auto" and m.anchor.any()):
        try:
            found = _by_anchor(m, tracks, corners, pose, frames)
        except CaptureError as error:
            if anchor == "anchor":
                raise
            warnings.append(f"aligned by all markers: {error}")
        else:
            if anchor == "anchor" or found.ok.all():
                return LaidOnRest(found, "anchor", 0.0, None, glued, warnings)
            if found.ok.sum() >= max(_FEW, _RARE * len(found.ok)):
                both, by = _filled(found, by_all(), tracks.points, pose, weights)
                share = float(np.isfinite(by).mean())
                off = float(np.sqrt(np.nanmean(by**2))) if share else 0.0
                if share:
                    warnings.append(
                        f"the anchor's tags do not align {1 - found.ok.mean():.0%} of the frames:"
                        f" {share:.0%} are aligned by all markers, which puts places {off:.2f} mm"
                        " elsewhere (root mean square, by the other frames); their standard"
                        " deviations include it. --align anchor leaves them out"
                    )
                return LaidOnRest(both, "anchor", share, off, glued, warnings)
            warnings.append(
                f"the anchor's tags align {found.ok.mean():.0%} of the frames only: aligned by all"
                " markers"
            )
    return LaidOnRest(by_all(), "all", 1.0, None, glued, warnings)


def _by_anchor(
    m: Markers, tracks: Tracks, corners: NDArray[np.float32], pose: Float, resting: Bool
) -> Aligned:
    """By the corners of the anchor's tags, or by their middles where these are not known, onto
    where they are at rest. Raises CaptureError where they do not do in any frame."""
    rest = _corners_at_rest(m, tracks, corners, pose, resting)
    t, count = len(tracks.time), len(m.ids)
    out = Aligned(
        np.full((t, count, 3), np.nan), np.full((t, 3, 3), np.nan), np.full((t, 3), np.nan),
        np.full(t, np.nan), np.full((t, count, 3), np.nan),
        np.broadcast_to(np.nan, (t, count, 3, 3)), np.full(t, np.nan), np.zeros(t, np.int64),
        np.zeros(t, bool),
    )  # fmt: skip
    wrong = None
    for k in range(0, t, _BLOCK):
        part = slice(k, k + _BLOCK)
        points, sigma = tracks.points[part], tracks.sigma[part]
        try:
            found = _block_by_anchor(m, points, sigma, corners[part], pose, rest)
        except CaptureError as error:  # no frame of these shows enough
            wrong = error
            continue
        for name in (f.name for f in fields(Aligned) if f.name != "covariance"):
            getattr(out, name)[part] = getattr(found, name)
    if wrong is not None and not out.ok.any():
        raise wrong
    return out


def _block_by_anchor(
    m: Markers, points: Float, sigma: Float, corners: NDArray[np.float32], pose: Float, rest: Float
) -> Aligned:
    t, count = points.shape[:2]
    outlined = np.isfinite(corners[..., 0, 0]) & np.isfinite(rest[:, 0, 0])  # (t, a)
    middles = np.zeros((t, count), bool)
    middles[:, m.anchor] = ~outlined
    mask = np.hstack([middles, np.repeat(outlined, 4, axis=1)])
    # A tag's middle is the mean of its corners, which are found one by one.
    apart = np.repeat(2 * sigma[:, m.anchor], 4, axis=1)
    points = np.concatenate([points, corners.reshape(t, -1, 3)], axis=1)
    sigma = np.concatenate([sigma, apart], axis=1)
    ids = np.append(m.ids, np.repeat(m.ids[m.anchor], 4))
    places = np.concatenate([pose, rest.reshape(-1, 3)])
    found = align(
        points, places, _weights(sigma), mask, sigma=sigma, ids=ids, with_covariances=False
    )
    return replace(found, points=found.points[:, :count], variance=found.variance[:, :count])


def _corners_at_rest(
    m: Markers, tracks: Tracks, corners: NDArray[np.float32], pose: Float, resting: Bool
) -> Float:
    """Where the corners (a, 4, 3) mm of the anchor's tags are at rest: as measured, once all
    markers lie at their `pose`, or NaN."""
    out = np.full(corners.shape[1:], np.nan)
    rows = np.flatnonzero(resting)
    if not corners.shape[1] or not np.isfinite(corners[rows]).any():
        return out
    weights = _weights(tracks.sigma[rows])
    laid = align(tracks.points[rows], pose, weights, ids=m.ids)
    seen = np.einsum("tij,takj->taki", laid.rotation, corners[rows])
    seen += laid.translation[:, None, None]
    known = np.isfinite(seen[..., 0]).sum(axis=0) >= min(_FEW, len(rows))
    known &= known.all(axis=1, keepdims=True)
    out[known] = np.nanmedian(seen[:, known], axis=0)
    return out


def _filled(
    anchored: Aligned, by_all: Aligned, points: Float, pose: Float, weights: Float | None
) -> tuple[Aligned, Float]:
    """Frames by the anchor, and by all where it aligns none; of those frames (t,) how far that puts
    places elsewhere, mm, NaN for the others."""
    use = np.asarray(~anchored.ok & by_all.ok)
    off = _off(anchored, use, points, pose, weights)
    values = {
        name: np.where(
            use.reshape(-1, *[1] * (getattr(anchored, name).ndim - 1)),
            getattr(by_all, name),
            getattr(anchored, name),
        )
        for name in ("points", "rotation", "translation", "residual", "turn", "used", "ok")
    }
    variance = np.array(anchored.variance)
    variance[use] = by_all.variance[use] + (off[use] ** 2 / 3)[:, None, None]
    return replace(anchored, **values, variance=variance), off


def _off(anchored: Aligned, use: Bool, points: Float, pose: Float, weights: Float | None) -> Float:
    """How far (t,) mm, root mean square, the markers that are seen in each of the frames `use`
    would put places elsewhere in frames that the anchor aligns, NaN for the others; the worst where
    their set of markers is rare."""
    out = np.full(len(use), np.nan)
    there = np.asarray(np.isfinite(points).all(axis=2))
    good = np.flatnonzero(anchored.ok)
    good = good[:: max(len(good) // _COMPARED, 1)]
    sets, which, count = np.unique(there[use], axis=0, return_inverse=True, return_counts=True)
    told = np.full(len(sets), np.nan)
    for k in np.argsort(-count)[:_SETS]:
        with suppress(CaptureError):  # too few in common
            w = None if weights is None else weights[good]
            again = align(points[good], pose, w, sets[k])
            apart = ((again.points - anchored.points[good]) ** 2).sum(axis=2)
            if np.isfinite(apart).any():
                told[k] = np.sqrt(np.nanmean(apart))
    known = told[np.isfinite(told)]
    told = np.where(np.isfinite(told), told, known.max() if len(known) else 0.0)
    out[use] = told[which.reshape(-1)]
    return out


def _weights(sigma: Float) -> Float | None:
    """(t, m), by which places that several cameras saw count more than those of one; None where
    nothing is known of them."""
    weights = np.empty(sigma.shape[:2])
    with np.errstate(all="ignore"):
        for k in range(0, len(sigma), _BLOCK):
            weights[k : k + _BLOCK] = 1 / (sigma[k : k + _BLOCK] ** 2).mean(axis=2)
    known = np.isfinite(weights)
    return np.where(known, weights, 0.0) if known.any() else None
