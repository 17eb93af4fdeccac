"""The two ends of a body: regions to hold and to move it by, and poses between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface, facet_crosses

#: Poses of one end against the other, and what each is.
END_POSES = {
    "bend": "the tip turns to where the body is thinnest",
    "bend_side": "the tip turns to the other side",
    "twist": "the tip turns about the body's length",
    "pull": "the tip is drawn away from the base",
}
_END = 15  # of the longest axis: a region at either end
_EDGES = 1.5  # a narrower region's strain depends on the mesh
_SLANTED = 1.1  # a body is this much longer along its own axis than along x, y or z
_SLENDER = 0.6  # of that length, its width: else its own axis says little
_STANDS = 1.15  # what is so much lower than long still stands, rather than lies
_HEAVIER = 0.05  # of the length: so far from the middle the centre of mass lies at a thick end
_FLAT = 3.0  # wider than that many times its thickness a body does not bend sideways
#: Degrees for each time that the body is longer than thick, the least and the most.
_BEND, _TWIST = (6.0, 8.0, 30.0), (9.0, 12.0, 45.0)
_PULL = 0.1  # of the length


@dataclass(frozen=True)
class BodyEnds:
    """Unit `axes` (3, 3), one a row: from base to tip, across it the wider and the thinner side;
    how far the body reaches along each, `low` and `high` (3,) mm from the origin."""

    axes: Float
    low: Float
    high: Float

    @property
    def size(self) -> Float:
        """Length, width and thickness (3,) mm."""
        return self.high - self.low

    def region(self, name: str, edge_length: float) -> dict[str, Any]:
        """`base` or `tip` as device.toml has it, where the mesh has edges so long, mm."""
        axis = self.axes[0]
        depth = min(max(self.size[0] / _END, _EDGES * edge_length), self.size[0] / 4)
        at = self.low[0] + depth if name == "base" else self.high[0] - depth
        normal = -axis if name == "base" else axis
        return {"half_space": {"origin": numbers(at * axis), "normal": numbers(normal)}}

    def usual(self) -> tuple[str, ...]:
        """The poses that a hand gives such a body."""
        flat = self.size[1] > _FLAT * self.size[2]
        return ("bend", "twist") if flat else ("bend", "bend_side", "twist")

    def move(self, pose: str) -> dict[str, Any]:
        """What one of END_POSES does to the tip, as device.toml has it."""
        length, width, thickness = self.size
        if pose == "pull":
            return {"translate": numbers(_PULL * length * self.axes[0])}
        axis, across, (rate, least, most) = {
            "bend": (self.axes[1], thickness, _BEND),
            "bend_side": (self.axes[2], width, _BEND),
            "twist": (self.axes[0], width, _TWIST),
        }[pose]
        degrees = round(float(np.clip(rate * length / across, least, most)))
        return {"rotate": {"axis": numbers(axis), "degrees": degrees}, "translate": "free"}


def find_ends(surface: Surface) -> BodyEnds:
    """Of a body in mm: along its longest side, or along its own axis where it lies slanted. A body
    that stands is held at its foot, others at their thicker end."""
    center, axes = _principal(surface)
    extents = np.ptp(surface.vertices, axis=0)
    own = np.ptp(surface.vertices @ axes.T, axis=0)
    if own[0] < _SLANTED * extents.max() or own[1:].max() > _SLENDER * own[0]:
        axes = np.eye(3)[np.argsort(-extents * [1, 1, _STANDS], kind="stable")]
    along = surface.vertices @ axes[0]
    middle, length = (along.min() + along.max()) / 2, np.ptp(along)
    upright = int(np.abs(axes[0]).argmax()) == 2
    turned = axes[0, 2] < 0 if upright else center @ axes[0] - middle > _HEAVIER * length
    if turned:
        axes = axes * np.array([[-1.0], [1.0], [1.0]])
    reach = surface.vertices @ axes.T
    sides = np.ptp(reach, axis=0)
    if sides[2] > sides[1]:
        axes, reach = axes[[0, 2, 1]], reach[:, [0, 2, 1]]
    return BodyEnds(axes, reach.min(axis=0), reach.max(axis=0))


def _principal(surface: Surface) -> tuple[Float, Float]:
    """Centre of mass (3,) and principal axes (3, 3), the longest first, each a row."""
    corners = surface.vertices[surface.faces]
    start = surface.vertices.mean(axis=0)
    tets = corners - start  # with `start` as their fourth corner
    volumes = np.einsum("ij,ij->i", tets[:, 0], np.cross(tets[:, 1], tets[:, 2])) / 6
    center = np.einsum("i,ia->a", volumes, tets.sum(axis=1)) / (4 * volumes.sum())
    sums = tets.sum(axis=1)
    second = np.einsum("i,ia,ib->ab", volumes, sums, sums)
    second = (second + np.einsum("i,ika,ikb->ab", volumes, tets, tets)) / 20
    values, vectors = np.linalg.eigh(second - volumes.sum() * np.outer(center, center))
    axes = vectors[:, np.argsort(-values)].T
    signs = np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])
    return center + start, axes * signs[:, None]


def thickness(surface: Surface) -> float:
    """Of the body mm, at most: its smallest extent, or what its volume and area say of walls."""
    area = np.linalg.norm(facet_crosses(surface.vertices, surface.faces), axis=1).sum() / 2
    return float(min(np.ptp(surface.vertices, axis=0).min(), 6 * surface.volume / area))


def numbers(vector: Sequence[float] | Float) -> list[float]:
    """As device.toml has them: four digits, whole ones without a point."""
    rounded = [float(f"{v:.4g}") + 0.0 for v in np.round(np.asarray(vector, float), 4)]
    return [int(v) if v.is_integer() else v for v in rounded]
