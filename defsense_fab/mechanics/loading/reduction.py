"""Eliminate boundary conditions: map few unknowns to the positions of all nodes.

Nothing is enforced by penalty. A free node has three unknowns, a sliding node those along its
plane, and a rigid handle its free translations and rotations; everything else is prescribed. The
unknowns of one node or handle are consecutive and form a group, so that the pattern of the matrix
is found quickly from the pattern of the groups.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...core.arrays import Float, Int
from ...core.machine.compiled import compiled
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh, element_tangent
from ..elements.threads import run_in_chunks
from .boundary_conditions import BoundaryConditions, State, rotation_matrix


class Reduction:
    """The unknowns of one structure of boundary conditions on a mesh.

    Args:
        mesh: The mesh.
        conditions: Conditions of that structure.

    Attributes:
        mesh: The mesh.
        size: Number of unknowns.
        dof: (n, 6) numbers of the unknowns that move each node, -1 for none: three translations,
            then rotations of its handle about the current center.
    """

    def __init__(self, mesh: QuadraticMesh, conditions: BoundaryConditions) -> None:
        self.mesh = mesh
        count = len(mesh.nodes)
        self._local = np.full((count, 6), -1)  # number of the unknown within its group
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
            self._local[h.nodes] = local
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
                self._local[nodes, :width] = np.arange(width)
                group[nodes] = len(sizes) + np.arange(len(nodes))
                sizes += [width] * len(nodes)
        nodes = np.flatnonzero(free)
        group[nodes] = len(sizes) + np.arange(len(nodes))
        self._local[nodes, :3] = [0, 1, 2]
        size = np.concatenate([np.array(sizes, int), np.full(len(nodes), 3)])
        self._start = np.concatenate([[0], np.cumsum(size)])
        self.size = int(self._start[-1])
        self.dof: Int = np.where(self._local >= 0, self._start[group][:, None] + self._local, -1)
        self._group = group
        self._active = mesh.subset(_deforming(mesh, conditions))
        self._pattern(size)

    @property
    def active(self) -> QuadraticMesh:
        """The mesh without the tets that lie entirely in one rigid piece."""
        return self._active

    @property
    def is_free(self) -> Float:
        """(n,) bool, whether a node has three unknowns that move no other node."""
        return np.asarray((self._group >= 0) & ~self._special)

    def _pattern(self, size: Int) -> None:
        """Find the sparsity pattern of the matrix from the sizes of the groups."""
        groups = self._group[self._active.cells]
        rows, columns = np.repeat(groups, 10, axis=1).ravel(), np.tile(groups, (1, 10)).ravel()
        keep = (rows >= 0) & (columns >= rows)
        count = len(size)
        graph = sp.csr_matrix(
            (np.ones(keep.sum(), np.int8), (rows[keep], columns[keep])), shape=(count, count)
        )
        graph.sum_duplicates()
        graph.data[:] = 1
        # A group that no active tet touches would leave an empty row.
        graph = (graph + sp.eye(count, dtype=np.int8, format="csr")).tocsr()
        graph.sort_indices()
        self._indptr, self._indices = _expand_pattern(
            graph.indptr, graph.indices, self._start, size
        )
        self._offset = _pair_offsets(groups, graph.indptr, graph.indices, size)
        self._sizes = size
        self._sorted_keys: Int | None = None

    def place(self, state: State, goal: BoundaryConditions) -> State:
        """Return the state with its prescribed parts moved to `goal`; the unknowns stay."""
        rotations, translations, u = (
            state.rotations.copy(),
            state.translations.copy(),
            state.u.copy(),
        )
        for i, h in enumerate(goal.handles):
            if len(h.free_axes) == 0:
                rotations[i] = rotation_matrix(h.rotation)
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
                rotations[i] = rotation_matrix(turn) @ rotations[i]
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
            extra: Blocks of loads: node numbers (k,) and (3 k, 3 k) N/mm.
            force: Nodal forces (n, 3) N. With them the second derivative of the handles' rotations
                is included, as the true Hessian requires.
            threads: Largest number of threads.
            lag: Pressure difference (m, 4) MPa, see `energy_density.tangent`; zero by default.

        Returns:
            Upper triangle (CSR) of the (size, size) tangent.
        """
        mesh = self._active
        chunks = max(1, min(threads, len(mesh.cells) // 200))
        data = np.zeros((chunks, len(self._indices)))
        step = -(-len(mesh.cells) // chunks)
        basis = self.basis(state)
        if lag is None:
            lag = np.zeros(F.shape[:2])

        def assemble(a: int, b: int) -> None:
            for i in range(a, b):
                _assemble(
                    F, mesh.gradient, mesh.weight, material.kind, material.parameters, lag,
                    float(share), mesh.cells, self._special, basis, self._local, self._group,
                    self._start, self._sizes, self._offset, self._indptr,
                    i * step, min((i + 1) * step, len(mesh.cells)), data[i],
                )  # fmt: skip

        run_in_chunks(assemble, chunks, threads, smallest=1)
        values = data[0] if chunks == 1 else data.sum(axis=0)
        for nodes, block in extra:
            self._add_block(values, basis, nodes, block)
        if force is not None:
            self._add_rotations(values, state, force)
        return sp.csr_matrix((values, self._indices, self._indptr), shape=(self.size, self.size))

    def _add_block(self, values: Float, basis: Float, nodes: Int, block: Float) -> None:
        k = len(nodes)
        width = np.einsum(
            "nad,namb,mbe->ndme", basis[nodes], block.reshape(k, 3, k, 3), basis[nodes]
        ).reshape(6 * k, 6 * k)
        dof = self.dof[nodes].ravel()
        keep = (dof[:, None] >= 0) & (dof[None] >= dof[:, None])
        rows, columns = np.nonzero(keep)
        entries = dof[rows] * self.size + dof[columns]
        np.add.at(values, np.searchsorted(self._keys(), entries), width[rows, columns])

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


@compiled()
def _expand_pattern(indptr, indices, start, size):  # type: ignore[no-untyped-def]
    """Expand the pattern of groups (upper, diagonal first in a row) to that of the unknowns."""
    total = start[-1]
    out = np.zeros(total + 1, np.int32)
    for g in range(len(size)):
        width = 0
        for k in range(indptr[g], indptr[g + 1]):
            if indices[k] != g:
                width += size[indices[k]]
        for i in range(size[g]):
            out[start[g] + i + 1] = width + size[g] - i
    out = np.cumsum(out).astype(np.int32)
    columns = np.empty(out[-1], np.int32)
    for g in range(len(size)):
        for i in range(size[g]):
            at = out[start[g] + i]
            for c in range(start[g] + i, start[g] + size[g]):
                columns[at] = c
                at += 1
            for k in range(indptr[g], indptr[g + 1]):
                h = indices[k]
                if h != g:
                    for c in range(start[h], start[h] + size[h]):
                        columns[at] = c
                        at += 1
    return out, columns


@compiled()
def _pair_offsets(groups, indptr, indices, size):  # type: ignore[no-untyped-def]
    """Return offsets (m, 10, 10) of the second node's group in the rows of the first node's."""
    before = np.zeros(len(indices), np.int32)
    for g in range(len(size)):
        at = 0
        for k in range(indptr[g], indptr[g + 1]):
            before[k] = at
            if indices[k] != g:
                at += size[indices[k]]
    out = np.zeros((len(groups), 10, 10), np.int32)
    for e in range(len(groups)):
        for a in range(10):
            g = groups[e, a]
            if g < 0:
                continue
            for b in range(10):
                if groups[e, b] > g:
                    low, high = indptr[g], indptr[g + 1]
                    while high - low > 1:
                        middle = (low + high) // 2
                        if indices[middle] <= groups[e, b]:
                            low = middle
                        else:
                            high = middle
                    out[e, a, b] = before[low]
    return out


@compiled()
def _assemble(  # type: ignore[no-untyped-def]
    F, gradient, weight, kind, p, lag, share,
    cells, special, basis, local, group, start, size, offset, indptr, first, last, data,
):  # fmt: skip
    K, H, T = np.empty((30, 30)), np.empty((9, 9)), np.empty((9, 30))
    block = np.empty((6, 6))
    half = np.empty((3, 6))
    for e in range(first, last):
        element_tangent(F[e], gradient[e], weight[e], kind, p, lag[e], share, K, H, T)
        for a in range(10):
            na = cells[e, a]
            g = group[na]
            if g < 0:
                continue
            for b in range(10):
                nb = cells[e, b]
                h = group[nb]
                if h < g:
                    continue
                shift = size[g] + offset[e, a, b]
                if not special[na] and not special[nb]:
                    for i in range(3):
                        row = indptr[start[g] + i]
                        if g == h:
                            for j in range(i, 3):
                                data[row + j - i] += K[3 * a + i, 3 * b + j]
                        else:
                            row += shift - i
                            for j in range(3):
                                data[row + j] += K[3 * a + i, 3 * b + j]
                    continue
                for i in range(3):
                    for d in range(6):
                        half[i, d] = 0.0
                        if local[nb, d] >= 0:
                            for j in range(3):
                                half[i, d] += K[3 * a + i, 3 * b + j] * basis[nb, j, d]
                for c in range(6):
                    if local[na, c] < 0:
                        continue
                    for d in range(6):
                        block[c, d] = 0.0
                        for i in range(3):
                            block[c, d] += basis[na, i, c] * half[i, d]
                for c in range(6):
                    i = local[na, c]
                    if i < 0:
                        continue
                    row = indptr[start[g] + i]
                    for d in range(6):
                        j = local[nb, d]
                        if j < 0:
                            continue
                        if g != h:
                            data[row + shift - i + j] += block[c, d]
                        elif j >= i:
                            data[row + j - i] += block[c, d]
