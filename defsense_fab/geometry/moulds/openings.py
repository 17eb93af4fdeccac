"""The directions in which the shell of a mould comes off the skin of its part.

The lids over a part's faces come off along the faces' normals. What is left of the mould, its
shell, has to come off the part's skin: in one piece where some direction lets it, or in two that
open in opposite directions. A soft part stretches over a small undercut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np
from scipy.optimize import linprog

from ...core.arrays import Bool, Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import surface_queries
from ..kernels.cutting_tools import frame
from .records import Face, MouldRules

_POINTS, _WAYS = 600, 150
_OFF = 0.03  # mm, of points from the skin
_DEEP = 0.05  # mm, of an undercut that facets may make
_STEPS = 14
_TRIED = 8
_WHOLE = 0.99  # length of a direction that is one
_LEVEL = 0.005  # of a normal's component: as good as along the skin


@dataclass(frozen=True)
class Skin:
    """Points (n, 3) mm just outside of a part's skin, its faces left out, and unit normals."""

    part: Surface
    points: Float
    normals: Float

    def depths(self, direction: Float, of: Bool | None = None) -> Float:
        """How deep (n,) mm into the part the mould beside each point gets as it is moved along the
        direction, at the most; of some points only, zero for the others."""
        chosen = np.arange(len(self.points)) if of is None else np.flatnonzero(of)
        out = np.zeros(len(self.points))
        size = float(np.linalg.norm(np.ptp(self.part.bounds, axis=0)))
        steps = np.geomspace(0.2, size, _STEPS)
        moved = self.points[chosen, None] + steps[:, None] * direction
        deep = depth_in(self.part, moved.reshape(-1, 3)).reshape(len(chosen), _STEPS)
        out[chosen] = deep.max(axis=1, initial=0.0)
        return out

    def strain(self, depths: Float) -> tuple[float, Float | None]:
        """The largest of depth by thickness of the part there, and the point (3,)."""
        worst, at = 0.0, None
        for k in np.argsort(-depths, kind="stable")[:12]:
            if depths[k] <= _DEEP:
                break
            start = self.points[k] - 2 * _OFF * self.normals[k]
            found = surface_queries.hits(start, -self.normals[k], self.part)
            thick = float(found[0]) if len(found) else 2 * _OFF
            if depths[k] / thick > worst:
                worst, at = float(depths[k]) / thick, self.points[k]
        return worst, at


@dataclass(frozen=True)
class Opening:
    """One direction (3,) or two opposite ones, for the pieces above and below the `plane` (normal
    (3,), height mm); strain of the part as it comes out, and where."""

    directions: tuple[Float, ...]
    plane: tuple[Float, float] | None
    strain: float
    at: Float | None


def depth_in(part: Surface, points: Float) -> Float:
    """How deep (n,) mm points (n, 3) lie in the part, 0 outside."""
    inside = np.asarray(igl.fast_winding_number(part.vertices, part.faces, points)) > 0.5
    out = np.zeros(len(points))
    if inside.any():
        square = igl.point_mesh_squared_distance(points[inside], part.vertices, part.faces)[0]
        out[inside] = np.sqrt(np.asarray(square))
    return out


def skin_of(part: Surface, faces: Sequence[Face]) -> Skin:
    """Of a part without hollows."""
    corners = part.vertices[part.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(outward, axis=1)
    free = area > 1e-9
    for face in faces:
        free &= (np.abs(corners @ face.normal - face.height) > 1e-3).any(axis=1)
    rng = np.random.default_rng(0)
    which = rng.choice(np.flatnonzero(free), _POINTS, p=area[free] / area[free].sum())
    a, b = np.sqrt(rng.random(_POINTS)), rng.random(_POINTS)
    weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
    # A narrow strip that looks elsewhere may be missed by chance: the largest facet of each way.
    large = np.flatnonzero(free)[np.argsort(-area[free], kind="stable")]
    ways = np.round(outward[large] / area[large, None], 1)
    first = large[np.sort(np.unique(ways, axis=0, return_index=True)[1])][:_WAYS]
    which = np.concatenate([which, first])
    weights = np.concatenate([weights, np.full((len(first), 3), 1 / 3)])
    normals = outward[which] / area[which, None]
    points = np.einsum("nk,nkd->nd", weights, corners[which]) + _OFF * normals
    return Skin(part, points, normals)


def shell_opening(name: str, skin: Skin, faces: Sequence[Face], rules: MouldRules) -> Opening:
    """The way with the fewest pieces in which the shell comes off, and of these that with the least
    strain. Raises FabricationError where there is none."""
    tried = _candidates(skin, faces)
    found: list[Opening] = []
    for direction in tried[:_TRIED]:
        strain, at = skin.strain(skin.depths(direction))
        found.append(Opening((direction,), None, strain, at))
        if strain == 0:
            return found[-1]
    best = min(found, key=lambda o: o.strain)
    if best.strain <= rules.strain:
        return best
    pairs = [_pair(skin, d) for d in _axes(skin, faces)]
    best = min([best, *pairs], key=lambda o: o.strain)
    if best.strain <= rules.strain:
        return best
    where = format_point(best.at) if best.at is not None else "its skin"
    raise FabricationError(
        f"{name} cannot be cast: however its mould is divided, the part would be strained by"
        f" {best.strain:.0%} of its thickness near {where} as it is taken out, and"
        f" {rules.strain:.0%} is taken as safe; let a cord's plane pass through the widest place"
        " there, add a cord, or choose a process that prints",
        code="undercut-too-deep",
        part=name,
        strain=best.strain,
        at=None if best.at is None else best.at.tolist(),
    )


def _candidates(skin: Skin, faces: Sequence[Face]) -> list[Float]:
    """Directions, those first into which the least of the skin looks back: of equal ones those that
    save a piece, by opening where another face's lid does."""
    own = [*_widest(skin.normals), *(f.normal for f in faces[1:])]
    mean = np.sum([f.normal for f in faces], axis=0)
    plain = [-faces[0].normal, -mean / max(float(np.linalg.norm(mean)), 1e-9)]
    around = np.linalg.svd(skin.points - skin.points.mean(0), full_matrices=False)[2]
    plain += [*np.eye(3), *-np.eye(3), *around, *-around, *skin.normals[:60]]
    plain += [_unit(a + b) for a, b in zip(skin.normals[:60], skin.normals[60:120], strict=True)]
    plain += [-f.normal for f in faces[1:]]
    every = [d for d in (*own, *plain) if np.linalg.norm(d) > _WHOLE]  # sums may vanish
    back = [float(np.clip(-(skin.normals @ d) - _LEVEL, 0, None).sum()) for d in every]
    # A lid's own way into the mould is the way in which nothing else may come.
    allowed = [k for k, d in enumerate(every) if d @ faces[0].normal < 0.5]
    order = sorted(allowed, key=lambda k: (round(back[k], 2), k))
    return [every[k] for k in order]


def _widest(normals: Float) -> list[Float]:
    """The direction that none of the skin looks back from, and that it looks along the most, by a
    linear program; none where there is no such direction."""
    rows = np.unique(np.round(normals, 8), axis=0)
    done = linprog(
        -normals.mean(axis=0),
        A_ub=-rows,
        b_ub=np.full(len(rows), 1e-7),
        bounds=[(-1, 1)] * 3,
        method="highs",
    )
    found = done.status == 0 and np.linalg.norm(done.x) > 0.5
    return [_unit(np.asarray(done.x))] if found else []


def _unit(vector: Float) -> Float:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


def _axes(skin: Skin, faces: Sequence[Face]) -> list[Float]:
    """Directions of two pieces that open opposite ways."""
    around = np.linalg.svd(skin.points - skin.points.mean(0), full_matrices=False)[2]
    every = [*(f.normal for f in faces), *np.eye(3), *around]
    out: list[Float] = []
    for d in every:
        if all(abs(d @ other) < 0.999 for other in out):
            out.append(d)
    return out


def _pair(skin: Skin, direction: Float) -> Opening:
    """Two pieces, divided by the plane that leaves the fewest points to the one that they do not
    come off with."""
    up, down = skin.depths(direction), skin.depths(-direction)
    only_up, only_down = (up <= _DEEP) & (down > _DEEP), (down <= _DEEP) & (up > _DEEP)
    axes = frame(direction)
    local = skin.points @ axes
    middle = local.mean(axis=0)
    plane = _between(local - middle, only_up, only_down)
    above = (local - middle)[:, 2] > np.column_stack(
        [np.ones(len(local)), (local - middle)[:, :2]]
    ) @ plane
    depths = np.where(above, up, down)
    strain, at = skin.strain(depths)
    normal = _unit(axes @ np.array([-plane[1], -plane[2], 1.0]))
    point = axes @ (middle + np.array([0, 0, plane[0]]))
    return Opening((direction, -direction), (normal, float(normal @ point)), strain, at)


def _between(local: Float, high: Bool, low: Bool) -> Float:
    """Coefficients (3,) of z = a + b x + c y that has the `high` points (n, 3) above it and the
    `low` ones below, by the least sum of what they lie on the wrong side (a linear program)."""
    a = np.column_stack([np.ones(len(local)), local[:, :2]])
    rows = np.concatenate([a[high], -a[low]])
    bound = np.concatenate([local[high, 2], -local[low, 2]])
    n = len(rows)
    if n == 0:
        return np.zeros(3)
    cost = np.concatenate([np.zeros(3), np.ones(n)])
    done = linprog(
        cost,
        A_ub=np.hstack([rows, -np.eye(n)]),
        b_ub=bound,
        bounds=[(None, None), (-3, 3), (-3, 3), *([(0, None)] * n)],
        method="highs",
    )
    return np.asarray(done.x[:3]) if done.status == 0 else np.array([np.median(local[:, 2]), 0, 0])
