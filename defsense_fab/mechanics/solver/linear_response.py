"""Linearize a body about rest: small loads, vibration modes, and the poses that modes propose.

The paper (DefSense, sec. "Future work") asks for deformations that a user need not invent. The
lowest modes of a body with a region fixed cost the least energy: they are what a hand will do to
it. A mode is classified as bend, twist or stretch of the body along the line from the held region
to the far end, and becomes a pose that turns or pulls that end.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spl
from scipy.spatial import cKDTree
from scipy.special import roots_jacobi

from ...core.arrays import Float, Int
from ..elements import tet10
from ..elements.material import Material
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh, boundary_faces, shape_functions
from ..loading.boundary_conditions import BoundaryConditions, State, rest_state
from ..loading.reduction import Reduction
from .linear_solver import make_solver


def small_load_displacement(
    mesh: QuadraticMesh, material: Material, fixed: Int, forces: Float
) -> Float:
    """Return the displacements under small nodal forces, to first order.

    They are too large if the body stiffens while it is bent or stretched.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        fixed: Numbers (k,) of the nodes that are held.
        forces: Nodal forces (n, 3) N.

    Returns:
        Displacements (n, 3) mm.
    """
    conditions = BoundaryConditions(fixed)
    reduction = Reduction(mesh, conditions)
    state = rest_state(conditions, len(mesh.nodes))
    F = tet10.deformation_gradient(reduction.active, state.u)
    solver = make_solver()
    try:
        solver.factor(reduction.matrix(state, material, F, 0.0, []))
        return reduction.displacement_increment(
            state, solver.solve(reduction.gradient(state, forces))
        )
    finally:
        solver.close()


def line_forces(locator: PointLocator, path: Float, tension: float) -> Float:
    """Return the nodal forces of a line under tension that slides along its path.

    It pulls at its ends and presses where it bends.

    Args:
        locator: Locator of the mesh.
        path: Points (p, 3) mm of the line.
        tension: Tension, N.

    Returns:
        Nodal forces (n, 3) N.
    """
    piece = np.diff(path, axis=0)
    pull = tension * piece / np.linalg.norm(piece, axis=1)[:, None]
    at = locator.find(path)
    spread = (
        shape_functions(at.bary)[:, :, None] * np.diff(pull, axis=0, prepend=0, append=0)[:, None]
    )
    out = np.zeros_like(locator.mesh.nodes)
    np.add.at(out, locator.mesh.cells[at.cell], spread)
    return out


END_FRACTION = 0.08  # of the body's length, which a proposed pose holds
SLICES = 12  # across the body, to classify a mode
POSE_TURN_RAD = np.deg2rad(30)
POSE_PULL_FRACTION = 0.15  # of the length
_MIRROR_TOLERANCE_EDGES = 0.75  # mesh edges by which a mirror image may differ from the body
_MAX_LEAN_RAD = np.deg2rad(10)  # of a symmetric body's bend, caused by its mesh alone

Kind = Literal["bend", "twist", "stretch"]


@dataclass(frozen=True)
class Mode:
    """A vibration mode.

    Attributes:
        frequency: Hz.
        shape: (n, 3), displacements scaled so that the largest component is 1.
        kind: Motion of the body along its axis.
        order: Number of sign changes of the motion along the body, plus one.
    """

    frequency: float
    shape: Float
    kind: Kind
    order: int


@dataclass(frozen=True)
class ProposedPose:
    """A pose that turns or moves the end of the body.

    Attributes:
        name: Name such as `bend_2`.
        mode: The mode it follows.
        origin: (3,) mm; the end is the part beyond it in the direction of `axis`.
        axis: (3,) unit direction from the held region to the end.
        rotation: (3,) rad, rotation vector of the end.
        translation: (3,) mm, NaN if free.
    """

    name: str
    mode: Mode
    origin: Float
    axis: Float
    rotation: Float
    translation: Float


def vibration_modes(
    mesh: QuadraticMesh, material: Material, fixed: Int, density: float, count: int = 8
) -> list[Mode]:
    """Compute the lowest vibration modes about rest.

    The mass matrix is consistent and the stiffness is the tangent at rest; eigenvalues are found by
    shift and invert.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        fixed: Numbers (k,) of the nodes that are held.
        density: Density, g/cm^3.
        count: Number of modes.

    References:
        Bathe, Finite Element Procedures, ch. 10.
    """
    conditions = BoundaryConditions(fixed)
    reduction = Reduction(mesh, conditions)
    state = rest_state(conditions, len(mesh.nodes))
    F = tet10.deformation_gradient(reduction.active, state.u)
    upper = reduction.matrix(state, material, F, False, [])
    mass = _mass_matrix(mesh, reduction, density * 1e-9)
    solver = make_solver()
    try:
        solver.factor(upper)
        stiffness = (upper + sp.triu(upper, 1).T).tocsr()
        inverse = spl.LinearOperator(upper.shape, matvec=solver.solve, dtype=float)
        # A fixed start vector: otherwise the modes of a symmetric body differ from run to run.
        values, vectors = spl.eigsh(
            stiffness,
            count,
            mass,
            sigma=0.0,
            OPinv=inverse,
            v0=np.random.default_rng(0).normal(size=reduction.size),
        )
    finally:
        solver.close()
    out = []
    order = np.argsort(values)
    vectors = _align_pairs(values[order], vectors[:, order], reduction, state)
    for value, q in zip(values[order], vectors.T, strict=True):
        u = reduction.displacement_increment(state, q)
        u = u / u.ravel()[np.abs(u).argmax()]
        kind, rotations = _classify(mesh, fixed, u)
        out.append(Mode(float(np.sqrt(value) / (2 * np.pi)), u, kind, rotations))
    return out


def _align_pairs(values: Float, vectors: Float, reduction: Reduction, state: State) -> Float:
    """Turn pairs of equal frequency to the body's axes; any mixture of them is a mode too."""
    out = vectors.copy()
    k = 0
    while k + 1 < len(values):
        if values[k + 1] < 1.02 * values[k]:
            u = np.stack([reduction.displacement_increment(state, out[:, k + i]) for i in range(2)])
            net = np.einsum("kna,n->ka", u, np.linalg.norm(u, axis=2).sum(0))
            main = int(np.abs(net).sum(0).argmax())
            angle = np.arctan2(net[1, main], net[0, main])
            c, s = np.cos(angle), np.sin(angle)
            a, b = out[:, k].copy(), out[:, k + 1].copy()
            out[:, k], out[:, k + 1] = c * a + s * b, -s * a + c * b
            k += 1
        k += 1
    return out


def propose_poses(mesh: QuadraticMesh, fixed: Int, modes: list[Mode]) -> list[ProposedPose]:
    """Propose a pose for each first-order mode, which the end of the body can be moved through.

    Args:
        mesh: Mesh of the body.
        fixed: Numbers (k,) of the nodes that are held.
        modes: Modes from `vibration_modes`.
    """
    axis, start, length = _body_axis(mesh, fixed)
    x = mesh.nodes
    along = (x - start) @ axis
    end = along > along.max() - max(END_FRACTION * length, 1.5 * mesh.edge_length)
    origin = start + axis * (along[end].min())
    center = (x[end].min(0) + x[end].max(0)) / 2
    mirrors = _mirror_axes(mesh)
    out: list[ProposedPose] = []
    names: dict[str, int] = {}
    free = np.full(3, np.nan)
    for mode in modes:
        if mode.order > 1:
            continue
        move, turn = _fit_rigid_motion(x[end] - center, mode.shape[end])
        rotation, translation = np.zeros(3), free
        if mode.kind == "stretch":
            translation = POSE_PULL_FRACTION * length * axis * np.sign(move @ axis or 1.0)
        elif mode.kind == "twist":
            rotation = POSE_TURN_RAD * axis * np.sign(turn @ axis or 1.0)
        else:
            across = turn - (turn @ axis) * axis
            rotation = POSE_TURN_RAD * _snap_to_mirror(
                _snap_to_axis(across / np.linalg.norm(across)), mirrors
            )
        if any(_is_same_motion(rotation, translation, other) for other in out):
            continue
        names[mode.kind] = names.get(mode.kind, 0) + 1
        name = mode.kind if names[mode.kind] == 1 else f"{mode.kind}_{names[mode.kind]}"
        out.append(ProposedPose(name, mode, origin, axis, rotation, translation))
    return out


def _is_same_motion(rotation: Float, translation: Float, other: ProposedPose) -> bool:
    """Return whether a handle's motion equals that of another pose, or its reverse.

    The end then cannot distinguish the two modes.
    """
    is_rotation, is_translation = rotation.any(), not np.isnan(translation).any()
    if is_rotation != other.rotation.any() or is_translation == np.isnan(other.translation).any():
        return False
    a, b = (rotation, other.rotation) if is_rotation else (translation, other.translation)
    return bool(abs(a @ b) > np.cos(_MAX_LEAN_RAD) * np.linalg.norm(a) * np.linalg.norm(b))


def _body_axis(mesh: QuadraticMesh, fixed: Int) -> tuple[Float, Float, float]:
    """Return the line from the held region to the farthest part: direction, start, length (mm)."""
    start = mesh.nodes[fixed].mean(0)
    distance = np.linalg.norm(mesh.nodes - start, axis=1)
    tip = mesh.nodes[distance.argmax()]  # one of two if the body is held in its middle
    is_near_tip = np.linalg.norm(mesh.nodes - tip, axis=1) < 0.5 * distance.max()
    end = mesh.nodes[is_near_tip & (distance > 0.9 * distance.max())].mean(0)
    direction = end - start
    length = float(np.linalg.norm(direction))
    return _snap_to_axis(direction / length), start, length


def _snap_to_axis(direction: Float) -> Float:
    """Return a coordinate axis in place of a unit direction within two degrees of it."""
    main = int(np.abs(direction).argmax())
    if abs(direction[main]) < np.cos(np.deg2rad(2)):
        return direction
    return np.asarray(np.sign(direction[main]) * np.eye(3)[main])


def _mirror_axes(mesh: QuadraticMesh) -> list[Float]:
    """Return the coordinate axes across which the body is mirror symmetric, judged by its mesh."""
    boundary = np.unique(boundary_faces(mesh)[:, :3])
    points = mesh.nodes[boundary]
    tree, middle = cKDTree(points), (points.min(0) + points.max(0)) / 2
    tolerance = _MIRROR_TOLERANCE_EDGES * mesh.edge_length
    return [
        axis
        for axis in np.eye(3)
        if tree.query(points - 2 * ((points - middle) @ axis)[:, None] * axis)[0].max() < tolerance
    ]


def _snap_to_mirror(direction: Float, mirrors: list[Float]) -> Float:
    """Return the normal of a mirror plane in place of a bend axis (3,) that is close to it.

    A symmetric body bends so, whatever its mesh is. Other axes stay as they are.
    """
    for axis in mirrors:
        if abs(direction @ axis) > np.cos(_MAX_LEAN_RAD):
            return np.asarray(np.sign(direction @ axis) * axis)
    return direction


def _fit_rigid_motion(arm: Float, u: Float) -> tuple[Float, Float]:
    """Fit a small rigid motion (velocity, rotation vector) to u (k, 3) at arms (k, 3)."""
    zero = np.zeros(len(arm))
    x, y, z = arm.T
    cross = np.stack(
        [
            np.stack([zero, z, -y], 1),
            np.stack([-z, zero, x], 1),
            np.stack([y, -x, zero], 1),
        ],
        axis=1,
    )  # u = v + cross w
    matrix = np.concatenate([np.broadcast_to(np.eye(3), (len(arm), 3, 3)), cross], axis=2).reshape(
        -1, 6
    )
    solved = np.linalg.lstsq(matrix, u.ravel(), rcond=None)[0]
    return solved[:3], solved[3:]


def _classify(mesh: QuadraticMesh, fixed: Int, u: Float) -> tuple[Kind, int]:
    """Classify a mode by the motion of slices across the axis; return its kind and order."""
    axis, start, _ = _body_axis(mesh, fixed)
    along = (mesh.nodes - start) @ axis
    edges = np.linspace(along.min(), along.max() + 1e-9, SLICES + 1)
    slices = []
    for a, b in pairwise(edges):
        in_slice = (along >= a) & (along < b)
        if in_slice.sum() < 4:
            continue
        center = mesh.nodes[in_slice].mean(0)
        arm = mesh.nodes[in_slice] - center
        move, turn = _fit_rigid_motion(arm, u[in_slice])
        gyration = np.sqrt((np.linalg.norm(np.cross(arm, axis), axis=1) ** 2).mean())
        slices.append([*(move - (move @ axis) * axis), turn @ axis * gyration, move @ axis])
    table = np.array(slices)
    share = [(table[:, :3] ** 2).sum(), (table[:, 3] ** 2).sum(), (table[:, 4] ** 2).sum()]
    kinds: tuple[Kind, ...] = ("bend", "twist", "stretch")
    kind = kinds[int(np.argmax(share))]
    if kind == "bend":
        _, _, vt = np.linalg.svd(table[:, :3])
        profile = table[:, :3] @ vt[0]
    else:
        profile = table[:, 3 if kind == "twist" else 4]
    strong = profile[np.abs(profile) > 0.08 * np.abs(profile).max()]
    return kind, 1 + int((np.diff(np.sign(strong)) != 0).sum())


def _mass_matrix(mesh: QuadraticMesh, reduction: Reduction, density: float) -> sp.csr_matrix:
    """Return the consistent mass matrix (t) of the free nodes, exact on straight-sided tets."""
    keep = reduction.dof[:, 0] >= 0
    block = _reference_mass()
    local = density * 4 * mesh.weight[:, None, None] * block
    rows, columns = np.repeat(mesh.cells, 10, axis=1).ravel(), np.tile(mesh.cells, 10).ravel()
    count = len(mesh.nodes)
    scalar = sp.csr_matrix((local.ravel(), (rows, columns)), shape=(count, count))
    scalar = scalar[keep][:, keep].tocoo()
    dof = reduction.dof[keep]
    parts = [
        sp.coo_matrix(
            (scalar.data, (dof[scalar.row, a], dof[scalar.col, a])),
            shape=(reduction.size, reduction.size),
        )
        for a in range(3)
    ]
    return sum(p.tocsr() for p in parts)


def _reference_mass() -> Float:
    """Return the mean of N_a N_b over a tet (10, 10) by a conical product rule of degree 5."""
    points = [roots_jacobi(3, k, 0) for k in (2, 1, 0)]
    a, b, c = np.meshgrid(*((p[0] + 1) / 2 for p in points), indexing="ij")
    w = np.einsum("i,j,k->ijk", *(p[1] for p in points))
    x, y, z = a, b * (1 - a), c * (1 - b) * (1 - a)
    bary = np.stack([1 - x - y - z, x, y, z], axis=-1).reshape(-1, 4)
    n = shape_functions(bary)
    w = w.ravel() / w.sum()
    return np.asarray(np.einsum("q,qa,qb->ab", w, n, n))
