"""Embed stiff lines, such as printed traces, in the finite elements of a softer body.

A fiber resists its elongation: its energy is a sum over points of the line of EA w(s) ds, with the
stretch s = |F t| of the unit tangent t by the deformation gradient F of the surrounding tet. A
point involves the nodes of one tet, so the matrix keeps its sparsity.

A single fiber has no bending stiffness and, on a fine mesh, cuts into the body like a wire.
`Fibers.of_trace` therefore distributes the stiffness over filaments at the Gauss points of the
cross-section. Two by two filaments have its exact second moments of area.

A trace also resists that its cross-section shears along it: the energy of the shears
g_i = (F t) . (F n_i) is GA_i g_i^2 / 2, for the axes n_i of the cross-section. A stiff trace shears
less than the body around it, which a mesh coarser than the trace does not resolve. GA_i is
therefore the stiffness of an elliptic inclusion, which is bounded, not G_trace A.

The model leaves out that a sharp corner of a stiff trace resists bending and shear fully. Meshes
coarser than the trace do not resolve its ends (`benchmarks/printed_traces.py`).

References:
    Elwi & Hrudey 1989, "Finite element model for curved embedded reinforcement".
    Eshelby 1957, "The determination of the elastic field of an ellipsoidal inclusion".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.errors import SolveError
from ..elements.point_location import PointLocator
from ..elements.tet10 import QuadraticMesh, shape_derivatives

#: Parts of a line that are shorter than this fraction of the mesh's mean edge length have one
#: point; longer parts have `POINTS`, between which the stretch changes almost linearly.
SHORT_EDGES, POINTS = 1 / 6, 2
#: Smallest barycentric coordinate at which a tet's displacements are continued outside the mesh.
MIN_DEPTH = -0.5
#: Stretch below which the energy is continued quadratically, so that forces stay finite.
MIN_STRETCH = 0.3
_OBLIQUE = np.array([0.3, 0.2, 0.1])
_STEEP_SINE = 1e-3  # between a path and the normal of its layers
_MIN_LENGTH_MM = 1e-6  # of a part of a line; shorter parts are left out
_LAST = np.array([0.0, 0, 0, 1])  # barycentric coordinates of the last corner
_MIN_SHARE = 1e-6  # of a part that must be in a tet
_MAX_SPLITS = 60  # rounds, each of which takes one tet from each part


@dataclass(frozen=True)
class Fibers:
    """Stiff lines in a body.

    Attributes:
        lines: Polylines (p, 3) mm in the rest frame.
        stiffness: (k,) N, axial stiffness EA of each line: (E_trace - E_body) A, since the body's
            own material fills the volume of the trace too. It must refer to the modulus that the
            body is solved with: where `Device.simulated_material` replaces Young's modulus of the
            body by 1 MPa, multiply by 1 MPa / E_body, as `of_trace` does.
        is_linear: Whether the force is EA (s - 1). By default it is EA (s - 1/s^2) / 3, that of an
            incompressible neo-Hookean bar, so that body and fiber together behave like a
            neo-Hookean trace of the larger modulus.
        shear: (k, 2) N, shear stiffness GA of each line across and along its normal, scaled like
            `stiffness`; None for no stiffness.
        normals: (k, 3) unit normals of the lines' planes, required with `shear`.
    """

    lines: tuple[Float, ...]
    stiffness: Float
    is_linear: bool = False
    shear: Float | None = None
    normals: Float | None = None

    @classmethod
    def of_trace(
        cls,
        path: Float,
        size: tuple[float, float],
        normal: Float,
        moduli: tuple[float, float],
        simulated: float | None = None,
        counts: tuple[int, int] = (2, 2),
        poisson: float | None = 0.45,
    ) -> Fibers:
        """Create the filaments of one trace of rectangular cross-section.

        Args:
            path: Center line (p, 3) mm in the rest frame.
            size: Width (mm, across the path and the normal) and height (mm, along the normal).
            normal: (3,) normal of the plane in which the trace is printed.
            moduli: Young's moduli of the trace and of the body, MPa.
            simulated: Young's modulus that the body is solved with, MPa; by default its modulus.
            counts: Number of filaments over the width and the height; (1, 1) is a single fiber.
            poisson: Poisson's ratio of both materials, None for traces without shear stiffness.
        """
        trace, body = moduli
        area = size[0] * size[1] * (1.0 if simulated is None else simulated / body)
        axial = (trace - body) * area
        (a, wa), (b, wb) = (np.polynomial.legendre.leggauss(count) for count in counts)
        across = _miters(path, normal)
        up = normal / np.linalg.norm(normal)
        lines = tuple(
            path + 0.5 * size[0] * x * across + 0.5 * size[1] * y * up for x in a for y in b
        )
        share = np.outer(wa, wb).ravel() / 4
        if poisson is None:
            return cls(lines, axial * share)
        # Depolarization factors of an ellipse, for shears along its width and its height.
        factor = np.array([size[1], size[0]]) / (size[0] + size[1])
        shear = axial / (2 * (1 + poisson)) / (1 + factor * (trace / body - 1))
        return cls(
            lines, axial * share, False, np.outer(share, shear), np.tile(up, (len(lines), 1))
        )

    def __add__(self, other: Fibers) -> Fibers:
        """Return the fibers of both, which must have the same law."""
        if (self.is_linear, self.shear is None) != (other.is_linear, other.shear is None):
            raise ValueError("fibers of two laws cannot be joined")

        def join(a: Float | None, b: Float | None) -> Float | None:
            return None if a is None or b is None else np.concatenate([a, b])

        return Fibers(
            self.lines + other.lines,
            np.concatenate([self.stiffness, other.stiffness]),
            self.is_linear,
            join(self.shear, other.shear),
            join(self.normals, other.normals),
        )

    @property
    def structure(self) -> tuple[object, ...]:
        """Key that is equal for equal fibers."""
        lines = tuple(line.tobytes() for line in self.lines)
        shear = None if self.shear is None else self.shear.tobytes()
        normals = None if self.normals is None else self.normals.tobytes()
        return (lines, self.stiffness.tobytes(), self.is_linear, shear, normals)


def trace_fibers(device: Device, paths: Sequence[Float], simulated: float) -> Fibers:
    """Return the printed traces of a device as fibers.

    Args:
        device: A device with printed traces.
        paths: Their center lines (p, 3), mm, rest frame.
        simulated: Young's modulus that the body is solved with, MPa.
    """
    spec, material = device.cord.trace, device.material
    assert spec is not None
    moduli = (max(spec.young_modulus, material.young_modulus), material.young_modulus)
    size, up = (spec.width, spec.height), np.array(device.fabrication.up)
    each = [
        Fibers.of_trace(path, size, up, moduli, simulated, poisson=material.poisson_ratio)
        for path in paths
    ]
    return reduce(add, each)


def _across(normals: Float, directions: Float) -> Float:
    """Return unit vectors (p, 3) across directions and normals (p, 3).

    Along a normal any direction is across; all such directions get the same.
    """
    side = np.cross(normals, directions)
    size = np.linalg.norm(directions, axis=1) * np.linalg.norm(normals, axis=1)
    is_steep = np.linalg.norm(side, axis=1) < _STEEP_SINE * size
    oblique = np.roll(normals[is_steep], 1, axis=1) + _OBLIQUE
    side[is_steep] = np.cross(directions[is_steep], oblique)
    return np.asarray(side / np.linalg.norm(side, axis=1)[:, None])


def _miters(path: Float, normal: Float) -> Float:
    """Return vectors (p, 3) that offset a path sideways by 1, so that its pieces stay parallel."""
    step = np.diff(path, axis=0)
    side = _across(np.broadcast_to(normal, step.shape), step)
    before, after = np.concatenate([side[:1], side]), np.concatenate([side, side[-1:]])
    total = before + after
    return np.asarray(2 * total / np.maximum((total**2).sum(axis=1), 1.0)[:, None])


class EmbeddedFibers:
    """Fibers at the points of a mesh at which their energy is evaluated.

    Functions take the vectors (p, 3, d) of the points: F t and, where there is shear stiffness,
    also F n_1 and F n_2. Forces can be linearized about vectors of no displacement field.

    Args:
        mesh: The mesh.
        fibers: The fibers, at least one.
        points: Number of Gauss points of each part of a line in one tet; by default `POINTS`, or
            one in short parts.

    Attributes:
        cell: (p,) tet of each point.
        bary: (p, 4) barycentric coordinates in it.
        nodes: (c, 10) nodes of the tets that contain points.

    Raises:
        SolveError: If a line leaves the mesh or a stiffness is negative.
    """

    def __init__(self, mesh: QuadraticMesh, fibers: Fibers, points: int | None = None) -> None:
        if (fibers.stiffness < 0).any():
            raise SolveError(
                f"a fiber has the stiffness {fibers.stiffness.min():.3g} N",
                code="fiber-stiffness-negative",
                where="fibers",
                action="Use traces that are stiffer than the body",
            )
        locator = PointLocator(mesh)
        parts = [_split_at_faces(locator, line) for line in fibers.lines]
        cell, start, end = (np.concatenate(x) for x in zip(*parts, strict=True))
        stiffness = np.repeat(fibers.stiffness, [len(part[0]) for part in parts])
        order = np.argsort(cell, kind="stable")
        cell, start, end, stiffness = cell[order], start[order], end[order], stiffness[order]
        length = np.linalg.norm(end - start, axis=1)
        is_long = length > SHORT_EDGES * mesh.edge_length
        number = np.where(is_long, POINTS, 1) if points is None else np.full(len(cell), points)
        of = np.repeat(np.arange(len(cell)), number)
        place, weight = _gauss_points(number)
        x = start[of] + place[:, None] * (end - start)[of]
        self.cell: Int = cell[of]
        inverse = mesh.bary_gradient[self.cell]
        corner = mesh.nodes[mesh.cells[self.cell, 3]]
        self.bary: Float = np.einsum("pbj,pj->pb", inverse, x - corner) + _LAST
        if self.bary.min() < MIN_DEPTH:
            outside = x[self.bary.min(axis=1).argmin()]
            raise SolveError(
                f"a fiber leaves the body near {np.round(outside, 2).tolist()} mm",
                code="fiber-outside-body",
                where="fibers",
                action="Keep the trace inside the body, or use a shorter [mesh] edge_length",
            )
        cells, self._first, self._of_point = np.unique(
            self.cell, return_index=True, return_inverse=True
        )
        self.nodes: Int = mesh.cells[cells]
        self._count = len(mesh.nodes)
        self._is_linear = fibers.is_linear
        axes = ((end - start) / length[:, None])[:, :, None]
        self._axial: Float = (stiffness * length)[of] * weight
        self._shear: Float = np.zeros((len(of), 0))
        if fibers.shear is not None and fibers.normals is not None:
            line = np.repeat(range(len(parts)), [len(part[0]) for part in parts])[order]
            up, along = fibers.normals[line], axes[:, :, 0]
            side = _across(up, along)
            axes = np.stack([along, side, np.cross(along, side)], axis=2)
            self._shear = (fibers.shear[line] * length[:, None])[of] * weight[:, None]
        self._axes: Float = axes[of]
        along = np.einsum("pbj,pjd->pbd", inverse, self._axes)
        self._slope: Float = np.einsum("pnb,pbd->pnd", shape_derivatives(self.bary), along)

    def vectors(self, u: Float) -> Float:
        """Return the vectors (p, 3, d) at the points for displacements u (n, 3) mm."""
        moved = u[self.nodes][self._of_point]
        return np.asarray(self._axes + moved.transpose(0, 2, 1) @ self._slope)

    def energy(self, vectors: Float) -> float:
        """Return the energy of the fibers, N mm."""
        stretch = np.linalg.norm(vectors[:, :, 0], axis=1)
        axial = self._axial @ self._law(stretch)[0]
        return float(axial + 0.5 * (self._shear * _shears(vectors) ** 2).sum())

    def forces(self, vectors: Float) -> Float:
        """Return the internal nodal forces (n, 3) N, the gradient of the energy."""
        return self.linearized_forces(vectors, vectors)

    def linearized_forces(self, about: Float, vectors: Float) -> Float:
        """Return the internal nodal forces (n, 3) N of the energy linearized about other vectors.

        The tangent is positive semidefinite, like the matrix that the forces are used with.

        Args:
            about: Vectors (p, 3, d) of the linearization.
            vectors: Vectors (p, 3, d) of the state.
        """
        stretch, unit = _split(about[:, :, 0])
        axial, lateral = self._stiffness(stretch, 1.0)
        step = vectors - about
        along = (step[:, :, 0] * unit).sum(axis=1)
        tension = self._law(stretch)[1] + (axial - lateral) * along
        pull = np.zeros_like(about)
        pull[:, :, 0] = tension[:, None] * unit + lateral[:, None] * step[:, :, 0]
        pull[:, :, 0] *= self._axial[:, None]
        if self._shear.size:
            t, n = about[:, :, :1], about[:, :, 1:]
            change = (step[:, :, :1] * n + t * step[:, :, 1:]).sum(axis=1)
            force = (self._shear * (_shears(about) + change))[:, None]
            pull[:, :, 0] += (force * n).sum(axis=2)
            pull[:, :, 1:] = force * t
        local = self._slope @ pull.transpose(0, 2, 1)
        out = np.zeros((self._count, 3))
        np.add.at(out, self.nodes, np.add.reduceat(local, self._first, axis=0))
        return out

    def tangents(self, vectors: Float, share: float = 0.0) -> Float:
        """Return the tangents (c, 30, 30) N/mm of the tets `nodes`; row 3 * node + axis.

        Args:
            vectors: Vectors (p, 3, d).
            share: Share (0 to 1) of the negative part that is removed at each point: that of
                compressed fibers across their direction, and the whole geometric part of shears.
        """
        stretch, unit = _split(vectors[:, :, 0])
        axial, lateral = (self._axial * k for k in self._stiffness(stretch, share))
        along = self._slope[:, :, 0]
        # Rows of a product J^T D J, and the parts that act alike on all three axes.
        rows = [along[:, :, None] * unit[:, None]]
        weights = [axial - lateral]
        left, right = [along], [lateral[:, None] * along]
        t, gamma = vectors[:, :, 0], _shears(vectors)
        for i, stiffness in enumerate(self._shear.T):
            across = self._slope[:, :, i + 1]
            rows.append(
                along[:, :, None] * vectors[:, None, :, i + 1] + across[:, :, None] * t[:, None]
            )
            weights.append(stiffness)
            both = ((1 - share) * stiffness * gamma[:, i])[:, None]
            left += [along, across]
            right += [both * across, both * along]
        j, d = np.stack([r.reshape(-1, 30) for r in rows], 1), np.stack(weights, 1)
        a, b = np.stack(left, 1), np.stack(right, 1)
        out = np.empty((len(self.nodes), 30, 30))
        ends = [*self._first[1:], len(j)]
        for c, (first, last) in enumerate(zip(self._first, ends, strict=True)):
            part, scale = j[first:last].reshape(-1, 30), d[first:last].ravel()
            out[c] = part.T @ (scale[:, None] * part)
            alike = a[first:last].reshape(-1, 10).T @ b[first:last].reshape(-1, 10)
            for k in range(3):
                out[c, k::3, k::3] += alike
        return out

    def _stiffness(self, stretch: Float, share: float) -> tuple[Float, Float]:
        """Return second derivatives of w along and across the fiber."""
        _, first, second = self._law(stretch)
        lateral = first / np.maximum(stretch, MIN_STRETCH / 10)
        return second, np.where(lateral < 0, (1 - share) * lateral, lateral)

    def _law(self, stretch: Float) -> tuple[Float, Float, Float]:
        """Return the energy w per EA and length at the stretches, and its two derivatives."""
        if self._is_linear:
            return 0.5 * (stretch - 1) ** 2, stretch - 1, np.ones_like(stretch)
        s = np.maximum(stretch, MIN_STRETCH)
        below = stretch - s
        value, first, second = (s**2 + 2 / s - 3) / 6, (s - s**-2) / 3, (1 + 2 * s**-3) / 3
        value = value + first * below + 0.5 * second * below**2
        return value, first + second * below, second


def _shears(vectors: Float) -> Float:
    """Return the scalar products (p, d - 1) of the first vector with the others."""
    return np.asarray((vectors[:, :, :1] * vectors[:, :, 1:]).sum(axis=1))


def _split(vectors: Float) -> tuple[Float, Float]:
    """Return lengths (p,) and directions (p, 3) of vectors."""
    length = np.linalg.norm(vectors, axis=1)
    return length, vectors / np.maximum(length, 1e-12)[:, None]


def _gauss_points(number: Int) -> tuple[Float, Float]:
    """Return places (0 to 1) and weights of the Gauss points of parts with `number` (k,) points."""
    rules = {n: np.polynomial.legendre.leggauss(n) for n in np.unique(number)}
    place, weight = (np.concatenate([rules[n][i] for n in number]) for i in range(2))
    return 0.5 * (1 + place), 0.5 * weight


def _split_at_faces(locator: PointLocator, line: Float) -> tuple[Int, Float, Float]:
    """Split the pieces of a polyline where they cross faces of tets.

    Returns:
        The tet (k,) of each part, and its start and end (k, 3) mm.
    """
    mesh = locator.mesh
    start, end = line[:-1], line[1:]
    found = []
    for _ in range(_MAX_SPLITS):
        keep = np.linalg.norm(end - start, axis=1) > _MIN_LENGTH_MM
        start, end = start[keep], end[keep]
        if not len(start):
            break
        at = locator.find(0.5 * (start + end))
        # Barycentric coordinates along the part are at.bary + r * slope, with r from -1 to 1.
        slope = np.einsum("pbj,pj->pb", mesh.bary_gradient[at.cell], 0.5 * (end - start))
        reach = np.maximum(at.bary, 0) / np.maximum(np.abs(slope), 1e-300)
        high = np.where(slope < 0, reach, 1.0).min(axis=1).clip(max=1.0)
        low = -np.where(slope > 0, reach, 1.0).min(axis=1).clip(max=1.0)
        # Outside the body, and for parts along a face, the nearest tet takes all.
        whole = (at.depth < 0) | (high - low < _MIN_SHARE)
        low, high = np.where(whole, -1.0, low), np.where(whole, 1.0, high)
        middle, half = 0.5 * (start + end), 0.5 * (end - start)
        a, b = middle + low[:, None] * half, middle + high[:, None] * half
        found.append((at.cell, a, b))
        start, end = np.concatenate([start, b]), np.concatenate([a, end])
    else:
        found.append((locator.find(0.5 * (start + end)).cell, start, end))
    cell, a, b = (np.concatenate(x) for x in zip(*found, strict=True))
    return cell, a, b
