"""Rebuild a surface that passes through itself, and measure how far a repair moved it.

Inside a box around each crossing, the body is where the winding number exceeds 0.5, on a grid that
is finer for smaller boxes; outside the boxes the triangles stay as they are.

fTetWild also meshes surfaces that cross themselves, but cannot replace this: parts are cut from the
surface, which it would remesh everywhere, differently each time, and not on every platform.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import manifold3d as m3
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.mesh import Surface, facet_crosses
from ...kernels import triangle_kernel
from ...kernels.surface_queries import SignedDistance
from .crossings import winding_on_both_sides

#: Function that returns which points (n, 3) are inside.
Inside = Callable[[Float], Bool]

MAX_SAMPLES = 40_000  # measured in each direction
MATCH_SHARE = 1e-9  # of the size
INWARD_SHARE = 1e-3  # of the way from a corner to the opposite side
# Weights of a triangle's corners.
FIXED_WEIGHTS = np.concatenate([np.full((1, 3), 1 / 3), np.eye(3), (1 - np.eye(3)) / 2])


def measure_displacement(before: Surface, after: Surface, size: float) -> float:
    """Return how far a repair moved a surface.

    Args:
        before: The surface before.
        after: The surface after.
        size: Diagonal of the bounding box, mm.

    Returns:
        The largest distance, mm, from new triangles to the surface before, and from removed
        triangles to the surface after. Removed triangles count only where exactly one of their
        sides was outside, even if they were turned inside out: the rest was buried.
    """
    added = _sample(after, _find_new(after, before, size))[0]
    points, inner_points, normals = _sample(before, _find_new(before, after, size))
    behind, front = (
        np.abs(w) < 0.5 for w in winding_on_both_sides(before, inner_points, normals, size)
    )
    is_exposed = behind != front
    return max(_largest_distance(added, before), _largest_distance(points[is_exposed], after))


def _find_new(mesh: Surface, other: Surface, size: float) -> Bool:
    """Return the triangles (m,) that the other mesh does not have."""
    mine, theirs = (
        np.round(s.vertices[s.faces].mean(1) / (MATCH_SHARE * size)) for s in (mesh, other)
    )
    _, index = np.unique(np.concatenate([theirs, mine]), axis=0, return_inverse=True)
    index = index.reshape(-1)
    return np.asarray(~np.isin(index[len(theirs) :], index[: len(theirs)]))


def _sample(mesh: Surface, chosen: Bool) -> tuple[Float, Float, Float]:
    """Sample the chosen triangles: always their corners, edge centers and center, and more by area.

    Return points (n, 3), for each a nearby point that is not on an edge, and the triangles'
    normals.
    """
    corners = mesh.vertices[mesh.faces[chosen]]
    cross = facet_crosses(mesh.vertices, mesh.faces[chosen])
    area = np.linalg.norm(cross, axis=1)
    corners, cross, area = corners[area > 0], cross[area > 0], area[area > 0]
    if not len(corners):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))
    rng = np.random.default_rng(0)
    face = rng.choice(len(area), min(MAX_SAMPLES, 20 * len(area)), p=area / area.sum())
    a, b = np.sqrt(rng.random(len(face))), rng.random(len(face))
    weights = np.concatenate(
        [np.tile(FIXED_WEIGHTS, (len(area), 1)), np.stack([1 - a, a * (1 - b), a * b], axis=1)]
    )
    face = np.concatenate([np.repeat(np.arange(len(area)), len(FIXED_WEIGHTS)), face])
    step = max(1, len(face) // (2 * MAX_SAMPLES))
    face, weights = face[::step], weights[::step]
    points, within = (
        np.einsum("ni,nij->nj", w, corners[face])
        for w in (weights, (1 - 3 * INWARD_SHARE) * weights + INWARD_SHARE)
    )
    return points, within, (cross / area[:, None])[face]


def _largest_distance(points: Float, surface: Surface) -> float:
    return float(SignedDistance(surface).unsigned(points).max()) if len(points) else 0.0


BOX_MARGIN_SHARE = 0.08  # of a box's longest side, on each side
MIN_MARGIN_SHARE = 1e-3  # of the size


def enclose_in_boxes(surface: Surface, bad: Bool, size: float, wider: float) -> Float:
    """Return disjoint boxes (k, 2, 3) around bad triangles, with a margin.

    Args:
        surface: The surface.
        bad: Flags (m,) of the triangles to enclose.
        size: Diagonal of the bounding box, mm.
        wider: Factor on the usual margin.
    """
    corners = surface.vertices[surface.faces[bad]]
    cores = np.stack([corners.min(1), corners.max(1)], axis=1)
    while True:
        margin = wider * np.maximum(
            BOX_MARGIN_SHARE * np.ptp(cores, axis=1).max(1), MIN_MARGIN_SHARE * size
        )
        boxes = cores + margin[:, None, None] * np.array([[-1.0], [1.0]])
        groups = _group_overlapping(boxes)
        names = np.unique(groups)
        if len(names) == len(boxes):
            return np.asarray(boxes)
        cores = np.array(
            [[cores[groups == g, 0].min(0), cores[groups == g, 1].max(0)] for g in names]
        )


def _group_overlapping(boxes: Float) -> Int:
    """Return a group number (k,) for each box: boxes that overlap, also through others, share
    one.
    """
    order = np.argsort(boxes[:, 0, 0], kind="stable")
    group = np.arange(len(boxes))

    def root(i: int) -> int:
        while group[i] != i:
            group[i] = group[group[i]]
            i = int(group[i])
        return i

    starts, highs = boxes[order, 0], boxes[order, 1]
    for i in range(len(order)):
        until = int(np.searchsorted(starts[:, 0], highs[i, 0], side="right"))
        candidates = np.arange(i + 1, until)
        candidates = candidates[
            (starts[candidates, 1] <= highs[i, 1])
            & (highs[candidates, 1] >= starts[i, 1])
            & (starts[candidates, 2] <= highs[i, 2])
            & (highs[candidates, 2] >= starts[i, 2])
        ]
        for j in candidates:
            group[root(int(order[j]))] = root(int(order[i]))
    return np.array([root(i) for i in range(len(boxes))])


CELLS_PER_BOX = 44  # along the longest side of a box
MAX_CELLS = 2_000_000
BISECTIONS = 7
SIMPLIFY_CELLS = 0.05  # tolerance of the simplification
MIN_EDGE_SHARE = 0.02  # of a grid edge, between its ends and the surface


def rebuild_in_boxes(surface: Surface, boxes: Float) -> Surface | None:
    """Rebuild the contents of boxes (k, 2, 3) of a surface.

    Returns:
        The new surface, or None if the triangle kernel does not accept the given one.
    """
    body = triangle_kernel.try_manifold(surface)
    if body is None:
        return None
    inside = SignedDistance(surface).inside
    patches = []
    for low, high in boxes:
        cell = float((high - low).max()) / CELLS_PER_BOX
        patch = _patch(inside, low - 2 * cell, high + 2 * cell, cell)
        body -= _box(low, high)
        if patch is not None:
            # A little wider than what was cut out, so that no gap is left.
            patches.append(patch ^ _box(low - 0.5 * cell, high + 0.5 * cell))
    rebuilt = triangle_kernel.union([body, *patches])
    return None if rebuilt.is_empty() else triangle_kernel.to_surface(rebuilt)


def rebuild_whole(surface: Surface, cells: int) -> Surface | None:
    """Rebuild a whole surface with about `cells` grid cells along its longest side.

    Returns:
        The new surface, or None if the given one encloses nothing.
    """
    low, high = surface.bounds
    extent = high - low
    cell = max(
        float(extent.max()) / cells,
        float(np.prod(extent + 1e-3 * extent.max()) / MAX_CELLS) ** (1 / 3),
    )
    patch = _patch(SignedDistance(surface).inside, low - 2 * cell, high + 2 * cell, cell)
    return None if patch is None or patch.is_empty() else triangle_kernel.to_surface(patch)


def _box(low: Float, high: Float) -> Any:
    return m3.Manifold.cube(tuple(high - low)).translate(tuple(low))


def _patch(inside: Inside, low: Float, high: Float, cell: float) -> Any:
    """Return a manifold3d solid of what is inside a box, with its vertices on the surface."""
    # Off the planes in which bodies often have faces.
    low = low - cell * np.array([0.137, 0.291, 0.413])
    shape = np.ceil((high - low) / cell).astype(int) + 2
    axes = [low[i] + cell * np.arange(shape[i]) for i in range(3)]
    flags = np.zeros(tuple(shape), bool)
    for i, x in enumerate(axes[0]):  # layer by layer, to save memory
        y, z = np.meshgrid(axes[1], axes[2], indexing="ij")
        points = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)
        flags[i] = inside(points).reshape(y.shape)
    for axis in range(3):  # closed where the box ends
        ends = np.moveaxis(flags, axis, 0)
        ends[0] = ends[-1] = False
    if not flags.any():
        return None
    grid, faces = _march(flags)
    vertices = _move_to_surface(grid, flags, inside, low, cell)
    solid = triangle_kernel.try_manifold(Surface(vertices, faces))
    return None if solid is None else solid.simplify(SIMPLIFY_CELLS * cell)


def _march(flags: Any) -> tuple[Float, Int]:
    """Return the surface around the grid points that are inside: vertices half way along grid
    edges, in cells, and triangles.
    """
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    image = vtk.vtkImageData()
    image.SetDimensions(*flags.shape)
    values = numpy_to_vtk(flags.transpose(2, 1, 0).ravel().astype(np.float32), deep=True)
    image.GetPointData().SetScalars(values)
    marching = vtk.vtkFlyingEdges3D()
    marching.SetInputData(image)
    marching.SetValue(0, 0.5)
    marching.ComputeNormalsOff()
    marching.ComputeScalarsOff()
    marching.Update()
    output = marching.GetOutput()
    vertices = vtk_to_numpy(output.GetPoints().GetData()).astype(float)
    faces = vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    return vertices, faces[:, ::-1] if Surface(vertices, faces).volume < 0 else faces


def _move_to_surface(grid: Float, flags: Any, inside: Inside, low: Float, cell: float) -> Float:
    """Move each vertex along its grid edge to where the inside ends."""
    start = np.floor(grid + 1e-3).astype(int)
    end = np.ceil(grid - 1e-3).astype(int)
    first_in = flags[tuple(start.T)]
    within = np.where(first_in[:, None], start, end) * cell + low
    without = np.where(first_in[:, None], end, start) * cell + low
    low_share, high_share = np.zeros(len(grid)), np.ones(len(grid))
    for _ in range(BISECTIONS):
        middle = (low_share + high_share) / 2
        is_in = inside(within + middle[:, None] * (without - within))
        low_share, high_share = (
            np.where(is_in, middle, low_share),
            np.where(is_in, high_share, middle),
        )
    at = np.clip((low_share + high_share) / 2, MIN_EDGE_SHARE, 1 - MIN_EDGE_SHARE)
    return np.asarray(within + at[:, None] * (without - within))
