"""Measure where a part needs supports as it is printed.

A facet overhangs if it faces down within 30 degrees of level above the bed. Printers bridge narrow
gaps: a region of such facets needs supports where it is too far from the edges at which the part
continues below it. A long ceiling between two close walls needs none, a slender beam does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...core.arrays import Bool, Float, Int
from ...core.mesh import Surface, triangle_edges
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal

#: Facets closer to level than this overhang: threshold of slicers (PrusaSlicer,
#: `support_material_threshold`; Cura, an overhang angle of 60 degrees from the vertical).
MAX_SLOPE_DEG = 30.0
#: Widest gap that is bridged: design rule for filament printers (Hubs, "How to design parts for FDM
#: 3D printing"). Ledges may be half as wide.
MAX_BRIDGE_MM = 5.0
MIN_HEIGHT_MM = 0.5  # above the bed: lower overhangs sag onto it, by no more than three layers
MIN_UNSUPPORTED_MM2 = 5.0  # beyond bridges; smaller areas print without supports
SAMPLE_MM = 0.25  # distance of the points at which overhangs are measured
MAX_SAMPLES = 50_000  # in a region
PLANE_TOLERANCE_MM = (
    1e-3  # of facets to the plane of a cut face: above the gap between mating faces
)


@dataclass(frozen=True)
class Overhang:
    """The overhangs of a part that need supports.

    Attributes:
        area: Area of their facets, mm^2.
        height: Largest height above the bed, mm.
        volume: Volume between them and the bed, mm^3.
        point: Middle (3,) of their facets in the part's frame, mm, or None if there are none.
        cut_area: Area of those facets that are in cut faces, mm^2.
    """

    area: float
    height: float
    volume: float
    point: Float | None
    cut_area: float = 0.0

    @property
    def face(self) -> str:
        """What the facets belong to, in words; areas that print without supports do not count."""
        skin_area = self.area - self.cut_area
        is_skin, is_cut = (a > MIN_UNSUPPORTED_MM2 for a in (skin_area, self.cut_area))
        if is_skin and is_cut:
            return "skin and cut face"
        return "cut face" if self.cut_area > skin_area else "skin"


def measure_overhang(
    solid: Any, down: Float, cut_faces: Sequence[tuple[Float, float]] = ()
) -> Overhang:
    """Measure the overhangs of a part that need supports.

    Args:
        solid: The part without its grooves and sockets, which need none (manifold3d solid, mm).
        down: Direction (3,) to the bed.
        cut_faces: Planes of the part's cut faces as outward normal (3,) and offset, mm.

    Returns:
        The overhangs of which more than `MIN_UNSUPPORTED_MM2` are farther from the part below them
        than half a bridge.
    """
    axes = axes_from_normal(-down)
    upright = triangle_kernel.to_plane_frame(solid, axes, np.zeros(3))
    bed = upright.bounding_box()[2]
    surface = triangle_kernel.to_surface(upright)
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    areas = np.linalg.norm(normals, axis=1)
    is_level = -normals[:, 2] > np.cos(np.radians(MAX_SLOPE_DEG)) * areas
    is_overhang = is_level & (corners[..., 2].max(axis=1) > bed + MIN_HEIGHT_MM)
    if not is_overhang.any():
        return Overhang(0.0, 0.0, 0.0, None)
    regions = [r for r in _find_regions(surface, is_overhang) if _needs_supports(r)]
    if not regions:
        return Overhang(0.0, 0.0, 0.0, None)
    facets = np.concatenate([r.facets for r in regions])
    middles = corners[facets].mean(axis=1)
    is_cut = _are_in_planes(corners[facets] @ axes.T, normals[facets] @ axes.T, cut_faces)
    return Overhang(
        area=float(areas[facets].sum()),
        height=float(corners[facets, :, 2].max() - bed),
        volume=float(-normals[facets, 2] @ (middles[:, 2] - bed)),
        point=axes @ np.average(middles, axis=0, weights=areas[facets]),
        cut_area=float(areas[facets][is_cut].sum()),
    )


def _are_in_planes(corners: Float, normals: Float, planes: Sequence[tuple[Float, float]]) -> Bool:
    """Return which triangles (k, 3, 3) with `normals` (k, 3) are in a plane and face its way."""
    is_inside = np.zeros(len(corners), bool)
    for normal, offset in planes:
        distance = np.abs(corners @ normal - offset).max(axis=1)
        is_inside |= (distance < PLANE_TOLERANCE_MM) & (normals @ normal > 0)
    return is_inside


@dataclass(frozen=True)
class _Region:
    """Connected facets that overhang.

    Attributes:
        facets: Their indices (k,).
        corners: Their corners (k, 3, 2), seen from above, mm.
        supported: Ends (e, 2, 2) of the edges below which the part continues, mm.
    """

    facets: Int
    corners: Float
    supported: Float


def _find_regions(surface: Surface, is_overhang: Bool) -> list[_Region]:
    """Return the regions of overhanging facets of an upright surface."""
    edges, _, edge_of_side = triangle_edges(surface.faces)
    sides = np.argsort(edge_of_side, kind="stable").reshape(-1, 2)  # two facets meet at each edge
    pairs = sides // 3
    inner = pairs[is_overhang[pairs].all(axis=1)]
    count = len(surface.faces)
    links = coo_matrix((np.ones(len(inner)), (inner[:, 0], inner[:, 1])), (count, count))
    region_of_facet = connected_components(links, directed=False)[1]

    heights = surface.vertices[:, 2]
    is_border = is_overhang[pairs].sum(axis=1) == 1
    ends, border = edges[is_border], pairs[is_border]
    rows = np.arange(len(border))
    outside = border[rows, is_overhang[border].argmin(axis=1)]
    own = border[rows, is_overhang[border].argmax(axis=1)]
    opposite = heights[surface.faces[outside]].sum(axis=1) - heights[ends].sum(axis=1)
    edge_height = heights[ends].mean(axis=1)
    is_supported = (opposite < edge_height) | (edge_height < heights.min() + MIN_HEIGHT_MM)

    facets, supported = np.flatnonzero(is_overhang), np.flatnonzero(is_supported)
    regions, facet_groups = _group(region_of_facet[facets], facets)
    groups = dict(zip(*_group(region_of_facet[own[supported]], supported), strict=True))
    nothing = np.zeros(0, np.int64)
    flat = surface.vertices[:, :2]
    return [
        _Region(group, flat[surface.faces[group]], flat[ends[groups.get(region, nothing)]])
        for region, group in zip(regions, facet_groups, strict=True)
    ]


def _group(keys: Int, values: Int) -> tuple[list[int], list[Int]]:
    """Return the sorted different keys, and the values (n,) of each in their order."""
    order = np.argsort(keys, kind="stable")
    unique, start = np.unique(keys[order], return_index=True)
    return unique.tolist(), np.split(values[order], start[1:]) if len(unique) else []


def _needs_supports(region: _Region) -> bool:
    """Return whether enough of a region is farther from its supported edges than half a bridge."""
    a, ab, ac = (region.corners[:, k] - (k > 0) * region.corners[:, 0] for k in range(3))
    area = np.abs(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / 2
    unsupported = float(area.sum())
    if len(region.supported) and unsupported > MIN_UNSUPPORTED_MM2:
        edges = cKDTree(_sample_edges(region.supported))
        distance = edges.query(_sample_triangles(a, ab, ac, area))[0]
        unsupported *= float((distance > MAX_BRIDGE_MM / 2).mean())
    return unsupported > MIN_UNSUPPORTED_MM2


def _sample_triangles(a: Float, ab: Float, ac: Float, area: Float) -> Float:
    """Return random points (n, 2) in triangles with corners `a`, `a + ab` and `a + ac` (k, 2)."""
    count = min(int(np.ceil(area.sum() / SAMPLE_MM**2)), MAX_SAMPLES)
    levels = (np.arange(count) + 0.5) / count * area.sum()
    k = np.minimum(np.searchsorted(np.cumsum(area), levels), len(area) - 1)
    u, v = np.random.default_rng(0).random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return np.asarray(a[k] + u * ab[k] + v * ac[k])


def _sample_edges(ends: Float) -> Float:
    """Return points (n, 2) of edges (e, 2, 2) at most `SAMPLE_MM` apart."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    counts = np.ceil(np.linalg.norm(along, axis=1) / SAMPLE_MM).astype(int) + 1
    edge = np.repeat(np.arange(len(ends)), counts)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = step / np.maximum(counts - 1, 1)[edge]
    return np.asarray(start[edge] + share[:, None] * along[edge])
