"""Place camera tags on the skin of a body: where it is nearly flat, spread out, some on the
anchor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.curve import Plane
from ...core.mesh import Surface
from ..kernels.surface_queries import distance_to_chosen, signed_distance_of

MIN_LEAN_COSINE = np.cos(np.radians(35))
MAX_OVERHANG_MM = 0.3  # of a piece over the rim of a flat place
PIECE_GAP_MM = 1.0  # between two pieces
ANCHOR_DEPTH_MM = 0.2  # below the skin, where the anchor is tested
#: A piece keeps this far from a mouth, unless it is so far below.
MOUTH_GAP_MM, MOUTH_DEPTH_MM = 1.5, 5.0
#: Candidate places in all, and per area of one tag.
CANDIDATE_RANGE, CANDIDATES_PER_TAG = (400, 2500), 60
POOR_PLACE_WEIGHT = 0.7  # weight of the distance of a place over a joint or on the underside
UNDERSIDE_NORMAL_Z = -0.7  # z of the normal of a place on the underside
MIN_VIEW_COSINE = 0.45  # between a tag's normal and the direction of the cameras


@dataclass(frozen=True)
class TagPlace:
    """A place for a tag.

    Attributes:
        center: Center (3,), mm.
        axes: Axes (3, 3) in columns: the tag's x and y, and the normal out of the body.
        anchor: Whether it is on the anchor.
    """

    center: Float
    axes: Float
    anchor: bool


@dataclass(frozen=True)
class TagRequest:
    """A request for tags.

    Attributes:
        count: Number of tags.
        size: Side of the black squares, mm.
        outer: Side of the pieces, mm.
        anchored: Least number of tags on the anchor.
        anchor: Returns which points (n, 3), mm, are in the anchor region.
        avoid: Mouths (k, 3) that no tag may cover, mm.
        joints: Planes of joints that tags should not cross.
        side: Direction (3,) from which tags must be visible, or None.
    """

    count: int
    size: float
    outer: float
    anchored: int
    anchor: Callable[[Float], Bool]
    avoid: Float
    joints: Sequence[Plane]
    side: Float | None = None


def place_tags(body: Surface, request: TagRequest) -> list[TagPlace]:
    """Choose places for tags by farthest-point sampling of the flat places of the skin.

    Places on the anchor are chosen first.

    Args:
        body: Surface of the body.
        request: What to place.

    Returns:
        The places; fewer than requested if there is no room.

    References:
        Gonzalez (1985), Clustering to minimize the maximum intercluster distance.
    """
    rng = np.random.default_rng(1)
    count = int(np.clip(CANDIDATES_PER_TAG * body.area / request.outer**2, *CANDIDATE_RANGE))
    points = body.scatter(count, rng)
    if request.anchored:  # the anchor may be a small part of the body
        more = body.scatter(20 * count, rng)
        points = np.concatenate([points, more[request.anchor(more)][: count // 2]])
    centers, axes = _find_flat(body, points, request)
    if request.side is not None:
        is_visible = axes[:, :, 2] @ request.side >= MIN_VIEW_COSINE * float(
            np.linalg.norm(request.side)
        )
        centers, axes = centers[is_visible], axes[is_visible]
    if not len(centers):
        return []
    anchor = _find_anchored(centers, axes, request)
    weight = np.where(_find_crossed(centers, axes, request), POOR_PLACE_WEIGHT, 1.0)
    weight[axes[:, 2, 2] < UNDERSIDE_NORMAL_Z] *= POOR_PLACE_WEIGHT
    is_free = np.ones(len(centers), bool)
    chosen: list[int] = []
    quota = min(request.anchored, request.count)
    for allowed, limit in ((anchor, quota), (~anchor, request.count), (anchor, request.count)):
        while len(chosen) < limit and (allowed & is_free).any():
            gap = distance_to_chosen(centers, centers[chosen]) + (0.0 if chosen else 1.0)
            chosen.append(int(np.where(allowed & is_free, gap * weight, -1.0).argmax()))
            is_free &= ~_find_overlaps(centers, axes, chosen[-1], request.outer)
    return [TagPlace(centers[i], axes[i], bool(anchor[i])) for i in chosen]


def are_spread_out(points: Float, min_offset: float) -> bool:
    """Return whether points (n, 3) are at least three and not on one line.

    Args:
        points: Points, mm.
        min_offset: Least of the largest distance from the line through the two farthest points, mm.
    """
    if len(points) < 3:
        return False
    i, j = np.unravel_index(
        np.linalg.norm(points[:, None] - points[None], axis=2).argmax(), (len(points),) * 2
    )
    along = points[j] - points[i]
    off = np.linalg.norm(np.cross(points - points[i], along), axis=1) / np.linalg.norm(along)
    return bool(off.max() >= min_offset)


def _find_flat(body: Surface, points: Float, request: TagRequest) -> tuple[Float, Float]:
    """Return the centers (k, 3) and axes (k, 3, 3) of the places (n, 3) where a piece lies on the
    skin.
    """
    normals, skin_of_body = body.normals, signed_distance_of(body)
    tolerance = float(np.clip(0.08 * request.size, 0.4, 0.9))  # mm, between skin and tag
    normals_up = normals[skin_of_body.closest(points)[1]]
    centers = points
    for is_last in (False, False, True):
        steps = request.size / 2 * np.linspace(-1, 1, 5 if is_last else 3)
        steps = np.array([-request.outer / 2, *steps, request.outer / 2])  # with the piece's rims
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        black = np.abs(grid).max(1) <= request.size / 2 + 1e-9
        axes = upright_axes_of(normals_up)
        on = centers[:, None] + np.einsum("gk,njk->ngj", grid, axes[:, :, :2])
        _, face, skin = skin_of_body.closest(on.reshape(-1, 3))
        skin = skin.reshape(on.shape)
        facing = np.einsum("ngj,nj->ng", normals[face].reshape(on.shape), normals_up)
        height = np.einsum("ngj,nj->ng", skin - on, normals_up)
        sideways = np.linalg.norm(skin - on - height[..., None] * normals_up[:, None], axis=2)
        is_flat = facing.min(1) >= MIN_LEAN_COSINE
        if is_last:
            is_flat &= np.abs(height[:, black]).max(1) <= tolerance
            is_flat &= (sideways - 0.7 * np.abs(height)).max(1) <= MAX_OVERHANG_MM
            break
        is_flat &= np.abs(height).max(1) <= 4 * tolerance
        centers, normals_up, skin = centers[is_flat], normals_up[is_flat], skin[is_flat][:, black]
        if not len(centers):
            break
        # The plane through the skin below the tag, centered between its highest and lowest point.
        centered = skin - skin.mean(1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("ngi,ngj->nij", centered, centered))
        fitted = vectors[:, :, 0]
        normals_up = fitted * np.sign(np.einsum("nj,nj->n", fitted, normals_up))[:, None]
        height = np.einsum("ngj,nj->ng", skin - centers[:, None], normals_up)
        centers = centers + ((height.min(1) + height.max(1)) / 2)[:, None] * normals_up
    if not len(centers):
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    for p in request.avoid:
        local = np.abs(np.einsum("nj,njk->nk", p - centers, axes))
        is_flat &= (local[:, :2].max(1) > request.outer / 2 + MOUTH_GAP_MM) | (
            local[:, 2] > MOUTH_DEPTH_MM
        )
    return centers[is_flat], axes[is_flat]


def upright_axes_of(normals: Float) -> Float:
    """Return `cutting_tools.upright_axes` of many normals (n, 3): axes (n, 3, 3)."""
    flat = np.abs(normals[:, 2]) >= 0.9
    x = np.cross(np.where(flat[:, None], [0.0, 1, 0], [0.0, 0, 1]), normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(normals, x), normals], axis=2)


def _find_anchored(centers: Float, axes: Float, request: TagRequest) -> Bool:
    """Return which places (n,) have at least the middle half of their tag in the anchor region.

    Points are taken slightly below the skin, on which the region's own faces may lie.
    """
    half = request.size / 4 * np.array([[0.0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]])
    on = centers[:, None] + np.einsum("gk,njk->ngj", half, axes[:, :, :2])
    on -= ANCHOR_DEPTH_MM * axes[:, None, :, 2]
    inside = request.anchor(on.reshape(-1, 3)).reshape(len(centers), len(half))
    return np.asarray(inside.all(1))


def _find_crossed(centers: Float, axes: Float, request: TagRequest) -> Bool:
    """Return which pieces (n,) a joint's plane cuts."""
    out = np.zeros(len(centers), bool)
    for plane in request.joints:
        reach = np.abs(np.einsum("njk,j->nk", axes[:, :, :2], plane.normal)).sum(1)
        out |= np.abs((centers - plane.origin) @ plane.normal) < reach * request.outer / 2
    return out


def _find_overlaps(centers: Float, axes: Float, k: int, side: float) -> Bool:
    """Return which pieces (n,) overlap piece `k`: squares, about in one plane, that none of their
    edges separates (separating axes).
    """
    offset = centers - centers[k]
    half, overlaps = side / 2, np.ones(len(centers), bool)
    for axes_ in (np.broadcast_to(axes[k], axes.shape), axes):
        for j in (0, 1):
            along = axes_[:, :, j]
            reach = half * (
                np.abs(np.einsum("nj,njk->nk", along, axes[:, :, :2])).sum(1)
                + np.abs(along @ axes[k, :, :2]).sum(1)
            )
            overlaps &= np.abs(np.einsum("nj,nj->n", offset, along)) < reach + PIECE_GAP_MM
    return overlaps & (axes[:, :, 2] @ axes[k, :, 2] > 0)
