"""Choose planes that show a body's strain: through its movement and its largest strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, format_point

_MIN_STRAIN_SHARE = 0.25  # of the largest strain; smaller strains have no weight
_MIN_SIDEWAYS_SHARE = 0.2  # of the largest movement; smaller sideways movements are ignored
_MIN_AXIS_COSINE = np.cos(np.radians(20))  # a direction within 20 degrees is turned to the axis
_END_MARGIN = 0.01  # of the body's size, that a section keeps from its ends


@dataclass(frozen=True)
class Section:
    """A plane in the body at rest.

    Attributes:
        origin: Point (3,) of the plane, mm.
        normal: Unit normal (3,).
    """

    origin: Float
    normal: Float

    def words(self) -> str:
        """Describe the place of the plane for readers."""
        k = int(np.abs(self.normal).argmax())
        if abs(self.normal[k]) > 1 - 1e-6:
            return f"at {'xyz'[k]} = {self.origin[k]:.1f} mm"
        return f"tilted, through {format_point(self.origin)} mm"


@dataclass(frozen=True)
class Sections:
    """Three planes that are square to each other.

    Attributes:
        moving: The plane in which the body moves.
        lengthwise: The plane along the body, across that movement.
        across: The plane across the body, at its largest strain.
        peak: Place (3,) of the largest strain at rest, mm.
    """

    moving: Section
    lengthwise: Section
    across: Section
    peak: Float

    @property
    def all(self) -> tuple[Section, Section, Section]:
        """The three planes."""
        return self.moving, self.lengthwise, self.across


def sections(rest: Float, moved: Float, strain: Float, held: Bool) -> Sections:
    """Choose three planes for a deformed body.

    The first two planes hold a line through the middle of the moving nodes, as close as possible
    to where the strain is large; the line is along an axis if that is nearly as close. The first
    plane also holds the direction of the movement. If the nodes only turn, or move along the line,
    it holds the largest strain instead. The third plane is square to the line, through the largest
    strain.

    Args:
        rest: Nodes (n, 3) at rest, mm.
        moved: Displacements (n, 3), mm.
        strain: Largest principal strain of each node (n,).
        held: Nodes (n,) that handles hold; if there are none, the nodes that move most are taken.

    Returns:
        The planes.
    """
    size = float(np.linalg.norm(np.ptp(rest, axis=0)))
    distance = np.linalg.norm(moved, axis=1)
    is_moving = held if held.any() else distance >= np.percentile(distance, 95)
    handle = (rest[is_moving].min(0) + rest[is_moving].max(0)) / 2
    movement = moved[is_moving].mean(0)
    peak = rest[strain.argmax()]
    weight = np.maximum(strain - _MIN_STRAIN_SHARE * strain.max(), 1e-12)
    along = _fit_line(rest - handle, weight)
    along = _nearest_axis(along) if _nearest_axis(along) @ along > _MIN_AXIS_COSINE else along
    sideways = movement - (movement @ along) * along
    if np.linalg.norm(sideways) < _MIN_SIDEWAYS_SHARE * distance.max():
        sideways = peak - handle - ((peak - handle) @ along) * along
    if np.linalg.norm(sideways) < 1e-6 * size:
        sideways = np.eye(3)[np.abs(along).argmin()]
    normal = np.cross(along, sideways)
    normal = normal / np.linalg.norm(normal)
    if (
        _nearest_axis(normal) @ normal > _MIN_AXIS_COSINE
        and abs(_nearest_axis(normal) @ along) < 1e-9
    ):
        normal = _nearest_axis(normal)
    level = peak @ along
    ends = (rest @ along).min() + _END_MARGIN * size, (rest @ along).max() - _END_MARGIN * size
    return Sections(
        Section(handle, normal),
        Section(handle, np.cross(normal, along)),
        Section(handle + (np.clip(level, *ends) - handle @ along) * along, along),
        peak,
    )


def _nearest_axis(direction: Float) -> Float:
    """Return the unit vector along the axis, with its sign, that is closest to a direction."""
    k = int(np.abs(direction).argmax())
    return np.asarray(np.eye(3)[k] * np.sign(direction[k]))


def _fit_line(points: Float, weight: Float) -> Float:
    """Return the direction of the line from the origin closest to weighted points (n, 3).

    The direction points away from most of the points.
    """
    direction = np.linalg.eigh((weight[:, None] * points).T @ points)[1][:, -1]
    return np.asarray(direction if weight @ points @ direction < 0 else -direction)
