"""Check that boundary conditions hold the body: no free rigid motion, one piece, wide regions."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...core.arrays import Float, Int
from ...core.errors import DeviceError
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh
from .boundary_conditions import BoundaryConditions

#: Width in mesh edges below which the strain next to a held region depends on the mesh.
MIN_REGION_WIDTH_EDGES = 1.5


def check_constraints(mesh: QuadraticMesh, conditions: BoundaryConditions, label: str) -> list[str]:
    """Check that boundary conditions determine the body's position.

    Args:
        mesh: Mesh of the body.
        conditions: Conditions on its nodes.
        label: Name of the pose, for messages.

    Returns:
        Warnings about handles so small that the strain next to them depends on the mesh.

    Raises:
        DeviceError: If the body is not in one piece, can still move as a whole, or a drag pulls at
            a point outside.
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
    free = _free_motion(mesh, conditions)
    if free is not None:
        motion, axis = free
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
    """Return a warning, in a list, if a region of `nodes` (k,) is too small to hold the body."""
    size = float(np.sort(np.ptp(mesh.nodes[nodes], axis=0))[1])
    if size >= MIN_REGION_WIDTH_EDGES * mesh.edge_length:
        return []
    return [
        f"region {name!r} is {size:.2g} mm wide, less than {MIN_REGION_WIDTH_EDGES:g} edges of the"
        " mesh: the strain next to it depends on the mesh. Enlarge it"
    ]


def _pieces(mesh: QuadraticMesh) -> Int:
    """Return the number (n,) of the connected piece that each node belongs to."""
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


def _free_motion(
    mesh: QuadraticMesh, conditions: BoundaryConditions
) -> tuple[str, tuple[float, ...]] | None:
    """Return a rigid motion that the constraints leave free, in words and as its axis."""
    center = mesh.nodes.mean(0)
    size = float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    rows: list[Float] = []  # on (v, size * omega): the velocity at X is v + omega x (X - center)

    def constrain(point: Float, direction: Float) -> None:
        rows.append(np.concatenate([direction, np.cross((point - center) / size, direction)]))

    for n in _spread_sample(conditions.fixed, mesh.nodes):
        for axis in np.eye(3):
            constrain(mesh.nodes[n], axis)
    for slide in conditions.slides:
        for n in _spread_sample(slide.nodes, mesh.nodes):
            constrain(mesh.nodes[n], slide.normal)
    for drag in conditions.drags:
        for axis in np.eye(3):
            constrain(drag.at, axis)
    for h in conditions.handles:
        for axis in np.eye(3)[~np.isnan(h.translation)]:
            constrain(h.center, axis)
        held = np.eye(3) - h.free_axes.T @ h.free_axes
        rows += [np.concatenate([np.zeros(3), row]) for row in held]
    matrix = np.array(rows) if rows else np.zeros((1, 6))
    _, s, vt = np.linalg.svd(matrix)
    rank = int((s > 1e-4 * max(s.max(), 1.0)).sum())
    if rank == 6:
        return None
    free = vt[rank:]
    turn = np.linalg.svd(free[:, 3:])
    if turn[1].max(initial=0.0) > 1e-3:
        axis = np.round(turn[2][0], 2) + 0.0
        return "turn about the direction", tuple(axis.tolist())
    axis = np.round(free[0, :3], 2) + 0.0
    return "move along the direction", tuple(axis.tolist())


def _spread_sample(chosen: Int, nodes: Float) -> Int:
    """Pick eight of the chosen nodes that are as far from each other as possible."""
    if len(chosen) == 0:
        return chosen
    x = nodes[chosen]
    picked = [0]
    distance = np.full(len(x), np.inf)
    for _ in range(7):
        distance = np.minimum(distance, np.linalg.norm(x - x[picked[-1]], axis=1))
        picked.append(int(np.argmax(distance)))
    return chosen[picked]
