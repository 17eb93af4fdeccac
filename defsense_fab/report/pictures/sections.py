"""Choose planes that show a body's strain: through its movement and its largest strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, format_point

_MIN_STRAIN_SHARE = 0.25  # of the largest strain; smaller strains have no weight
_MIN_SIDEWAYS_SHARE = 0.2  # of the largest movement; smaller sideways movements are ignored
_MIN_AXIS_COSINE = float(
    np.cos(np.radians(20))
)  # a direction within 20 degrees is turned to the axis
_MAX_SKEW = 1e-9  # cosine between directions that are square to each other
# A plane is tilted by up to 5 degrees, so that it is square to an axis or holds one.
_MIN_PLANE_COSINE, _MAX_TILT = float(np.cos(np.radians(5))), float(np.sin(np.radians(5)))
_MAX_LEAST_SHARE = 0.25  # of the next larger mean square displacement; else no direction is least
_PLANE_MARGIN = 0.015  # of the body's size; nodes this near to a plane are in it
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
    plane also holds the movement: it is square to the direction of least displacement. If the nodes
    move in one direction only, it holds that direction; if they only turn, or move along the line,
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
    has_moved = bool(np.linalg.norm(movement) >= _MIN_SIDEWAYS_SHARE * distance.max())
    normal = _least_displacement(moved) if has_moved else None
    if normal is None:
        along = _snap(_fit_line(rest - handle, weight))
        normal = _find_normal(along, movement, peak - handle, distance.max())
        if abs(_snap(normal) @ along) < _MAX_SKEW:
            normal = _snap(normal)
    else:
        normal, offset = _snap(normal, _MIN_PLANE_COSINE), rest - handle
        along = _fit_line(offset - np.outer(offset @ normal, normal), weight)
        if abs(_snap(along) @ normal) < _MAX_TILT:
            along = _snap(along)
            normal = normal - (normal @ along) * along
            normal = normal / np.linalg.norm(normal)
    handle = handle + _choose_offset((rest[is_moving] - handle) @ normal, size) * normal
    level = peak @ along
    ends = (rest @ along).min() + _END_MARGIN * size, (rest @ along).max() - _END_MARGIN * size
    return Sections(
        Section(handle, normal),
        Section(handle, np.cross(normal, along)),
        Section(handle + (np.clip(level, *ends) - handle @ along) * along, along),
        peak,
    )


def _least_displacement(moved: Float) -> Float | None:
    """Return the direction (3,) of least displacement, or None if it is not unique."""
    squares, axes = np.linalg.eigh(moved.T @ moved)
    is_unique = squares[0] < _MAX_LEAST_SHARE * squares[1] and squares[1] > 1e-9 * squares[2]
    return np.asarray(axes[:, 0]) if is_unique else None


def _find_normal(along: Float, movement: Float, to_peak: Float, largest: float) -> Float:
    """Return the normal (3,) of the plane that holds a line and a movement or the largest strain.

    Args:
        along: Direction (3,) of the line.
        movement: Mean displacement (3,) of the moving nodes, mm.
        to_peak: Vector (3,) from a point of the line to the largest strain, mm.
        largest: Largest displacement, mm.
    """
    sideways = movement - (movement @ along) * along
    if np.linalg.norm(sideways) < _MIN_SIDEWAYS_SHARE * largest:
        sideways = to_peak - (to_peak @ along) * along
    if np.linalg.norm(sideways) < 1e-6 * max(float(np.linalg.norm(to_peak)), 1.0):
        sideways = np.eye(3)[np.abs(along).argmin()]
    normal = np.cross(along, sideways)
    return np.asarray(normal / np.linalg.norm(normal))


def _choose_offset(levels: Float, size: float) -> float:
    """Return where a plane passes through moving nodes: at 0, unless a plane elsewhere passes
    through more than twice as many of them, as at the middle between two fingers.

    A plane along the skin does not count: meshes have many nodes there, on one side only.

    Args:
        levels: Distances (n,) of the nodes from the plane at 0, mm.
        size: Size of the body, mm.
    """
    margin = _PLANE_MARGIN * size

    def count(level: float) -> int:
        return int((np.abs(levels - level) <= margin).sum())

    def is_inside(level: float) -> bool:
        offset = levels - level
        depth = np.abs(offset)
        near = offset[(depth >= margin / 2) & (depth <= 3 * margin)]
        return bool((near < 0).any() and (near > 0).any())

    candidates = sorted(np.percentile(levels, np.arange(0, 101, 5)), key=abs)
    best = max(filter(is_inside, candidates), key=count, default=0.0)
    return float(best) if count(best) > 2 * count(0.0) else 0.0


def _snap(direction: Float, min_cosine: float = _MIN_AXIS_COSINE) -> Float:
    """Return the axis that is close to a direction (3,), or the direction."""
    axis = _nearest_axis(direction)
    return axis if axis @ direction > min_cosine else direction


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
