"""Places for camera tags on the skin of a body: nearly flat, spread, some of them on the anchor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.curve import Plane
from ...core.mesh import Surface, facet_crosses

_LEAN = np.cos(np.radians(35))
_OVERHANG = 0.3  # mm, of a piece over the rim of a flat
_APART = 1.0  # mm, between two pieces
_UNDER = 0.2  # mm
_MOUTH, _DEEP = 1.5, 5.0  # mm: a piece keeps so far from a mouth, unless that is so far below
_POOL, _DENSITY = (400, 2500), 60  # places tried, and how many an area of one tag gets
_WORSE = 0.7  # of its distance: what a place over a joint counts, or below, where bodies stand
_BELOW = -0.7  # z of such a place's normal
_SEEN = 0.45  # least cosine between a tag's normal and the direction that cameras look from


@dataclass(frozen=True)
class Place:
    """The middle (3,) mm of a tag, and its `axes` (3, 3): its x, y and the normal out of the body;
    whether it is on the anchor."""

    center: Float
    axes: Float
    anchor: bool


@dataclass(frozen=True)
class TagRequest:
    """`count` tags with black squares of `size` mm on pieces of `outer` mm; at least `anchored` of
    them in the region where `anchor` is true of points (n, 3) mm; none over the mouths `avoid`
    (k, 3) mm, and preferably none across the `joints`; only places that can be seen from the
    direction `side` (3,), where one is given."""

    count: int
    size: float
    outer: float
    anchored: int
    anchor: Callable[[Float], Bool]
    avoid: Float
    joints: Sequence[Plane]
    side: Float | None = None


def place_tags(body: Surface, wanted: TagRequest) -> list[Place]:
    """Farthest-point samples (Gonzalez 1985) of the places where the skin is flat enough for a
    piece, first of those on the anchor, then of all. Fewer than wanted where there is no room."""
    crosses = facet_crosses(body.vertices, body.faces)
    area = float(np.linalg.norm(crosses, axis=1).sum() / 2)
    rng = np.random.default_rng(1)
    count = int(np.clip(_DENSITY * area / wanted.outer**2, *_POOL))
    points = body.scatter(count, rng)
    if wanted.anchored:  # which may be a small part of the body
        more = body.scatter(20 * count, rng)
        points = np.concatenate([points, more[wanted.anchor(more)][: count // 2]])
    centers, axes = _flat(body, points, wanted)
    if wanted.side is not None:
        seen = axes[:, :, 2] @ wanted.side >= _SEEN * float(np.linalg.norm(wanted.side))
        centers, axes = centers[seen], axes[seen]
    if not len(centers):
        return []
    anchor = _anchored(centers, axes, wanted)
    weight = np.where(_crossed(centers, axes, wanted), _WORSE, 1.0)
    weight[axes[:, 2, 2] < _BELOW] *= _WORSE
    free = np.ones(len(centers), bool)
    chosen: list[int] = []
    quota = min(wanted.anchored, wanted.count)
    for allowed, most in ((anchor, quota), (~anchor, wanted.count), (anchor, wanted.count)):
        while len(chosen) < most and (allowed & free).any():
            gap = _gap(centers, chosen)
            chosen.append(int(np.where(allowed & free, gap * weight, -1.0).argmax()))
            free &= ~_overlaps(centers, axes, chosen[-1], wanted.outer)
    return [Place(centers[i], axes[i], bool(anchor[i])) for i in chosen]


def are_spread_out(points: Float, least: float) -> bool:
    """Whether points (n, 3) mm are at least three and not on one line: their greatest distance from
    the line through the farthest two is `least` mm or more."""
    if len(points) < 3:
        return False
    i, j = np.unravel_index(
        np.linalg.norm(points[:, None] - points[None], axis=2).argmax(), (len(points),) * 2
    )
    along = points[j] - points[i]
    off = np.linalg.norm(np.cross(points - points[i], along), axis=1) / np.linalg.norm(along)
    return bool(off.max() >= least)


def _flat(body: Surface, points: Float, wanted: TagRequest) -> tuple[Float, Float]:
    """Of places (n, 3) those where a piece lies on the skin: middles (k, 3) and axes (k, 3, 3)."""
    cross = facet_crosses(body.vertices, body.faces)
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-30)
    off = float(np.clip(0.08 * wanted.size, 0.4, 0.9))  # mm, of the skin from the tag
    _, face, _ = igl.point_mesh_squared_distance(points, body.vertices, body.faces)
    up = normals[np.asarray(face)]
    centers = points
    for last in (False, False, True):
        steps = wanted.size / 2 * np.linspace(-1, 1, 5 if last else 3)  # and the white's rims:
        steps = np.array([-wanted.outer / 2, *steps, wanted.outer / 2])
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        black = np.abs(grid).max(1) <= wanted.size / 2 + 1e-9
        axes = _upright(up)
        on = centers[:, None] + np.einsum("gk,njk->ngj", grid, axes[:, :, :2])
        _, face, skin = igl.point_mesh_squared_distance(
            on.reshape(-1, 3), body.vertices, body.faces
        )
        skin = np.asarray(skin).reshape(on.shape)
        facing = np.einsum("ngj,nj->ng", normals[np.asarray(face)].reshape(on.shape), up)
        height = np.einsum("ngj,nj->ng", skin - on, up)
        aside = np.linalg.norm(skin - on - height[..., None] * up[:, None], axis=2)
        good = facing.min(1) >= _LEAN
        if last:
            good &= np.abs(height[:, black]).max(1) <= off
            good &= (aside - 0.7 * np.abs(height)).max(1) <= _OVERHANG
            break
        good &= np.abs(height).max(1) <= 4 * off
        centers, up, skin = centers[good], up[good], skin[good][:, black]
        if not len(centers):
            break
        # The plane through the skin below the tag, its middle half way between high and low.
        rest = skin - skin.mean(1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("ngi,ngj->nij", rest, rest))
        fitted = vectors[:, :, 0]
        up = fitted * np.sign(np.einsum("nj,nj->n", fitted, up))[:, None]
        height = np.einsum("ngj,nj->ng", skin - centers[:, None], up)
        centers = centers + ((height.min(1) + height.max(1)) / 2)[:, None] * up
    if not len(centers):
        return np.zeros((0, 3)), np.zeros((0, 3, 3))
    for p in wanted.avoid:
        local = np.abs(np.einsum("nj,njk->nk", p - centers, axes))
        good &= (local[:, :2].max(1) > wanted.outer / 2 + _MOUTH) | (local[:, 2] > _DEEP)
    return centers[good], axes[good]


def _upright(normals: Float) -> Float:
    """`cutting_tools.upright` of many normals (n, 3): axes (n, 3, 3)."""
    flat = np.abs(normals[:, 2]) >= 0.9
    x = np.cross(np.where(flat[:, None], [0.0, 1, 0], [0.0, 0, 1]), normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(normals, x), normals], axis=2)


def _anchored(centers: Float, axes: Float, wanted: TagRequest) -> Bool:
    """Which places (n,) have at least the middle half of their tag in the anchor's region; a little
    below the skin, on which the region's own faces may lie."""
    half = wanted.size / 4 * np.array([[0.0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]])
    on = centers[:, None] + np.einsum("gk,njk->ngj", half, axes[:, :, :2])
    on -= _UNDER * axes[:, None, :, 2]
    inside = wanted.anchor(on.reshape(-1, 3)).reshape(len(centers), len(half))
    return np.asarray(inside.all(1))


def _crossed(centers: Float, axes: Float, wanted: TagRequest) -> Bool:
    """Which pieces (n,) a joint's plane cuts."""
    out = np.zeros(len(centers), bool)
    for plane in wanted.joints:
        reach = np.abs(np.einsum("njk,j->nk", axes[:, :, :2], plane.normal)).sum(1)
        out |= np.abs((centers - plane.origin) @ plane.normal) < reach * wanted.outer / 2
    return out


def _gap(centers: Float, chosen: Sequence[int]) -> Float:
    if not chosen:
        return 1.0 + np.asarray(np.linalg.norm(centers - centers.mean(0), axis=1))
    return np.asarray(np.linalg.norm(centers[:, None] - centers[chosen], axis=2).min(1))


def _overlaps(centers: Float, axes: Float, k: int, side: float) -> Bool:
    """Which pieces (n,) and piece `k` would lie on each other: squares, about in one plane, that
    none of their edges parts (separating axes)."""
    offset = centers - centers[k]
    half, apart = side / 2, np.ones(len(centers), bool)
    for own in (np.broadcast_to(axes[k], axes.shape), axes):
        for j in (0, 1):
            along = own[:, :, j]
            reach = half * (
                np.abs(np.einsum("nj,njk->nk", along, axes[:, :, :2])).sum(1)
                + np.abs(along @ axes[k, :, :2]).sum(1)
            )
            apart &= np.abs(np.einsum("nj,nj->n", offset, along)) < reach + _APART
    return apart & (axes[:, :, 2] @ axes[k, :, 2] > 0)
