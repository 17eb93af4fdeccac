"""Where markers sit on the surface, and how they move with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...core.arrays import Float, Int
from .mesh_operators import nearest_points
from .rotation import nearest_rotations


@dataclass(frozen=True)
class Attachment:
    """Each of m markers follows three vertices `corners` (m, 3) by `weights` (m, 3), and stands
    off their surface by `offset` (m, 3) mm at rest, which turns with it."""

    corners: Int
    weights: Float
    offset: Float

    @classmethod
    def of(cls, markers: Float, vertices: Float, triangles: Int) -> Attachment:
        """Of markers (m, 3) mm, to the nearest points of a surface at rest."""
        corners, weights = nearest_points(markers, vertices, triangles)
        on = np.einsum("mk,mkd->md", weights, vertices[corners])
        return cls(corners, weights, markers - on)

    def matrix(self, count: int) -> csr_array:
        """(m, count): places on the surface of `count` vertices."""
        rows = np.repeat(np.arange(len(self.corners)), 3)
        shape = (len(self.corners), count)
        return csr_array((self.weights.ravel(), (rows, self.corners.ravel())), shape=shape)

    def on_surface(self, x: Float) -> Float:
        """(m, 3) mm below the markers, of vertices x (v, 3)."""
        return np.asarray(np.einsum("mk,mkd->md", self.weights, x[self.corners]))

    def stand_off(self, rotations: Float) -> Float:
        """(m, 3) mm from the surface to the markers, of the vertices' rotations (v, 9)."""
        mean = np.einsum("mk,mkd->md", self.weights, rotations[self.corners])
        turned = nearest_rotations(mean.reshape(-1, 3, 3))
        return np.asarray(np.einsum("mij,mj->mi", turned, self.offset))
