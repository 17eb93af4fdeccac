"""Eliminate boundary conditions: map few unknowns to the positions of all nodes.

Nothing is enforced by penalty. A free node has three unknowns, a sliding node those along its
plane, and a rigid handle its free translations and rotations; everything else is prescribed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Float, Int
from ...core.rotations import rotation_matrices
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..elements.threads import run_in_chunks
from .assembly import assemble_tangents, find_places
from .boundary_conditions import BoundaryConditions, State


class Reduction:
    """The unknowns of one structure of boundary conditions on a mesh.

    Args:
        mesh: The mesh.
        conditions: Conditions of that structure.

    Attributes:
        mesh: The mesh.
        active: The mesh without the tets that lie entirely in one rigid piece.
        size: Number of unknowns.
        dof: (n, 6) numbers of the unknowns that move each node, -1 for none: three translations,
            then rotations of its handle about the current center.
    """

    def __init__(self, mesh: QuadraticMesh, conditions: BoundaryConditions) -> None:
        self.mesh = mesh
        count = len(mesh.nodes)
        within = np.full((count, 6), -1)  # number of the unknown within its group
        self._basis = np.zeros((count, 3, 6))
        self._basis[:, :, :3] = np.eye(3)
        self._special = np.zeros(count, bool)
        free = np.ones(count, bool)
        free[conditions.fixed] = False
        sizes: list[int] = []
        group = np.full(count, -1)
        for h in conditions.handles:
            free[h.nodes] = False
            moves = np.isnan(h.translation)
            local = np.full(6, -1)
            local[:3][moves] = np.arange(moves.sum())
            local[3 : 3 + len(h.free_axes)] = moves.sum() + np.arange(len(h.free_axes))
            within[h.nodes] = local
            if (local >= 0).any():
                group[h.nodes] = len(sizes)
                sizes.append(int((local >= 0).sum()))
            self._special[h.nodes] = True
        for nodes, basis in _sliding(conditions, free):
            free[nodes] = False
            self._special[nodes] = True
            self._basis[nodes] = 0.0
            width = basis.shape[1]
            if width:
                self._basis[nodes, :, :width] = basis
                within[nodes, :width] = np.arange(width)
                group[nodes] = len(sizes) + np.arange(len(nodes))
                sizes += [width] * len(nodes)
        nodes = np.flatnonzero(free)
        group[nodes] = len(sizes) + np.arange(len(nodes))
        within[nodes, :3] = [0, 1, 2]
        size = np.concatenate([np.array(sizes, int), np.full(len(nodes), 3)])
        start = np.concatenate([[0], np.cumsum(size)])
        self.size = int(start[-1])
        self.dof: Int = np.where(within >= 0, start[group][:, None] + within, -1)
        self._group = group
        self.active = mesh.subset(_deforming(mesh, conditions))
        self._places, self._indices = find_places(
            self.active.cells, self._special, within, self._group, start, size
        )
        self._indptr = self._places.indptr
        self._sorted_keys: Int | None = None
        self._entries: dict[tuple[object, ...], tuple[Int, Int]] = {}

    @property
    def is_free(self) -> Float:
        """(n,) bool, whether a node has three unknowns that move no other node."""
        return np.asarray((self._group >= 0) & ~self._special)

    def place(self, state: State, goal: BoundaryConditions) -> State:
        """Return the state with its prescribed parts moved to `goal`; the unknowns stay."""
        rotations, translations, u = (
            state.rotations.copy(),
            state.translations.copy(),
            state.u.copy(),
        )
        for i, h in enumerate(goal.handles):
            if len(h.free_axes) == 0:
                rotations[i] = rotation_matrices(h.rotation)
            is_prescribed = ~np.isnan(h.translation)
            translations[i][is_prescribed] = h.translation[is_prescribed]
            self._carry(u, h.nodes, h.center, rotations[i], translations[i])
        return State(u, rotations, translations, goal)

    def move(self, state: State, q: Float) -> State:
        """Return the state moved by unknowns q (size,); handles turn by the exponential map."""
        u = state.u + self.displacement_increment(state, q)
        rotations, translations = state.rotations.copy(), state.translations.copy()
        for i, h in enumerate(state.conditions.handles):
            dof = self.dof[h.nodes[0]]
            for a in np.flatnonzero(dof[:3] >= 0):
                translations[i, a] += q[dof[a]]
            axes = len(h.free_axes)
            if axes:
                turn = q[dof[3 : 3 + axes]] @ h.free_axes
                rotations[i] = rotation_matrices(turn) @ rotations[i]
            self._carry(u, h.nodes, h.center, rotations[i], translations[i])
        return replace(state, u=u, rotations=rotations, translations=translations)

    def apply_guess(self, placed: State, u: Float) -> State:
        """Move the free nodes of a placed state to guessed displacements.

        Args:
            placed: State with its prescribed parts in place.
            u: Guess (n, 3) mm. Handles follow it where their translation is free; sliding nodes
                stay.
        """
        out, translations = np.where(self.is_free[:, None], u, placed.u), placed.translations.copy()
        for i, h in enumerate(placed.conditions.handles):
            free = np.isnan(h.translation)
            translations[i][free] += (u - placed.u)[h.nodes].mean(0)[free]
            self._carry(out, h.nodes, h.center, placed.rotations[i], translations[i])
        return replace(placed, u=out, translations=translations)

    def _carry(self, u: Float, nodes: Int, center: Float, turn: Float, shift: Float) -> None:
        arm = self.mesh.nodes[nodes] - center
        u[nodes] = arm @ (turn - np.eye(3)).T + shift

    def basis(self, state: State) -> Float:
        """Return (n, 3, 6), the derivative of each node's position by its six unknowns."""
        for h, turn in zip(state.conditions.handles, state.rotations, strict=True):
            if len(h.free_axes):
                arm = (self.mesh.nodes[h.nodes] - h.center) @ turn.T
                for k, axis in enumerate(h.free_axes):
                    self._basis[h.nodes, :, 3 + k] = np.cross(axis, arm)
        return self._basis

    def displacement_increment(self, state: State, q: Float) -> Float:
        """Return the displacements (n, 3) of unknowns q (size,) to first order."""
        values = (
            np.where(self.dof >= 0, q[self.dof], 0.0) if self.size else np.zeros(self.dof.shape)
        )
        out: Float = np.einsum("nad,nd->na", self.basis(state), values)
        return out

    def gradient(self, state: State, force: Float) -> Float:
        """Return the generalized forces (size,) of nodal forces (n, 3)."""
        by = np.einsum("nad,na->nd", self.basis(state), force)
        keep = self.dof >= 0
        return np.asarray(np.bincount(self.dof[keep], by[keep], minlength=self.size), float)

    def matrix(
        self,
        state: State,
        material: Material,
        F: Float,
        share: float,
        extra: list[tuple[Int, Float]],
        force: Float | None = None,
        threads: int = 1,
        lag: Float | None = None,
    ) -> Any:
        """Assemble the tangent by the unknowns.

        Args:
            state: The current state.
            material: The material.
            F: Deformation gradients (m, 4, 3, 3) of the `active` mesh.
            share: Share of the negative part removed, see `energy_density.tangent`.
            extra: Blocks of loads: node numbers (..., k) and (..., 3 k, 3 k) N/mm.
            force: Nodal forces (n, 3) N. With them the second derivative of the handles' rotations
                is included, as the true Hessian requires.
            threads: Largest number of threads.
            lag: Pressure difference (m, 4) MPa, see `energy_density.tangent`; zero by default.

        Returns:
            Upper triangle (CSR) of the (size, size) tangent.
        """
        mesh = self.active
        chunks = max(1, min(threads, len(mesh.cells) // 200))
        data = np.zeros((chunks, len(self._indices)))
        step = -(-len(mesh.cells) // chunks)
        basis = self.basis(state)
        if lag is None:
            lag = np.zeros(F.shape[:2])

        def assemble(a: int, b: int) -> None:
            for i in range(a, b):
                tets = slice(i * step, (i + 1) * step)
                elements = (F[tets], mesh.gradient[tets], mesh.weight[tets], lag[tets])
                assemble_tangents(
                    elements, material.law, share, self._places, i * step, basis, data[i]
                )

        run_in_chunks(assemble, chunks, threads, smallest=1)
        values = data[0] if chunks == 1 else data.sum(axis=0)
        for nodes, block in extra:
            self._add_block(values, basis, nodes, block)
        if force is not None:
            self._add_rotations(values, state, force)
        return sp.csr_matrix((values, self._indices, self._indptr), shape=(self.size, self.size))

    def _add_block(self, values: Float, basis: Float, nodes: Int, block: Float) -> None:
        nodes = np.atleast_2d(nodes)
        count, k = nodes.shape
        part = basis[nodes]
        half = np.einsum("cnad,cnamb->cndmb", part, block.reshape(count, k, 3, k, 3), optimize=True)
        width = np.einsum("cndmb,cmbe->cndme", half, part, optimize=True)
        chosen, at = self._find_entries(nodes)
        np.add.at(values, at, width.ravel()[chosen])

    def _find_entries(self, nodes: Int) -> tuple[Int, Int]:
        """Return which entries of the blocks of nodes (c, k) are in the matrix, and where."""
        key = (nodes.shape, nodes.tobytes())
        if key not in self._entries:
            dof = self.dof[nodes].reshape(len(nodes), -1)
            rows, columns = np.broadcast_arrays(dof[:, :, None], dof[:, None])
            chosen = np.flatnonzero((rows >= 0) & (columns >= rows))
            entries = rows.ravel()[chosen] * self.size + columns.ravel()[chosen]
            self._entries[key] = chosen, np.searchsorted(self._keys(), entries)
        return self._entries[key]

    def _keys(self) -> Int:
        """Return row times size plus column of each stored entry, increasing."""
        if self._sorted_keys is None:
            rows = np.repeat(np.arange(self.size), np.diff(self._indptr))
            self._sorted_keys = rows * self.size + self._indices
        return self._sorted_keys

    def reduced(self, state: State, full: Any) -> Any:
        """Return T^T A T for a sparse A (3 n, 3 n), T being the nodes' derivative by unknowns."""
        keep = self.dof >= 0
        node, column = np.nonzero(keep)
        rows = (3 * node[:, None] + np.arange(3)).ravel()
        values = self.basis(state)[node, :, column].ravel()
        transfer = sp.csr_matrix(
            (values, (rows, np.repeat(self.dof[node, column], 3))),
            shape=(3 * len(self.dof), self.size),
        )
        return transfer.T @ full @ transfer

    def _add_rotations(self, values: Float, state: State, force: Float) -> None:
        for h, turn in zip(state.conditions.handles, state.rotations, strict=True):
            axes = h.free_axes
            if not len(axes):
                continue
            arm = (self.mesh.nodes[h.nodes] - h.center) @ turn.T
            f = force[h.nodes]
            a, b = f @ axes.T, arm @ axes.T
            both = a.T @ b
            second = 0.5 * (both + both.T) - (axes @ axes.T) * (f * arm).sum()
            dof = self.dof[h.nodes[0], 3 : 3 + len(axes)]
            for i in range(len(axes)):
                for j in range(i, len(axes)):
                    values[self._indptr[dof[i]] + j - i] += second[i, j]


def _sliding(conditions: BoundaryConditions, free: Float) -> list[tuple[Int, Float]]:
    """Group nodes by their sliding planes, with a basis (3, d) of the directions left free."""
    normals: dict[int, list[Float]] = {}
    for slide in conditions.slides:
        for n in slide.nodes[free[slide.nodes]]:
            normals.setdefault(int(n), []).append(slide.normal)
    kinds: dict[bytes, tuple[list[int], Float]] = {}
    for n, planes in normals.items():
        stacked = np.array(planes)
        kinds.setdefault(stacked.tobytes(), ([], stacked))[0].append(n)
    out = []
    for nodes, stacked in kinds.values():
        _, s, vt = np.linalg.svd(stacked)
        rank = int((s > 1e-6).sum())
        out.append((np.array(nodes), vt[rank:].T))
    return out


def _deforming(mesh: QuadraticMesh, conditions: BoundaryConditions) -> Float:
    """Return (m,) bool, whether a tet is not entirely in one rigid piece."""
    owner = np.full(len(mesh.nodes), -1)
    owner[conditions.fixed] = 0
    for i, h in enumerate(conditions.handles):
        owner[h.nodes] = i + 1
    owners = owner[mesh.cells]
    return np.asarray((owners[:, 0] < 0) | (owners != owners[:, :1]).any(axis=1))
