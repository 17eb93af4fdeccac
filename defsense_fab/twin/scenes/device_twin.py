"""A deformable device between its simulated states: its skin and the patches glued to it.

The center of a patch moves with the triangle that it lies on. The patch is stiff: it turns by the
rotation that fits the skin under it best.

References:
    W. Kabsch: A solution for the best rotation to relate two sets of vectors. 1976.
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.mesh import Surface
from .scene import Patch, Scene

FOOTPRINT = 0.75  # of a patch's size: radius around its center in which the skin turns it
MIN_NORMAL_COSINE = 0.5  # between the normals of a patch and of the skin under it


@dataclass(frozen=True)
class RigidMotion:
    """A rigid motion of the whole device: x -> rotation @ x + translation.

    Attributes:
        rotation: Rotation (3, 3).
        translation: Translation (3,) mm.
    """

    rotation: Float
    translation: Float


def blend(fields: Float, weights: Float) -> Float:
    """Return the weighted sum of the states' displacement fields.

    Args:
        fields: Displacements (s, ..., 3) mm in each state, of vertices or of points along cords.
        weights: Weights (s,).

    Returns:
        Displacements (..., 3) mm.
    """
    used = np.flatnonzero(weights)
    flat = fields.reshape(len(fields), -1)[used]
    return np.asarray((weights[used] @ flat).reshape(fields.shape[1:]))


class DeviceTwin:
    """The skin of a device, its displacements in s states, and the patches glued to it.

    Args:
        rest: The surface at rest, n vertices, mm.
        fields: Displacements (s, n, 3) mm of the vertices in each state.
        patches: The patches as they are glued to the surface at rest.

    Raises:
        CaptureError: The displacements do not fit the surface (`displacements-do-not-fit`).
    """

    def __init__(self, rest: Surface, fields: Float, patches: tuple[Patch, ...]) -> None:
        if fields.shape[1:] != rest.vertices.shape or not np.isfinite(fields).all():
            raise CaptureError(
                f"displacements of shape {fields.shape} do not fit the {len(rest.vertices)}"
                " vertices of the surface, or are not finite",
                code="displacements-do-not-fit",
                where="device twin",
            )
        self.rest, self.fields, self.patches = rest, np.ascontiguousarray(fields), patches
        if patches:
            self._attach_patches()

    def deform(
        self, weights: Float, held: RigidMotion | None = None
    ) -> tuple[Surface, tuple[Patch, ...]]:
        """Return the skin and the patches in a mixture of states.

        Args:
            weights: Weights of the states (s,).
            held: Rigid motion of the whole device; None for none.

        Returns:
            The deformed surface and the moved patches.
        """
        vertices = self.rest.vertices + blend(self.fields, weights)
        if held is not None:
            vertices = vertices @ held.rotation.T + held.translation
        body = Surface(vertices, self.rest.faces)
        if not self.patches:
            return body, ()
        rotations = self._fit_rotations(vertices)
        contacts = (self._barycentric[:, :, None] * vertices[self._corners]).sum(1)
        centers = contacts + np.einsum("mij,mj->mi", rotations, self._lift)
        moved = zip(self.patches, centers, rotations @ self._axes, strict=True)
        return body, tuple(patch.moved_to(center, axes) for patch, center, axes in moved)

    def scene(
        self, weights: Float, held: RigidMotion | None = None, surroundings: Scene | None = None
    ) -> Scene:
        """Return a scene of the device in a mixture of states.

        Args:
            weights: Weights of the states (s,).
            held: Rigid motion of the whole device; None for none.
            surroundings: A scene whose LED, occluders and light are used.

        Returns:
            The scene.
        """
        body, patches = self.deform(weights, held)
        return (surroundings or Scene()).replace(body=body, patches=patches)

    def _attach_patches(self) -> None:
        """Find for each patch the triangle that it lies on and the vertices that turn it."""
        vertices, faces = self.rest.vertices, self.rest.faces
        centers = np.stack([p.center for p in self.patches])
        self._axes = np.stack([p.axes for p in self.patches])
        _, face, contacts = igl.point_mesh_squared_distance(centers, vertices, faces)
        self._corners: Int = faces[np.asarray(face, np.int64).reshape(-1)]
        contacts = np.asarray(contacts).reshape(-1, 3)
        self._barycentric = _barycentric(contacts, vertices[self._corners])
        self._lift = centers - contacts
        x = vertices[faces]
        normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        footprints = [self._footprint(k, x.mean(1), normals) for k in range(len(self.patches))]
        width = max(len(n) for n in footprints)
        self._near = np.stack([np.pad(n, (0, width - len(n))) for n in footprints])
        self._weight = np.stack([(np.arange(width) < len(n)) / len(n) for n in footprints])
        before = vertices[self._near]
        middle = (self._weight[:, :, None] * before).sum(1, keepdims=True)
        self._before = self._weight[:, :, None] * (before - middle)

    def _footprint(self, k: int, centers: Float, normals: Float) -> Int:
        """Return the vertices of the skin that turn the k-th patch."""
        patch = self.patches[k]
        is_close = np.linalg.norm(centers - patch.center, axis=1) < FOOTPRINT * patch.size
        chosen = self.rest.faces[is_close & (normals @ patch.axes[:, 2] > MIN_NORMAL_COSINE)]
        return np.unique(np.append(chosen, self._corners[k]))

    def _fit_rotations(self, vertices: Float) -> Float:
        """Return the rotations (m, 3, 3) of the patches from rest."""
        spread = np.einsum("mka,mkb->mba", self._before, vertices[self._near])
        u, _, vt = np.linalg.svd(spread)
        u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
        return np.asarray(u @ vt)


def _barycentric(points: Float, triangles: Float) -> Float:
    """Return the barycentric weights (m, 3) of points (m, 3) in triangles (m, 3, 3)."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = points - triangles[:, 0]
    aa, ab, bb = ((x * y).sum(1) for x, y in ((a, a), (a, b), (b, b)))
    pa, pb = (p * a).sum(1), (p * b).sum(1)
    det = aa * bb - ab * ab
    v, w = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    return np.stack([1 - v - w, v, w], axis=1)
