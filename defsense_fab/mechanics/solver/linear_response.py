"""Vibration modes of a held body, and the natural poses that they propose.

The paper (DefSense, sec. "Future work") asks for deformations that a user need not invent. The
lowest modes of a body with a region fixed are those that cost the least energy: what a hand will
do to it. A mode is read as bend, twist or stretch of the body along the line from the held region
to the far end, and becomes a pose that rotations or pulls that end.
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

# What small forces do to a body at rest, by its tangent there.


def small_load_displacement(
    mesh: QuadraticMesh, material: Material, fixed: Int, forces: Float
) -> Float:
    """Displacements (n, 3) mm under nodal `forces` (n, 3) N with the nodes `fixed` (k,) held, to
    first order: they are too large where the body stiffens as it is bent or drawn."""
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
    """Nodal forces (n, 3) N of a line along a `path` (p, 3) mm that slides and is under `tension`
    N: it pulls at its ends, and presses where it bends."""
    piece = np.diff(path, axis=0)
    pull = tension * piece / np.linalg.norm(piece, axis=1)[:, None]
    at = locator.find(path)
    spread = (
        shape_functions(at.bary)[:, :, None] * np.diff(pull, axis=0, prepend=0, append=0)[:, None]
    )
    out = np.zeros_like(locator.mesh.nodes)
    np.add.at(out, locator.mesh.cells[at.cell], spread)
    return out


#: The part of the body's length that a proposed pose takes hold of.
END_FRACTION = 0.08
SLICES = 12
POSE_TURN_RAD = np.deg2rad(30)
POSE_PULL_FRACTION = 0.15  # of the length
#: A body is its own mirror image where that lies within so many edges of it; bends of such a one
#: lean by less than this, rad, if only for its mesh.
_MIRROR_TOLERANCE_EDGES, _MAX_LEAN_RAD = 0.75, np.deg2rad(10)

Kind = Literal["bend", "twist", "stretch"]


@dataclass(frozen=True)
class Mode:
    """`frequency` Hz; `shape` (n, 3), largest displacement 1; what it is and its `order`: how often
    the movement changes its sign along the body, plus one."""

    frequency: float
    shape: Float
    kind: Kind
    order: int


@dataclass(frozen=True)
class ProposedPose:
    """Turn the body's end by `rotation` (3,) rad, or move it by `translation` (3,) mm (NaN: free).

    The end is what lies beyond `origin` (3,) mm in the direction of the unit `axis` (3,).
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
    """The lowest `count` modes with the nodes `fixed` (k,) held; density in g/cm^3.

    Consistent mass, tangent at rest (Bathe, Finite Element Procedures, ch. 10); eigenvalues by
    shift and invert.
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
        # A fixed start, or the modes of a symmetric body turn from run to run.
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
    """Pairs of equal frequency turned to the body's own axes: any mixture is a mode as well."""
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


def propose_poses(mesh: QuadraticMesh, fixed: Int, found: list[Mode]) -> list[ProposedPose]:
    """A pose for each mode that an end can be led through: first-order ones."""
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
    for mode in found:
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
    """Whether a handle moved so is moved as in another pose, or backwards: what differs between
    their modes is not led by the end."""
    turned, pulled = rotation.any(), not np.isnan(translation).any()
    if turned != other.rotation.any() or pulled == np.isnan(other.translation).any():
        return False
    a, b = (rotation, other.rotation) if turned else (translation, other.translation)
    return bool(abs(a @ b) > np.cos(_MAX_LEAN_RAD) * np.linalg.norm(a) * np.linalg.norm(b))


def _body_axis(mesh: QuadraticMesh, fixed: Int) -> tuple[Float, Float, float]:
    """From the held region to the farthest part: unit direction, start and length (mm)."""
    start = mesh.nodes[fixed].mean(0)
    away = np.linalg.norm(mesh.nodes - start, axis=1)
    tip = mesh.nodes[away.argmax()]  # of the ends of a body held in its middle, one
    near = np.linalg.norm(mesh.nodes - tip, axis=1) < 0.5 * away.max()
    far = mesh.nodes[near & (away > 0.9 * away.max())].mean(0)
    direction = far - start
    length = float(np.linalg.norm(direction))
    return _snap_to_axis(direction / length), start, length


def _snap_to_axis(direction: Float) -> Float:
    """A unit direction within two degrees of a coordinate axis as that axis."""
    main = int(np.abs(direction).argmax())
    if abs(direction[main]) < np.cos(np.deg2rad(2)):
        return direction
    return np.asarray(np.sign(direction[main]) * np.eye(3)[main])


def _mirror_axes(mesh: QuadraticMesh) -> list[Float]:
    """Coordinate axes across which the body is its own mirror image, as far as its mesh shows."""
    boundary = np.unique(boundary_faces(mesh)[:, :3])
    points = mesh.nodes[boundary]
    tree, middle = cKDTree(points), (points.min(0) + points.max(0)) / 2
    near = _MIRROR_TOLERANCE_EDGES * mesh.edge_length
    return [
        axis
        for axis in np.eye(3)
        if tree.query(points - 2 * ((points - middle) @ axis)[:, None] * axis)[0].max() < near
    ]


def _snap_to_mirror(direction: Float, mirrors: list[Float]) -> Float:
    """The axis of a bend (3,) as a symmetric body has it: across its mirror planes, however its
    mesh lies. What lies between two stays."""
    for axis in mirrors:
        if abs(direction @ axis) > np.cos(_MAX_LEAN_RAD):
            return np.asarray(np.sign(direction @ axis) * axis)
    return direction


def _fit_rigid_motion(arm: Float, u: Float) -> tuple[Float, Float]:
    """The small rigid motion (velocity, rotation vector) nearest to u (k, 3) at arms (k, 3)."""
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
    """What a mode does to slices across the axis, by their share of the movement."""
    axis, start, _ = _body_axis(mesh, fixed)
    along = (mesh.nodes - start) @ axis
    edges = np.linspace(along.min(), along.max() + 1e-9, SLICES + 1)
    slices = []
    for a, b in pairwise(edges):
        own = (along >= a) & (along < b)
        if own.sum() < 4:
            continue
        center = mesh.nodes[own].mean(0)
        arm = mesh.nodes[own] - center
        move, turn = _fit_rigid_motion(arm, u[own])
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
    """Consistent mass (t) of the unknowns of free nodes; exact on straight-sided tets."""
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
    """Mean of N_a N_b over a tet (10, 10): a conical product rule of degree 5."""
    points = [roots_jacobi(3, k, 0) for k in (2, 1, 0)]
    a, b, c = np.meshgrid(*((p[0] + 1) / 2 for p in points), indexing="ij")
    w = np.einsum("i,j,k->ijk", *(p[1] for p in points))
    x, y, z = a, b * (1 - a), c * (1 - b) * (1 - a)
    bary = np.stack([1 - x - y - z, x, y, z], axis=-1).reshape(-1, 4)
    n = shape_functions(bary)
    w = w.ravel() / w.sum()
    return np.asarray(np.einsum("q,qa,qb->ab", w, n, n))
