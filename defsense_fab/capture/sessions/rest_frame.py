"""Move a session's tracks to the rest frame: by the anchor's tags, or by all markers.

Frames that do not show the anchor are aligned by all markers. A tag that several cameras see has
four corners, which show how it is turned, so one tag of the anchor is enough.
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

MIN_ANCHOR_FRAMES = 10  # in which alignment by all markers can be compared with it
MAX_COMPARED_FRAMES, MAX_COMPARED_SETS = 300, 8  # frames by the anchor, and sets of other markers
MAX_REST_SIGMA_MM = 1.0  # above it the design is better than the measured rest position
BLOCK_FRAMES = 5_000
MIN_ANCHOR_SHARE = 0.05  # of the frames


@dataclass(frozen=True)
class RestAlignment:
    """Tracks in the rest frame.

    Attributes:
        aligned: The aligned frames.
        by: `anchor` or `all`.
        by_all: Share of the frames that the anchor could not align.
        off: Root mean square displacement of positions in these frames, mm, as measured in frames
            that the anchor aligns; None if all frames are by all markers.
        glued: Markers that are not at their positions in the design.
        warnings: Warnings.
    """

    aligned: Aligned
    by: str
    by_all: float
    off: float | None
    glued: list[dict[str, Any]]
    warnings: list[str]


def align_with_rest(
    markers: Markers, tracks: Tracks, corners: NDArray[np.float32], resting: Bool, anchor: str
) -> RestAlignment:
    """Move tracks to the rest frame.

    Args:
        markers: Markers of the device.
        tracks: Their tracks.
        corners: Corners of the anchor's tags (t, a, 4, 3), mm, NaN where fewer than two cameras saw
            them.
        resting: Frames in which the device is at rest (t,).
        anchor: `anchor`, `all`, or `auto`.

    Raises:
        CaptureError: If the requested markers do not suffice.
    """
    frames = resting if resting.sum() >= 5 else np.ones(len(tracks.time), bool)
    rest = find_rest_pose(tracks.points[frames], tracks.sigma[frames], markers.centers, markers.ids)
    # Markers that were hidden at rest, or seen by one camera, are at their positions in the design.
    is_measured = np.isfinite(rest.points[:, 0]) & (
        (rest.sigma < MAX_REST_SIGMA_MM) | rest.is_misplaced
    )
    pose = np.where(is_measured[:, None], rest.points, markers.centers)
    glued = [
        {"tag": int(markers.ids[k]), "away": float(rest.distance[k])}
        for k in np.flatnonzero(rest.is_misplaced)
    ]
    warnings = [
        f"Tag {tag['tag']} is {tag['away']:.1f} mm from its position in the design. Its measured"
        " position is used."
        for tag in glued
    ]
    weights = _precision_weights(tracks.sigma)
    anchored = None
    if anchor == "anchor" or (anchor == "auto" and markers.anchor.any()):
        try:
            anchored = _align_by_anchor(markers, tracks, corners, pose, frames)
        except CaptureError as error:
            if anchor == "anchor":
                raise
            warnings.append(f"Aligned by all markers, because: {error}")
    if anchored is not None and (anchor == "anchor" or anchored.ok.all()):
        return RestAlignment(anchored, "anchor", 0.0, None, glued, warnings)
    by_all = align(
        tracks.points,
        pose,
        weights,
        sigma=tracks.sigma,
        ids=markers.ids,
        with_covariances=False,
    )
    if anchored is None:
        return RestAlignment(by_all, "all", 1.0, None, glued, warnings)
    if anchored.ok.sum() < max(MIN_ANCHOR_FRAMES, MIN_ANCHOR_SHARE * len(anchored.ok)):
        warnings.append(
            f"The anchor's tags align only {anchored.ok.mean():.0%} of the frames, so all"
            " markers are used."
        )
        return RestAlignment(by_all, "all", 1.0, None, glued, warnings)
    combined, displacement = _fill_frames(anchored, by_all, tracks.points, pose, weights)
    share = float(np.isfinite(displacement).mean())
    rms_displacement = float(np.sqrt(np.nanmean(displacement**2))) if share else 0.0
    if share:
        warnings.append(
            f"The anchor's tags do not align {1 - anchored.ok.mean():.0%} of the frames."
            f" {share:.0%} are aligned by all markers, which moves positions by"
            f" {rms_displacement:.2f} mm (root mean square, by the other frames). Their standard"
            " deviations include it. Align by the anchor alone to leave them out."
        )
    return RestAlignment(combined, "anchor", share, rms_displacement, glued, warnings)


def _align_by_anchor(
    markers: Markers, tracks: Tracks, corners: NDArray[np.float32], pose: Float, resting: Bool
) -> Aligned:
    """Align by the corners of the anchor's tags, or by their middles where corners are not known.

    Raises:
        CaptureError: If they do not suffice in any frame.
    """
    rest = _corners_at_rest(markers, tracks, corners, pose, resting)
    t, count = len(tracks.time), len(markers.ids)
    result = Aligned(
        np.full((t, count, 3), np.nan),
        np.full((t, 3, 3), np.nan),
        np.full((t, 3), np.nan),
        np.full(t, np.nan),
        np.full((t, count, 3), np.nan),
        np.broadcast_to(np.nan, (t, count, 3, 3)),
        np.full(t, np.nan),
        np.zeros(t, np.int64),
        np.zeros(t, bool),
    )
    last_error = None
    for k in range(0, t, BLOCK_FRAMES):
        rows = slice(k, k + BLOCK_FRAMES)
        points, sigma = tracks.points[rows], tracks.sigma[rows]
        try:
            block = _align_block(markers, points, sigma, corners[rows], pose, rest)
        except CaptureError as error:  # no frame of the block shows enough
            last_error = error
            continue
        for name in (f.name for f in fields(Aligned) if f.name != "covariance"):
            getattr(result, name)[rows] = getattr(block, name)
    if last_error is not None and not result.ok.any():
        raise last_error
    return result


def _align_block(
    markers: Markers,
    points: Float,
    sigma: Float,
    corners: NDArray[np.float32],
    pose: Float,
    rest: Float,
) -> Aligned:
    t, count = points.shape[:2]
    outlined = np.isfinite(corners[..., 0, 0]) & np.isfinite(rest[:, 0, 0])  # (t, a)
    middles = np.zeros((t, count), bool)
    middles[:, markers.anchor] = ~outlined
    mask = np.hstack([middles, np.repeat(outlined, 4, axis=1)])
    # A tag's middle is the mean of its corners, which are located independently.
    corner_sigma = np.repeat(2 * sigma[:, markers.anchor], 4, axis=1)
    points = np.concatenate([points, corners.reshape(t, -1, 3)], axis=1)
    sigma = np.concatenate([sigma, corner_sigma], axis=1)
    ids = np.append(markers.ids, np.repeat(markers.ids[markers.anchor], 4))
    rest_points = np.concatenate([pose, rest.reshape(-1, 3)])
    aligned = align(
        points,
        rest_points,
        _precision_weights(sigma),
        mask,
        sigma=sigma,
        ids=ids,
        with_covariances=False,
    )
    return replace(aligned, points=aligned.points[:, :count], variance=aligned.variance[:, :count])


def _corners_at_rest(
    markers: Markers, tracks: Tracks, corners: NDArray[np.float32], pose: Float, resting: Bool
) -> Float:
    """Return the rest positions of the corners of the anchor's tags (a, 4, 3), mm, or NaN.

    They are measured in frames that all markers align with their `pose`.
    """
    out = np.full(corners.shape[1:], np.nan)
    rows = np.flatnonzero(resting)
    if not corners.shape[1] or not np.isfinite(corners[rows]).any():
        return out
    weights = _precision_weights(tracks.sigma[rows])
    aligned = align(tracks.points[rows], pose, weights, ids=markers.ids)
    moved = np.einsum("tij,takj->taki", aligned.rotation, corners[rows])
    moved += aligned.translation[:, None, None]
    is_known = np.isfinite(moved[..., 0]).sum(axis=0) >= min(MIN_ANCHOR_FRAMES, len(rows))
    is_known &= is_known.all(axis=1, keepdims=True)
    out[is_known] = np.nanmedian(moved[:, is_known], axis=0)
    return out


def _fill_frames(
    anchored: Aligned, by_all: Aligned, points: Float, pose: Float, weights: Float | None
) -> tuple[Aligned, Float]:
    """Fill frames that the anchor does not align with those aligned by all markers.

    Returns:
        The alignment, and for the filled frames (t,) how far that displaces positions, mm, NaN for
        others.
    """
    is_filled = np.asarray(~anchored.ok & by_all.ok)
    displacement = _displacement(anchored, is_filled, points, pose, weights)
    values = {
        name: np.where(
            is_filled.reshape(-1, *[1] * (getattr(anchored, name).ndim - 1)),
            getattr(by_all, name),
            getattr(anchored, name),
        )
        for name in (
            "points",
            "rotation",
            "translation",
            "residual",
            "rotation_sigma",
            "used",
            "ok",
        )
    }
    variance = np.array(anchored.variance)
    variance[is_filled] = (
        by_all.variance[is_filled] + (displacement[is_filled] ** 2 / 3)[:, None, None]
    )
    return replace(anchored, **values, variance=variance), displacement


def _displacement(
    anchored: Aligned, is_filled: Bool, points: Float, pose: Float, weights: Float | None
) -> Float:
    """Return how far (t,) alignment by other markers displaces positions, mm, root mean square.

    For each of the frames `is_filled` its visible markers are used to align frames that the anchor
    aligns. Frames with a rare set of markers get the worst value; other frames NaN.
    """
    out = np.full(len(is_filled), np.nan)
    is_visible = np.asarray(np.isfinite(points).all(axis=2))
    compared = np.flatnonzero(anchored.ok)
    compared = compared[:: max(len(compared) // MAX_COMPARED_FRAMES, 1)]
    marker_sets, set_of_frame, count = np.unique(
        is_visible[is_filled], axis=0, return_inverse=True, return_counts=True
    )
    displacements = np.full(len(marker_sets), np.nan)
    for k in np.argsort(-count)[:MAX_COMPARED_SETS]:
        with suppress(CaptureError):  # too few in common
            w = None if weights is None else weights[compared]
            realigned = align(points[compared], pose, w, marker_sets[k])
            squares = ((realigned.points - anchored.points[compared]) ** 2).sum(axis=2)
            if np.isfinite(squares).any():
                displacements[k] = np.sqrt(np.nanmean(squares))
    finite = displacements[np.isfinite(displacements)]
    displacements = np.where(
        np.isfinite(displacements), displacements, finite.max() if len(finite) else 0.0
    )
    out[is_filled] = displacements[set_of_frame.reshape(-1)]
    return out


def _precision_weights(sigma: Float) -> Float | None:
    """Return weights (t, m) by which positions of several cameras count more than those of one.

    The result is None if no standard deviation is known.
    """
    weights = np.empty(sigma.shape[:2])
    with np.errstate(all="ignore"):
        for k in range(0, len(sigma), BLOCK_FRAMES):
            weights[k : k + BLOCK_FRAMES] = 1 / (sigma[k : k + BLOCK_FRAMES] ** 2).mean(axis=2)
    is_known = np.isfinite(weights)
    return np.where(is_known, weights, 0.0) if is_known.any() else None
