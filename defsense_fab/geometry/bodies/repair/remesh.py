"""A surface that passes through itself, made anew there from what it encloses.

In a box around each crossing, the body is what has a winding number above 0.5, on a grid whose
cells are the finer the smaller the box is; outside of the boxes the triangles stay as they are.
"""

from __future__ import annotations

from typing import Any

import igl
import manifold3d as m3
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.mesh import facet_crosses
from .crossings import Inside, beside

# How far a repair moved the surface.

_MOST = 40_000  # points that are measured, each way
_SAME = 1e-9  # of the size
_NEAR = 1e-3  # of the way from a corner to the other side
# Weights of a triangle's corners.
_FIXED = np.concatenate([np.full((1, 3), 1 / 3), np.eye(3), (1 - np.eye(3)) / 2])


def moved(before: tuple[Float, Int], after: tuple[Float, Int], size: float) -> float:
    """The largest distance from new triangles to the surface before, and from those before that
    are gone to the surface after, mm; of these, what was buried does not count: all but what has
    the outside on just one side, be it turned inside out."""
    new = _points(after, _new(after, before, size))[0]
    points, within, normals = _points(before, _new(before, after, size))
    behind, ahead = (np.abs(w) < 0.5 for w in beside(Inside(*before), within, normals, size))
    seen = behind != ahead
    return max(_farthest(new, before), _farthest(points[seen], after))


def _new(mesh: tuple[Float, Int], other: tuple[Float, Int], size: float) -> Bool:
    """Triangles (m,) that the other does not have."""
    mine, theirs = (np.round(v[f].mean(1) / (_SAME * size)) for v, f in (mesh, other))
    _, index = np.unique(np.concatenate([theirs, mine]), axis=0, return_inverse=True)
    index = index.reshape(-1)
    return np.asarray(~np.isin(index[len(theirs) :], index[: len(theirs)]))


def _points(mesh: tuple[Float, Int], chosen: Bool) -> tuple[Float, Float, Float]:
    """Points (n, 3) of the chosen triangles, as many on each as its area asks for, always its
    corners, the middles of its edges and its centre; beside each a point that is not on an edge;
    and the triangles' normals there."""
    corners = mesh[0][mesh[1][chosen]]
    cross = facet_crosses(mesh[0], mesh[1][chosen])
    area = np.linalg.norm(cross, axis=1)
    corners, cross, area = corners[area > 0], cross[area > 0], area[area > 0]
    if not len(corners):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))
    rng = np.random.default_rng(0)
    face = rng.choice(len(area), min(_MOST, 20 * len(area)), p=area / area.sum())
    a, b = np.sqrt(rng.random(len(face))), rng.random(len(face))
    weights = np.concatenate(
        [np.tile(_FIXED, (len(area), 1)), np.stack([1 - a, a * (1 - b), a * b], axis=1)]
    )
    face = np.concatenate([np.repeat(np.arange(len(area)), len(_FIXED)), face])
    step = max(1, len(face) // (2 * _MOST))
    face, weights = face[::step], weights[::step]
    points, within = (
        np.einsum("ni,nij->nj", w, corners[face])
        for w in (weights, (1 - 3 * _NEAR) * weights + _NEAR)
    )
    return points, within, (cross / area[:, None])[face]


def _farthest(points: Float, mesh: tuple[Float, Int]) -> float:
    if not len(points):
        return 0.0
    found = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1])
    )[0]
    return float(np.sqrt(np.max(found)))


# The parts of a surface that are to be made anew: boxes around what crosses there.

_MARGIN = 0.08  # of a box's longest side, on each side
_LEAST = 1e-3  # of the size


def boxes_around(vertices: Float, faces: Int, bad: Bool, size: float, wider: float) -> Float:
    """Boxes (k, 2, 3) apart from each other that hold the bad triangles with a margin, `wider`
    times what is usual."""
    corners = vertices[faces[bad]]
    grown = np.stack([corners.min(1), corners.max(1)], axis=1)
    while True:
        margin = wider * np.maximum(_MARGIN * np.ptp(grown, axis=1).max(1), _LEAST * size)
        out = grown + margin[:, None, None] * np.array([[-1.0], [1.0]])
        groups = _overlapping(out)
        names = np.unique(groups)
        if len(names) == len(out):
            return np.asarray(out)
        grown = np.array(
            [[grown[groups == g, 0].min(0), grown[groups == g, 1].max(0)] for g in names]
        )


def _overlapping(boxes: Float) -> Int:
    """A number (k,) of each box: those that overlap, by others too, have the same."""
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
        near = np.arange(i + 1, until)
        near = near[
            (starts[near, 1] <= highs[i, 1])
            & (highs[near, 1] >= starts[i, 1])
            & (starts[near, 2] <= highs[i, 2])
            & (highs[near, 2] >= starts[i, 2])
        ]
        for j in near:
            group[root(int(order[j]))] = root(int(order[i]))
    return np.array([root(i) for i in range(len(boxes))])


_CELLS = 44  # along a local box's longest side
_MOST_CELLS = 2_000_000
_BISECTIONS = 7
_FLAT = 0.05  # of a cell: how far triangles may be off the surface for there to be fewer
_END = 0.02  # of a grid edge: how near to its ends the surface may lie


def remade(vertices: Float, faces: Int, boxes: Float) -> tuple[Float, Int] | None:
    """The surface with each box's content (k, 2, 3) made anew; None where the triangle kernel
    takes it for none."""
    body = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64))
    )
    if body.status() != m3.Error.NoError:
        return None
    inside = Inside(vertices, faces)
    new = []
    for low, high in boxes:
        cell = float((high - low).max()) / _CELLS
        patch = _patch(inside, low - 2 * cell, high + 2 * cell, cell)
        body -= _box(low, high)
        if patch is not None:
            # A little wider than what was cut out: no gap is left between.
            new.append(patch ^ _box(low - 0.5 * cell, high + 0.5 * cell))
    return _arrays(m3.Manifold.batch_boolean([body, *new], m3.OpType.Add))


def remade_whole(vertices: Float, faces: Int, cells: int) -> tuple[Float, Int] | None:
    """The whole surface made anew, with about `cells` along its longest side; None where it
    encloses nothing."""
    low, high = vertices[faces].min((0, 1)), vertices[faces].max((0, 1))
    extent = high - low
    cell = max(
        float(extent.max()) / cells, float(np.prod(extent + 1e-3 * extent.max()) / _MOST_CELLS)
        ** (1 / 3)
    )  # fmt: skip
    patch = _patch(Inside(vertices, faces), low - 2 * cell, high + 2 * cell, cell)
    return None if patch is None else _arrays(patch)


def _box(low: Float, high: Float) -> Any:
    return m3.Manifold.cube(tuple(high - low)).translate(tuple(low))


def _arrays(solid: Any) -> tuple[Float, Int] | None:
    mesh = solid.to_mesh64()
    faces = np.array(mesh.tri_verts, np.int64)
    return (np.array(mesh.vert_properties, float)[:, :3], faces) if len(faces) else None


def _patch(inside: Inside, low: Float, high: Float, cell: float) -> Any:
    """A manifold3d solid of what is in the box; its vertices lie on the surface."""
    # Not on planes that bodies like to have faces in.
    low = low - cell * np.array([0.137, 0.291, 0.413])
    shape = np.ceil((high - low) / cell).astype(int) + 2
    axes = [low[i] + cell * np.arange(shape[i]) for i in range(3)]
    flags = np.zeros(tuple(shape), bool)
    for i, x in enumerate(axes[0]):  # a layer at a time: less memory
        y, z = np.meshgrid(axes[1], axes[2], indexing="ij")
        points = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)
        flags[i] = inside(points).reshape(y.shape)
    for axis in range(3):  # closed where the box ends
        ends = np.moveaxis(flags, axis, 0)
        ends[0] = ends[-1] = False
    if not flags.any():
        return None
    grid, faces = _marched(flags)
    vertices = _on_surface(grid, flags, inside, low, cell)
    solid = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64))
    )
    return solid.simplify(_FLAT * cell) if solid.status() == m3.Error.NoError else None


def _marched(flags: Any) -> tuple[Float, Int]:
    """The surface around the grid points that are in: vertices half way along grid edges, in
    cells, and triangles."""
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
    made = marching.GetOutput()
    vertices = vtk_to_numpy(made.GetPoints().GetData()).astype(float)
    faces = vtk_to_numpy(made.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1]
    return vertices, faces


def _on_surface(grid: Float, flags: Any, inside: Inside, low: Float, cell: float) -> Float:
    """Along its grid edge, each vertex is moved to where the inside ends."""
    start = np.floor(grid + 1e-3).astype(int)
    end = np.ceil(grid - 1e-3).astype(int)
    first_in = flags[tuple(start.T)]
    within = np.where(first_in[:, None], start, end) * cell + low
    without = np.where(first_in[:, None], end, start) * cell + low
    near, far = np.zeros(len(grid)), np.ones(len(grid))
    for _ in range(_BISECTIONS):
        middle = (near + far) / 2
        is_in = inside(within + middle[:, None] * (without - within))
        near, far = np.where(is_in, middle, near), np.where(is_in, far, middle)
    at = np.clip((near + far) / 2, _END, 1 - _END)
    return np.asarray(within + at[:, None] * (without - within))
