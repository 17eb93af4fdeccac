"""Read gradients, stretches and validity from a solved displacement field."""

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

_NODES = np.concatenate([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
#: A face of six nodes as four flat triangles.
_FACE_TRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


@dataclass(frozen=True)
class FieldValidity:
    """Whether a real body can have a solved field.

    Contact is not modeled, so an equilibrium may pass through itself. The energy is evaluated only
    at the quadrature points, so a tet may fold over elsewhere, and the stable model is defined even
    at inverted gradients.

    Attributes:
        inverted: (k,) numbers of tets with det F <= 0 at a node or a quadrature point.
        penetrations: (p, 3) mm, points of the deformed surface that lie inside the body.
    """

    inverted: Int
    penetrations: Float

    def problem(self) -> str | None:
        """Describe what is wrong, for people; None for a valid field."""
        defects = []
        if len(self.penetrations):
            where = ", ".join(f"{v:.3g}" for v in self.penetrations.mean(0))
            defects.append(f"the body passes through itself about ({where}) mm")
        if len(self.inverted):
            defects.append(f"{len(self.inverted)} tetrahedra are inverted")
        return "; ".join(defects) or None


def locate_largest_strain(mesh: QuadraticMesh, u: Float) -> tuple[float, Float]:
    """Return the largest principal strain of displacements u (n, 3) mm, and where it is.

    It is averaged over each tet, since single points next to a held region stretch without bound.

    Returns:
        The engineering strain, and the point (3,) mm of the body at rest.
    """
    stretch = principal_stretches(deformation_gradient(mesh, u))[..., 0].mean(axis=1)
    worst = int(stretch.argmax())
    return float(stretch[worst] - 1), np.asarray(mesh.nodes[mesh.cells[worst, :4]].mean(axis=0))


def nodal_gradients(mesh: QuadraticMesh, u: Float) -> Float:
    """Return F (m, 10, 3, 3) of each tet at its ten nodes."""
    by = np.einsum("vnb,mbj->mvnj", shape_derivatives(_NODES), mesh.bary_gradient)
    return np.asarray(np.eye(3) + np.einsum("mvnj,mna->mvaj", by, u[mesh.cells], optimize=True))


def check_field(mesh: QuadraticMesh, u: Float) -> FieldValidity:
    """Check displacements u (n, 3) mm for inverted tets and self-penetration."""
    inner = deformation_gradient(mesh, u)
    jacobian = np.linalg.det(np.concatenate([nodal_gradients(mesh, u), inner], axis=1))
    inverted = np.flatnonzero((jacobian <= 0).any(axis=1))
    return FieldValidity(inverted, _find_penetrations(mesh, u))


def _find_penetrations(mesh: QuadraticMesh, u: Float) -> Float:
    """Return points (p, 3) mm just outside the surface that lie inside by the winding number."""
    import igl

    faces = boundary_faces(mesh)[:, _FACE_TRIANGLES].reshape(-1, 3)
    x = mesh.nodes + u
    corners = x[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    # A thousandth of an edge outside, the surface itself gives 0, any other layer 1 or more.
    offset = 1e-3 * np.sqrt(size) * normal / np.maximum(size, 1e-30)
    points = corners.mean(axis=1) + offset
    winding = igl.fast_winding_number(x, np.ascontiguousarray(faces), points)
    return np.asarray(points[np.asarray(winding).ravel() > 0.5])


def deformation_gradient_at_nodes(mesh: QuadraticMesh, u: Float) -> Float:
    """Return F (n, 3, 3) at the nodes, averaged over adjacent tets by their volume."""
    F = nodal_gradients(mesh, u)
    weight = np.repeat(mesh.weight[:, None], 10, axis=1).ravel()
    nodes, count = mesh.cells.ravel(), len(mesh.nodes)
    share = np.bincount(nodes, weight, count)
    flat = F.reshape(-1, 9)
    total = np.stack([np.bincount(nodes, weight * flat[:, k], count) for k in range(9)], axis=1)
    return np.asarray((total / share[:, None]).reshape(-1, 3, 3))


def principal_stretches(F: Float) -> Float:
    """Return the principal stretches (..., 3) of gradients (..., 3, 3), largest first."""
    C = np.einsum("...ki,...kj->...ij", F, F)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(C), 0))[..., ::-1])


def stretch_along(F: Float, direction: Float) -> Float:
    """Return the stretches (...) along rest directions (..., 3), of any length.

    Args:
        F: Deformation gradients (..., 3, 3).
        direction: Directions (..., 3) at rest.
    """
    d = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.einsum("...aj,...j->...a", F, d), axis=-1))
