"""What can be read from a solved displacement: gradients, stretches, at nodes and anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ..elements.tet10 import (
    EDGES,
    QuadraticMesh,
    boundary_faces,
    deformation_gradient,
    shape_derivatives,
)

# Is a solved field one that a real body can have? Inverted tets, and a surface through itself.
#
# Contact is not modelled, so an equilibrium may pass through itself; the energy sees a tet only at
# its quadrature points, so one may fold over elsewhere, and the stable model is defined even there.

_NODES = np.concatenate([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
#: A face of six nodes as four flat ones.
_SPLIT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


@dataclass(frozen=True)
class FieldValidity:
    """`inverted` (k,) tets with det F <= 0 at a node or a quadrature point, the least det F there,
    and `inside` (p, 3) mm: deformed places of the surface that lie inside the body."""

    inverted: Int
    min_jacobian: float
    penetrations: Float

    @property
    def is_sound(self) -> bool:
        return len(self.inverted) == 0 and len(self.penetrations) == 0

    def problem(self) -> str | None:
        """What is wrong, in words."""
        said = []
        if len(self.penetrations):
            where = ", ".join(f"{v:.3g}" for v in self.penetrations.mean(0))
            said.append(f"the body passes through itself about ({where}) mm")
        if len(self.inverted):
            said.append(f"{len(self.inverted)} tetrahedra are inverted")
        return "; ".join(said) or None


def nodal_gradients(mesh: QuadraticMesh, u: Float) -> Float:
    """F (m, 10, 3, 3) at each tet's own nodes."""
    by = np.einsum("vnb,mbj->mvnj", shape_derivatives(_NODES), mesh.bary_gradient)
    return np.asarray(np.eye(3) + np.einsum("mvnj,mna->mvaj", by, u[mesh.cells], optimize=True))


def check_field(mesh: QuadraticMesh, u: Float) -> FieldValidity:
    """Look at displacements u (n, 3) mm."""
    inner = deformation_gradient(mesh, u)
    jacobian = np.linalg.det(np.concatenate([nodal_gradients(mesh, u), inner], axis=1))
    bad = np.flatnonzero((jacobian <= 0).any(axis=1))
    return FieldValidity(bad, float(jacobian.min()), _inside(mesh, u))


def _inside(mesh: QuadraticMesh, u: Float) -> Float:
    """Places just outside the deformed surface that its winding number calls inside."""
    import igl

    faces = boundary_faces(mesh)[:, _SPLIT].reshape(-1, 3)
    x = mesh.nodes + u
    corners = x[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    # A thousandth of an edge outside: the own surface gives 0 there, any other layer 1 or more.
    offset = 1e-3 * np.sqrt(size) * normal / np.maximum(size, 1e-30)
    places = corners.mean(axis=1) + offset
    winding = igl.fast_winding_number(x, np.ascontiguousarray(faces), places)
    return np.asarray(places[np.asarray(winding).ravel() > 0.5])


def deformation_gradient_at_nodes(mesh: QuadraticMesh, u: Float) -> Float:
    """F (n, 3, 3) at the nodes, averaged over the tets that share each by their volume."""
    F = nodal_gradients(mesh, u)
    weight = np.repeat(mesh.weight[:, None], 10, axis=1).ravel()
    nodes, count = mesh.cells.ravel(), len(mesh.nodes)
    share = np.bincount(nodes, weight, count)
    flat = F.reshape(-1, 9)
    total = np.stack([np.bincount(nodes, weight * flat[:, k], count) for k in range(9)], axis=1)
    return np.asarray((total / share[:, None]).reshape(-1, 3, 3))


def principal_stretches(F: Float) -> Float:
    """Stretches (..., 3) of gradients (..., 3, 3), largest first: the singular values."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(_right_cauchy_green(F)), 0))[..., ::-1])


def stretch_along(F: Float, direction: Float) -> Float:
    """|F d| (...) of gradients (..., 3, 3) along rest directions (..., 3), of any length."""
    d = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.einsum("...aj,...j->...a", F, d), axis=-1))


def green_strain(F: Float) -> Float:
    """E = (F^T F - 1) / 2, (..., 3, 3)."""
    return np.asarray((_right_cauchy_green(F) - np.eye(3)) / 2)


def _right_cauchy_green(F: Float) -> Float:
    return np.asarray(np.einsum("...ki,...kj->...ij", F, F))
