"""The two ends of a body: regions that hold and move it, and poses between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface, facet_crosses

END_FRACTION = 15  # length of the body over the depth of a region at either end
MIN_REGION_EDGES = 1.5  # in narrower regions the strain depends on the mesh
MIN_SLANTED_RATIO = 1.1  # length along the principal axis over that along x, y or z
MAX_SLENDER_WIDTH = 0.6  # width over length: the axis of wider bodies is arbitrary
STANDING_BONUS = 1.15  # a body stands even if it is this factor longer than high
MIN_CENTER_OFFSET = 0.05  # of the length: offset of the center of mass towards a thick end
MAX_SIDE_BEND_RATIO = 3.0  # width over thickness of bodies that bend sideways
#: Degrees per ratio of length to thickness, and their smallest and largest value.
BEND_DEG, TWIST_DEG = (6.0, 8.0, 30.0), (9.0, 12.0, 45.0)
PULL_SHARE = 0.1  # of the length
MIN_WHOLE_DEG = 4.0  # larger amplitudes are whole degrees


@dataclass(frozen=True)
class BodyEnds:
    """The ends of a body.

    Attributes:
        axes: Unit vectors (3, 3), one per row: from base to tip, along the width, and along the
            thickness.
        low: Smallest coordinates (3,) mm of the body along these axes.
        high: Largest coordinates (3,) mm.
        volume: Volume, mm^3.
        spread: Integrals (3,) over the volume of the squared distance from the center along each
            axis, mm^5.
    """

    axes: Float
    low: Float
    high: Float
    volume: float
    spread: Float

    @property
    def size(self) -> Float:
        """Length, width and thickness (3,) mm."""
        return self.high - self.low

    def region(self, name: str, edge_length: float) -> dict[str, Any]:
        """Return the region `base` or `tip` for device.toml.

        Args:
            name: `base` or `tip`.
            edge_length: Edge length of the mesh, mm.
        """
        axis = self.axes[0]
        depth = min(
            max(self.size[0] / END_FRACTION, MIN_REGION_EDGES * edge_length), self.size[0] / 4
        )
        position = self.low[0] + depth if name == "base" else self.high[0] - depth
        normal = -axis if name == "base" else axis
        return {
            "half_space": {
                "origin": round_numbers(position * axis),
                "normal": round_numbers(normal),
            }
        }

    def default_poses(self) -> tuple[str, ...]:
        """Return the names of the poses that such a body usually takes."""
        is_flat = self.size[1] > MAX_SIDE_BEND_RATIO * self.size[2]
        return ("bend", "twist") if is_flat else ("bend", "bend_side", "twist")

    def move(self, pose: str, share: float = 1.0) -> dict[str, Any]:
        """Return the motion of the tip in one of `options.END_POSES`, for device.toml.

        Args:
            pose: Name of the pose.
            share: Share of the amplitude for such a shape, up to 1.
        """
        if pose == "pull":
            return {"translate": round_numbers(share * self.pull * self.axes[0])}
        axis = self.axes[{"bend": 1, "bend_side": 2, "twist": 0}[pose]]
        degrees = share * self.turn(pose)
        degrees = round(degrees) if degrees >= MIN_WHOLE_DEG else float(f"{degrees:.2g}")
        return {"rotate": {"axis": round_numbers(axis), "degrees": degrees}, "translate": "free"}

    @property
    def pull(self) -> float:
        """Amplitude of the pose `pull` for such a shape, mm."""
        return PULL_SHARE * float(self.size[0])

    def turn(self, pose: str) -> int:
        """Return the amplitude of a pose that turns the tip for such a shape, degrees."""
        length, width, thickness = self.size
        across, (rate, smallest, largest) = {
            "bend": (thickness, BEND_DEG),
            "bend_side": (width, BEND_DEG),
            "twist": (width, TWIST_DEG),
        }[pose]
        return round(float(np.clip(rate * length / across, smallest, largest)))


def find_ends(surface: Surface) -> BodyEnds:
    """Find the ends of a body in mm.

    They are along its longest side, or along its principal axis if the body is slanted. The base is
    the foot of a standing body, and the thicker end of others.
    """
    center, volume, second = _moments(surface)
    axes = _principal_axes(second)
    extents = np.ptp(surface.vertices, axis=0)
    principal = np.ptp(surface.vertices @ axes.T, axis=0)
    if (
        principal[0] < MIN_SLANTED_RATIO * extents.max()
        or principal[1:].max() > MAX_SLENDER_WIDTH * principal[0]
    ):
        axes = np.eye(3)[np.argsort(-extents * [1, 1, STANDING_BONUS], kind="stable")]
    along = surface.vertices @ axes[0]
    middle, length = (along.min() + along.max()) / 2, np.ptp(along)
    is_upright = int(np.abs(axes[0]).argmax()) == 2
    is_reversed = (
        axes[0, 2] < 0 if is_upright else center @ axes[0] - middle > MIN_CENTER_OFFSET * length
    )
    if is_reversed:
        axes = axes * np.array([[-1.0], [1.0], [1.0]])
    reach = surface.vertices @ axes.T
    sides = np.ptp(reach, axis=0)
    if sides[2] > sides[1]:
        axes, reach = axes[[0, 2, 1]], reach[:, [0, 2, 1]]
    spread = np.einsum("ij,jk,ik->i", axes, second, axes)
    return BodyEnds(axes, reach.min(axis=0), reach.max(axis=0), volume, spread)


def _moments(surface: Surface) -> tuple[Float, float, Float]:
    """Return the center of mass (3,), the volume, and the second moment (3, 3) about the center."""
    corners = surface.vertices[surface.faces]
    start = surface.vertices.mean(axis=0)
    tets = corners - start  # with `start` as their fourth corner
    volumes = np.einsum("ij,ij->i", tets[:, 0], np.cross(tets[:, 1], tets[:, 2])) / 6
    center = np.einsum("i,ia->a", volumes, tets.sum(axis=1)) / (4 * volumes.sum())
    sums = tets.sum(axis=1)
    second = np.einsum("i,ia,ib->ab", volumes, sums, sums)
    second = (second + np.einsum("i,ika,ikb->ab", volumes, tets, tets)) / 20
    second = second - volumes.sum() * np.outer(center, center)
    return center + start, float(volumes.sum()), second


def _principal_axes(second: Float) -> Float:
    """Return the principal axes (3, 3) of a second moment in rows, the longest first."""
    values, vectors = np.linalg.eigh(second)
    axes = vectors[:, np.argsort(-values)].T
    signs = np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])
    return np.asarray(axes * signs[:, None])


def estimate_thickness(surface: Surface) -> float:
    """Return the largest possible thickness of a body, mm.

    It is the smallest extent, or the thickness of walls with the volume and area of the body.
    """
    area = np.linalg.norm(facet_crosses(surface.vertices, surface.faces), axis=1).sum() / 2
    return float(min(np.ptp(surface.vertices, axis=0).min(), 6 * surface.volume / area))


def round_numbers(vector: Sequence[float] | Float) -> list[float]:
    """Return numbers for device.toml: four digits, and integers without a point."""
    rounded = [float(f"{v:.4g}") + 0.0 for v in np.round(np.asarray(vector, float), 4)]
    return [int(v) if v.is_integer() else v for v in rounded]
