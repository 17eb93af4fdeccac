"""Find the directions in which the shell of a mould comes off the skin of its part.

The lids over a part's faces come off along the faces' normals. The rest of the mould, its shell,
has to come off the part's skin: in one piece if some direction allows it, or in two that open in
opposite directions. A soft part stretches over a small undercut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from ...core.arrays import Bool, Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels.cutting_tools import axes_from_normal
from ..kernels.surface_queries import cast_ray, signed_distance_of
from .records import Face

SKIN_SAMPLES, MAX_EXTRA_FACETS = 600, 150
SKIN_OFFSET_MM = 0.03  # of points from the skin
DEPTH_TOLERANCE_MM = 0.05  # of undercuts that facets may cause
DEPTH_STEPS = 14
MAX_STRAIN = 0.1  # of the part, in its thickness, as it is taken out
MAX_DIRECTIONS = 8
MIN_UNIT_LENGTH = 0.99  # shorter sums of directions are discarded
NORMAL_TOLERANCE = 0.005  # components of normals below this count as tangential


@dataclass(frozen=True)
class Skin:
    """Samples just outside of a part's skin, without its faces.

    Attributes:
        part: Surface of the part.
        points: Points (n, 3), mm.
        normals: Unit normals (n, 3).
    """

    part: Surface
    points: Float
    normals: Float

    def depths(self, direction: Float) -> Float:
        """Return how deep (n,) the mould next to each point gets into the part, mm, as it comes off
        in a direction (3,).
        """
        size = float(np.linalg.norm(np.ptp(self.part.bounds, axis=0)))
        steps = np.geomspace(0.2, size, DEPTH_STEPS)
        moved = self.points[:, None] + steps[:, None] * direction
        deep = depth_inside(self.part, moved.reshape(-1, 3)).reshape(-1, DEPTH_STEPS)
        return np.asarray(deep.max(axis=1, initial=0.0))

    def strain(self, depths: Float) -> tuple[float, Float | None]:
        """Return the largest ratio of depth to thickness of the part, and the point (3,), mm, or
        None.
        """
        worst, at = 0.0, None
        for k in np.argsort(-depths, kind="stable")[:12]:
            if depths[k] <= DEPTH_TOLERANCE_MM:
                break
            start = self.points[k] - 2 * SKIN_OFFSET_MM * self.normals[k]
            distances = cast_ray(start, -self.normals[k], self.part)
            thickness = float(distances[0]) if len(distances) else 2 * SKIN_OFFSET_MM
            if depths[k] / thickness > worst:
                worst, at = float(depths[k]) / thickness, self.points[k]
        return worst, at


@dataclass(frozen=True)
class Opening:
    """How a shell opens.

    Attributes:
        directions: One direction (3,), or two opposite ones for the pieces above and below the
            plane.
        plane: Unit normal (3,) and height, mm, of the plane between two pieces, or None.
        strain: Strain of the part as it comes out.
        at: Where (3,), mm, or None.
    """

    directions: tuple[Float, ...]
    plane: tuple[Float, float] | None
    strain: float
    at: Float | None


def depth_inside(part: Surface, points: Float) -> Float:
    """Return how deep (n,) points (n, 3) lie in the part, mm; 0 outside."""
    distances, out = signed_distance_of(part), np.zeros(len(points))
    inside = distances.inside(points)
    if inside.any():
        out[inside] = distances.unsigned(points[inside])
    return out


def sample_part_skin(part: Surface, faces: Sequence[Face]) -> Skin:
    """Sample the skin of a part without hollows."""
    corners = part.vertices[part.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(outward, axis=1)
    is_free = area > 1e-9
    for face in faces:
        is_free &= (np.abs(corners @ face.normal - face.height) > 1e-3).any(axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(
        np.flatnonzero(is_free), SKIN_SAMPLES, p=area[is_free] / area[is_free].sum()
    )
    a, b = np.sqrt(rng.random(SKIN_SAMPLES)), rng.random(SKIN_SAMPLES)
    weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
    # Samples may miss a narrow strip: add the largest facet of each direction.
    by_area = np.flatnonzero(is_free)[np.argsort(-area[is_free], kind="stable")]
    rounded_normals = np.round(outward[by_area] / area[by_area, None], 1)
    one_per_direction = by_area[np.sort(np.unique(rounded_normals, axis=0, return_index=True)[1])][
        :MAX_EXTRA_FACETS
    ]
    chosen = np.concatenate([chosen, one_per_direction])
    weights = np.concatenate([weights, np.full((len(one_per_direction), 3), 1 / 3)])
    normals = outward[chosen] / area[chosen, None]
    points = np.einsum("nk,nkd->nd", weights, corners[chosen]) + SKIN_OFFSET_MM * normals
    return Skin(part, points, normals)


def find_shell_opening(name: str, skin: Skin, faces: Sequence[Face]) -> Opening:
    """Return the opening with the fewest pieces, and of these that with the least strain.

    Args:
        name: Name of the part.
        skin: Its skin.
        faces: Its faces.

    Raises:
        FabricationError: If there is none.
    """
    directions = _candidates(skin, faces)
    openings: list[Opening] = []
    for direction in directions[:MAX_DIRECTIONS]:
        strain, at = skin.strain(skin.depths(direction))
        openings.append(Opening((direction,), None, strain, at))
        if strain == 0:
            return openings[-1]
    best = min(openings, key=lambda o: o.strain)
    if best.strain <= MAX_STRAIN:
        return best
    pairs = [_split_in_two(skin, d) for d in _pair_axes(skin, faces)]
    best = min([best, *pairs], key=lambda o: o.strain)
    if best.strain <= MAX_STRAIN:
        return best
    where = format_point(best.at) if best.at is not None else "its skin"
    raise FabricationError(
        f"cannot be cast: however its mould is divided, the part would be strained by"
        f" {best.strain:.0%} of its thickness near {where} as it is taken out, and"
        f" {MAX_STRAIN:.0%} is considered safe",
        code="undercut-too-deep",
        where=name,
        action="Let a cord's plane pass through the widest place there, add a cord, or choose a"
        " process that prints",
        part=name,
        strain=best.strain,
        at=None if best.at is None else best.at.tolist(),
    )


def _candidates(skin: Skin, faces: Sequence[Face]) -> list[Float]:
    """Return directions, those first that the skin opposes least.

    Of equal ones, those come first that save a piece by opening with another face's lid.
    """
    preferred = [*_widest_direction(skin.normals), *(f.normal for f in faces[1:])]
    mean = np.sum([f.normal for f in faces], axis=0)
    others = [-faces[0].normal, -mean / max(float(np.linalg.norm(mean)), 1e-9)]
    main_axes = np.linalg.svd(skin.points - skin.points.mean(0), full_matrices=False)[2]
    others += [*np.eye(3), *-np.eye(3), *main_axes, *-main_axes, *skin.normals[:60]]
    others += [_unit(a + b) for a, b in zip(skin.normals[:60], skin.normals[60:120], strict=True)]
    others += [-f.normal for f in faces[1:]]
    directions = [
        d for d in (*preferred, *others) if np.linalg.norm(d) > MIN_UNIT_LENGTH
    ]  # sums may vanish
    opposition = [
        float(np.clip(-(skin.normals @ d) - NORMAL_TOLERANCE, 0, None).sum()) for d in directions
    ]
    # Nothing else may come off in the direction of the first lid.
    allowed = [k for k, d in enumerate(directions) if d @ faces[0].normal < 0.5]
    order = sorted(allowed, key=lambda k: (round(opposition[k], 2), k))
    return [directions[k] for k in order]


def _widest_direction(normals: Float) -> list[Float]:
    """Return the direction that none of the skin opposes and that it faces most, by a linear
    program; none if there is no such direction.
    """
    rows = np.unique(np.round(normals, 8), axis=0)
    result = linprog(
        -normals.mean(axis=0),
        A_ub=-rows,
        b_ub=np.full(len(rows), 1e-7),
        bounds=[(-1, 1)] * 3,
        method="highs",
    )
    is_found = result.status == 0 and np.linalg.norm(result.x) > 0.5
    return [_unit(np.asarray(result.x))] if is_found else []


def _unit(vector: Float) -> Float:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


def _pair_axes(skin: Skin, faces: Sequence[Face]) -> list[Float]:
    """Return directions of two pieces that open in opposite ways."""
    main_axes = np.linalg.svd(skin.points - skin.points.mean(0), full_matrices=False)[2]
    candidates = [*(f.normal for f in faces), *np.eye(3), *main_axes]
    out: list[Float] = []
    for d in candidates:
        if all(abs(d @ other) < 0.999 for other in out):
            out.append(d)
    return out


def _split_in_two(skin: Skin, direction: Float) -> Opening:
    """Return two pieces, divided by the plane that leaves the fewest points to the wrong piece."""
    up, down = skin.depths(direction), skin.depths(-direction)
    only_up, only_down = (
        (up <= DEPTH_TOLERANCE_MM) & (down > DEPTH_TOLERANCE_MM),
        (down <= DEPTH_TOLERANCE_MM) & (up > DEPTH_TOLERANCE_MM),
    )
    axes = axes_from_normal(direction)
    local = skin.points @ axes
    middle = local.mean(axis=0)
    plane = _separating_plane(local - middle, only_up, only_down)
    above = (local - middle)[:, 2] > np.column_stack(
        [np.ones(len(local)), (local - middle)[:, :2]]
    ) @ plane
    depths = np.where(above, up, down)
    strain, at = skin.strain(depths)
    normal = _unit(axes @ np.array([-plane[1], -plane[2], 1.0]))
    point = axes @ (middle + np.array([0, 0, plane[0]]))
    return Opening((direction, -direction), (normal, float(normal @ point)), strain, at)


def _separating_plane(local: Float, high: Bool, low: Bool) -> Float:
    """Return coefficients (3,) of z = a + b x + c y that separates points.

    The `high` points (n, 3) should lie above it and the `low` ones below, with the least sum of
    violations (a linear program).
    """
    a = np.column_stack([np.ones(len(local)), local[:, :2]])
    rows = np.concatenate([a[high], -a[low]])
    bound = np.concatenate([local[high, 2], -local[low, 2]])
    n = len(rows)
    if n == 0:
        return np.zeros(3)
    cost = np.concatenate([np.zeros(3), np.ones(n)])
    result = linprog(
        cost,
        A_ub=np.hstack([rows, -np.eye(n)]),
        b_ub=bound,
        bounds=[(None, None), (-3, 3), (-3, 3), *([(0, None)] * n)],
        method="highs",
    )
    return (
        np.asarray(result.x[:3]) if result.status == 0 else np.array([np.median(local[:, 2]), 0, 0])
    )
