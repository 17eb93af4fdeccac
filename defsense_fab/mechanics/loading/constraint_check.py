"""Is the body held? Rigid motions that boundary conditions leave free, loose pieces, thin holds."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...core.arrays import Float, Int
from ...core.errors import DeviceError
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh
from .boundary_conditions import BoundaryConditions

#: A region narrower than this many edges is torn rather than held.
MIN_REGION_WIDTH_EDGES = 1.5


def check_constraints(mesh: QuadraticMesh, conditions: BoundaryConditions, label: str) -> list[str]:
    """Warnings about regions so small that the strain beside them depends on the mesh.

    Raises DeviceError where the body is not in one piece, where it can still move as a whole, and
    where a drag takes hold outside the body.
    """
    pieces = _pieces(mesh)
    if pieces.max() > 0:
        smallest = np.argmin(np.bincount(pieces))
        where = ", ".join(f"{v:.4g}" for v in mesh.nodes[pieces == smallest].mean(0))
        count = int(pieces.max()) + 1
        raise DeviceError(
            f"it is made of {count} pieces that do not touch, one about ({where}) mm",
            code="body-in-pieces",
            where="device.toml: body",
            action="Join them or remove all but one",
            count=count,
        )
    _check_drags(mesh, conditions, label)
    loose = _loose_motion(mesh, conditions)
    if loose is not None:
        motion, axis = loose
        direction = f"({axis[0]:g}, {axis[1]:g}, {axis[2]:g})"
        raise DeviceError(
            f"in {label!r} the body can still {motion} {direction} as a whole",
            code="body-not-held",
            where="device.toml: poses",
            action="Fix a region or prescribe more of a handle's motion",
            pose=label,
            motion=motion.split()[0],
            axis=axis,
        )
    return [w for h in conditions.handles for w in warn_small_region(mesh, h.nodes, h.name)]


def warn_small_region(mesh: QuadraticMesh, nodes: Int, name: str) -> list[str]:
    """A warning about a region of `nodes` (k,) that is too small to hold the body by."""
    size = float(np.sort(np.ptp(mesh.nodes[nodes], axis=0))[1])
    if size >= MIN_REGION_WIDTH_EDGES * mesh.edge_length:
        return []
    return [
        f"region {name!r} is {size:.2g} mm wide, less than {MIN_REGION_WIDTH_EDGES:g} edges of the mesh: the strain"
        " beside it is as large as the mesh lets it be; enlarge it"
    ]


def _pieces(mesh: QuadraticMesh) -> Int:
    count = len(mesh.nodes)
    rows = np.repeat(mesh.cells[:, 0], 9)
    graph = sp.coo_matrix((np.ones(len(rows)), (rows, mesh.cells[:, 1:].ravel())), (count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _check_drags(mesh: QuadraticMesh, conditions: BoundaryConditions, label: str) -> None:
    if not conditions.drags:
        return
    points = np.array([d.at for d in conditions.drags])
    depth = PointLocator(mesh).find(points).depth
    for point, inside in zip(points, depth, strict=True):
        if inside < -0.05:
            where = ", ".join(f"{v:g}" for v in point)
            raise DeviceError(
                f"({where}) lies outside the body",
                code="drag-outside-body",
                where=f"device.toml: poses: {label!r}: drags",
                action="Choose a point inside the body",
                pose=label,
                point=tuple(point.tolist()),
            )


def _loose_motion(
    mesh: QuadraticMesh, conditions: BoundaryConditions
) -> tuple[str, tuple[float, ...]] | None:
    """Return a rigid motion that the constraints leave free, in words and as its axis."""
    center = mesh.nodes.mean(0)
    size = float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    rows: list[Float] = []  # on (v, size * omega): the velocity at X is v + omega x (X - center)

    def at(point: Float, direction: Float) -> None:
        rows.append(np.concatenate([direction, np.cross((point - center) / size, direction)]))

    for n in _few(conditions.fixed, mesh.nodes):
        for axis in np.eye(3):
            at(mesh.nodes[n], axis)
    for slide in conditions.slides:
        for n in _few(slide.nodes, mesh.nodes):
            at(mesh.nodes[n], slide.normal)
    for drag in conditions.drags:
        for axis in np.eye(3):
            at(drag.at, axis)
    for h in conditions.handles:
        for axis in np.eye(3)[~np.isnan(h.translation)]:
            at(h.center, axis)
        held = np.eye(3) - h.free_axes.T @ h.free_axes
        rows += [np.concatenate([np.zeros(3), row]) for row in held]
    matrix = np.array(rows) if rows else np.zeros((1, 6))
    _, s, vt = np.linalg.svd(matrix)
    rank = int((s > 1e-4 * max(s.max(), 1.0)).sum())
    if rank == 6:
        return None
    loose = vt[rank:]
    turn = np.linalg.svd(loose[:, 3:])
    if turn[1].max(initial=0.0) > 1e-3:
        axis = np.round(turn[2][0], 2) + 0.0
        return "turn about the direction", tuple(axis.tolist())
    axis = np.round(loose[0, :3], 2) + 0.0
    return "move along the direction", tuple(axis.tolist())


def _few(chosen: Int, nodes: Float) -> Int:
    """A few of the nodes that are as far apart as can be."""
    if len(chosen) == 0:
        return chosen
    x = nodes[chosen]
    picked = [0]
    distance = np.full(len(x), np.inf)
    for _ in range(7):
        distance = np.minimum(distance, np.linalg.norm(x - x[picked[-1]], axis=1))
        picked.append(int(np.argmax(distance)))
    return chosen[picked]
