"""Find where the markers are at rest, from frames in which the device moved only as a whole.

The mean shape is taken over frames that are aligned with it by rigid motions, in turns until it
converges (generalized Procrustes analysis, Gower 1975; markers may be missing). It is placed in the
design's frame by the markers that agree on a motion (Fischler & Bolles 1981), so markers glued
elsewhere do not move the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from .alignment import MIN_WIDTH, align, scatter_extents

#: A marker that is farther from its position in the design counts as glued elsewhere.
MAX_DISTANCE_MM = 3.0
MISPLACED_SIGMAS = 3.0
GLUING_SIGMA_MM = 0.5  # of the positions at which markers are glued
MAX_ROUNDS, CONVERGED_MM = 500, 1e-6  # of the mean shape
MAX_TRIPLES = 2000  # of markers; of more, so many are drawn at random


@dataclass(frozen=True)
class RestPose:
    """m markers at rest.

    Attributes:
        points: Positions (m, 3) in the design's frame, mm, NaN for markers that are never visible.
        distance: Distance of each marker from its position in the design (m,), mm.
        is_misplaced: Markers that are farther from there than allowed (m,).
        sigma: Standard deviations of the markers (m,), mm, in most frames; zero if not known.
    """

    points: Float
    distance: Float
    is_misplaced: Bool
    sigma: Float


def find_rest_pose(
    points: Float, sigma: Float | None, design: Float, ids: Int | None = None
) -> RestPose:
    """Find the rest pose of markers.

    Args:
        points: Positions (t, m, 3), mm, NaN where not visible.
        sigma: Standard deviations (t, m, 3), mm, used as weights if they are known for all points.
        design: Positions in the design (m, 3), mm, NaN for markers that are not in it.
        ids: Numbers of the markers (m,), for messages.

    Raises:
        CaptureError: If no frame shows three markers off one line, or if fewer than three, or no
            majority, of the markers are as in the design.
    """
    numbers = np.arange(points.shape[1]) if ids is None else ids
    visible = np.asarray(np.isfinite(points).all(axis=2))
    weights = _frame_weights(visible, sigma)
    mean = points[_start_frame(points, visible, numbers)]
    for _ in range(MAX_ROUNDS):
        aligned = align(points, mean, weights, ids=numbers)
        is_aligned = visible & aligned.ok[:, None]
        total = np.where(is_aligned, weights, 0.0).sum(axis=0)[:, None]
        new = np.where(is_aligned[..., None], weights[..., None] * aligned.points, 0.0).sum(axis=0)
        new = np.where(total > 0, new / np.where(total > 0, total, 1.0), np.nan)
        change = np.abs(new - mean).max(initial=0.0, where=np.isfinite(mean))
        has_new_marker = np.isfinite(new).sum() > np.isfinite(mean).sum()
        mean = new
        if change < CONVERGED_MM and not has_new_marker:
            break
    marker_sigma = _marker_sigma(visible, sigma)
    weights = GLUING_SIGMA_MM**2 / (GLUING_SIGMA_MM**2 + marker_sigma**2)
    points, distance = _move_to_design(mean, design, weights, numbers)
    is_misplaced = distance > MAX_DISTANCE_MM + MISPLACED_SIGMAS * marker_sigma
    return RestPose(points, distance, is_misplaced, marker_sigma)


def _frame_weights(visible: Bool, sigma: Float | None) -> Float:
    """Return weights (t, m) of mean 1 over the visible points."""
    if sigma is None or not visible.any() or not (sigma[visible] > 0).all():
        return np.ones(visible.shape)
    w = 1 / (np.where(visible[..., None], sigma, 1.0) ** 2).mean(axis=2)
    return np.asarray(w / w[visible].mean())


def _marker_sigma(visible: Bool, sigma: Float | None) -> Float:
    """Return standard deviations of the markers (m,), mm, for comparison with the design.

    An error of a position that one camera saw is the same in all frames, so a mean does not reduce
    it.
    """
    if sigma is None:
        return np.zeros(visible.shape[1])
    variance = np.where(visible, (sigma**2).mean(axis=2), np.nan)
    is_known = np.isfinite(variance)
    columns = zip(variance.T, is_known.T, strict=True)
    return np.array([np.sqrt(np.median(v[k])) if k.any() else 0.0 for v, k in columns])


def _start_frame(points: Float, visible: Bool, numbers: Int) -> int:
    """Return the frame to start with: of those with most markers, the least narrow."""
    count = visible.sum(axis=1)
    centered = np.where(visible[..., None], points, 0.0)
    centered = centered - centered.sum(axis=1, keepdims=True) / np.maximum(count, 1)[:, None, None]
    centered = np.where(visible[..., None], centered, 0.0)
    along, width = scatter_extents(centered.swapaxes(1, 2) @ centered)
    suitable = np.flatnonzero((count >= 3) & (width > MIN_WIDTH**2 * along))
    if not len(suitable):
        listed = ", ".join(str(n) for n in numbers[visible.any(axis=0)]) or "none"
        raise CaptureError(
            f"no frame of {len(points)} shows three markers off one line (markers seen: {listed})",
            code="rest-pose-not-visible",
            where="rest pose",
            action="Show more markers to the cameras",
            frames=len(points),
        )
    return int(suitable[np.lexsort((width[suitable], count[suitable]))[-1]])


def _move_to_design(
    shape: Float, design: Float, weights: Float, numbers: Int
) -> tuple[Float, Float]:
    """Move a shape to the design by most of its markers.

    Args:
        shape: Mean shape (m, 3), mm.
        design: Positions in the design (m, 3), mm.
        weights: Weights of the markers (m,).
        numbers: Numbers of the markers (m,), for messages.

    Returns:
        The moved shape (m, 3), mm, and each marker's distance from the design (m,), mm.
    """
    common = np.flatnonzero(np.isfinite(shape).all(axis=1) & np.isfinite(design).all(axis=1))
    if len(common) < 3:
        raise CaptureError(
            f"{len(common)} of the visible markers are in the design, but three are needed",
            code="too-few-markers",
            where="rest pose",
            action="Check that markers.json is that of this device",
            count=len(common),
        )
    triples = np.array(list(islice(combinations(common, 3), MAX_TRIPLES + 1)))
    if len(triples) > MAX_TRIPLES:
        rng = np.random.default_rng(0)
        triples = np.array([rng.choice(common, 3, replace=False) for _ in range(MAX_TRIPLES)])
    mask = np.zeros((len(triples), len(shape)), bool)
    mask[np.arange(len(triples))[:, None], triples] = True
    copies = np.broadcast_to(shape, (len(triples), *shape.shape))
    candidates = align(copies, design, None, mask, ids=numbers)
    distances = np.linalg.norm(candidates.points[:, common] - design[common], axis=2)
    cost = np.where(
        candidates.ok, (np.minimum(distances, MAX_DISTANCE_MM) ** 2).sum(axis=1), np.inf
    )
    is_close = np.zeros(len(shape), bool)
    is_close[common] = distances[int(cost.argmin())] <= MAX_DISTANCE_MM
    for _ in range(MAX_ROUNDS):
        if is_close.sum() < 3 or 2 * is_close.sum() <= len(common):
            break
        aligned = align(shape[None], design, weights, is_close, ids=numbers)
        distance = np.linalg.norm(aligned.points[0] - design, axis=1)
        is_close_now = np.asarray(distance <= MAX_DISTANCE_MM)
        if (is_close_now == is_close).all():
            return aligned.points[0], distance
        is_close = is_close_now
    raise CaptureError(
        f"only {is_close.sum()} of {len(common)} markers are within {MAX_DISTANCE_MM:g} mm of their"
        " positions in the design",
        code="markers-misplaced",
        where="rest pose",
        action=(
            "Check the tags' size and numbers, the cameras' calibration, and that markers.json is"
            " that of this device"
        ),
        count=int(is_close.sum()),
        total=len(common),
    )
