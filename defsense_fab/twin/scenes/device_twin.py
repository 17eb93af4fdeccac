"""A soft device that moves: its skin and what is glued to it, between simulated states.

A tag's center goes with the triangle that it lies on; the tag is stiff and turns as the skin under
it does on the whole: the rotation that fits best (Kabsch 1976).
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.mesh import Surface
from .scene import Patch, Scene

_FOOTPRINT = 0.75  # of a patch's size: how far around its center the skin turns it
_ALIKE = 0.5  # least cosine between a patch's normal and that of skin under it


@dataclass(frozen=True)
class RigidMotion:
    """x -> `turn` (3, 3) x + `shift` (3,) mm: how the whole device is held."""

    turn: Float
    shift: Float


def blend(fields: Float, weights: Float) -> Float:
    """The displacements (..., 3) mm of a mixture, with weights (s,), of states' `fields`
    (s, ..., 3) mm: of vertices, or of points along cords."""
    used = np.flatnonzero(weights)
    flat = fields.reshape(len(fields), -1)[used]
    return np.asarray((weights[used] @ flat).reshape(fields.shape[1:]))


class DeviceTwin:
    """A surface at rest, its displacements `fields` (s, n, 3) mm in s states, and what is glued to
    it, as it lies at rest. Raises CaptureError where they do not go together."""

    def __init__(self, rest: Surface, fields: Float, seats: tuple[Patch, ...]) -> None:
        if fields.shape[1:] != rest.vertices.shape or not np.isfinite(fields).all():
            raise CaptureError(
                f"displacements of shape {fields.shape} do not fit the {len(rest.vertices)}"
                " vertices of the surface, or are not finite",
                code="displacements-do-not-fit",
                where="device twin",
            )
        self.rest, self.fields, self.seats = rest, np.ascontiguousarray(fields), seats
        if seats:
            self._glue()

    def at(
        self, weights: Float, held: RigidMotion | None = None
    ) -> tuple[Surface, tuple[Patch, ...]]:
        """Skin and patches in a mixture (s,) of states, and as the whole is held."""
        vertices = self.rest.vertices + blend(self.fields, weights)
        if held is not None:
            vertices = vertices @ held.turn.T + held.shift
        body = Surface(vertices, self.rest.faces)
        if not self.seats:
            return body, ()
        turns = self._turns(vertices)
        spots = (self._bary[:, :, None] * vertices[self._corners]).sum(1)
        centers = spots + np.einsum("mij,mj->mi", turns, self._lift)
        moved = zip(self.seats, centers, turns @ self._axes, strict=True)
        return body, tuple(patch.moved(center, axes) for patch, center, axes in moved)

    def scene(
        self, weights: Float, held: RigidMotion | None = None, around: Scene | None = None
    ) -> Scene:
        """The same with LED, occluders and light of the scene `around`."""
        body, patches = self.at(weights, held)
        return (around or Scene()).moved(body=body, patches=patches)

    def _glue(self) -> None:
        vertices, faces = self.rest.vertices, self.rest.faces
        centers = np.stack([p.center for p in self.seats])
        self._axes = np.stack([p.axes for p in self.seats])
        _, face, spots = igl.point_mesh_squared_distance(centers, vertices, faces)
        self._corners: Int = faces[np.asarray(face, np.int64).reshape(-1)]
        spots = np.asarray(spots).reshape(-1, 3)
        self._bary = _barycentric(spots, vertices[self._corners])
        self._lift = centers - spots
        x = vertices[faces]
        normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        near = [self._under(k, x.mean(1), normals) for k in range(len(self.seats))]
        most = max(len(n) for n in near)
        self._near = np.stack([np.pad(n, (0, most - len(n))) for n in near])
        self._weight = np.stack([(np.arange(most) < len(n)) / len(n) for n in near])
        before = vertices[self._near]
        middle = (self._weight[:, :, None] * before).sum(1, keepdims=True)
        self._before = self._weight[:, :, None] * (before - middle)

    def _under(self, k: int, centers: Float, normals: Float) -> Int:
        """Vertices of the skin that turns the k-th patch."""
        patch = self.seats[k]
        close = np.linalg.norm(centers - patch.center, axis=1) < _FOOTPRINT * patch.size
        chosen = self.rest.faces[close & (normals @ patch.axes[:, 2] > _ALIKE)]
        return np.unique(np.append(chosen, self._corners[k]))

    def _turns(self, vertices: Float) -> Float:
        """Rotations (m, 3, 3) from rest."""
        spread = np.einsum("mka,mkb->mba", self._before, vertices[self._near])
        u, _, vt = np.linalg.svd(spread)
        u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
        return np.asarray(u @ vt)


def _barycentric(points: Float, triangles: Float) -> Float:
    """Weights (m, 3) of the corners (m, 3, 3) of the triangles that the points (m, 3) lie in."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = points - triangles[:, 0]
    aa, ab, bb = ((x * y).sum(1) for x, y in ((a, a), (a, b), (b, b)))
    pa, pb = (p * a).sum(1), (p * b).sum(1)
    det = aa * bb - ab * ab
    v, w = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    return np.stack([1 - v - w, v, w], axis=1)
