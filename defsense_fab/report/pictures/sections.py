"""Where a body is cut to see its strain: through what moves and where it is strained most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, format_point

_STRAINED = 0.25  # of the largest strain: less than this is not much
_ASIDE = 0.2  # of the largest movement: less than this to the side is none
_SQUARE = np.cos(np.radians(20))  # so far a direction may be turned to be that of an axis
_INSIDE = 0.01  # of the body's size: an end is not cut


@dataclass(frozen=True)
class Section:
    """The plane with the unit `normal` (3,) through `origin` (3,) mm, in the body at rest."""

    origin: Float
    normal: Float

    def words(self) -> str:
        """Where it is, for readers."""
        k = int(np.abs(self.normal).argmax())
        if abs(self.normal[k]) > 1 - 1e-6:
            return f"at {'xyz'[k]} = {self.origin[k]:.1f} mm"
        return f"tilted, through {format_point(self.origin)} mm"


@dataclass(frozen=True)
class Sections:
    """Three planes square to each other: `moving`, in which the body moves, `beside`, across that
    and along the body, `across` the body where it is strained most; where that is, `peak` (3,) mm
    at rest."""

    moving: Section
    beside: Section
    across: Section
    peak: Float

    @property
    def all(self) -> tuple[Section, Section, Section]:
        """In their order."""
        return self.moving, self.beside, self.across


def sections(rest: Float, moved: Float, strain: Float, held: Bool) -> Sections:
    """For nodes (n, 3) mm at `rest`, their displacements `moved` (n, 3) mm, and largest principal
    strain (n,); the nodes (n,) that are `held` by handles, or none.

    All but the last hold the line through the middle of what moves that lies nearest to where the
    strain is large, or along an axis, where that is about the same. The first holds the direction
    of the movement too, or the largest strain where what moves only turns or is drawn along that
    line; the last is square to the line, through the largest strain."""
    size = float(np.linalg.norm(np.ptp(rest, axis=0)))
    way = np.linalg.norm(moved, axis=1)
    some = held if held.any() else way >= np.percentile(way, 95)
    handle = (rest[some].min(0) + rest[some].max(0)) / 2
    movement = moved[some].mean(0)
    peak = rest[strain.argmax()]
    weight = np.maximum(strain - _STRAINED * strain.max(), 1e-12)
    along = _line(rest - handle, weight)
    along = _axis(along) if _axis(along) @ along > _SQUARE else along
    aside = movement - (movement @ along) * along
    if np.linalg.norm(aside) < _ASIDE * way.max():
        aside = peak - handle - ((peak - handle) @ along) * along
    if np.linalg.norm(aside) < 1e-6 * size:
        aside = np.eye(3)[np.abs(along).argmin()]
    normal = np.cross(along, aside)
    normal = normal / np.linalg.norm(normal)
    if _axis(normal) @ normal > _SQUARE and abs(_axis(normal) @ along) < 1e-9:
        normal = _axis(normal)
    level = peak @ along
    ends = (rest @ along).min() + _INSIDE * size, (rest @ along).max() - _INSIDE * size
    return Sections(
        Section(handle, normal),
        Section(handle, np.cross(normal, along)),
        Section(handle + (np.clip(level, *ends) - handle @ along) * along, along),
        peak,
    )


def _axis(way: Float) -> Float:
    """The unit vector of the axis, with its sign, that is nearest to a direction."""
    k = int(np.abs(way).argmax())
    return np.asarray(np.eye(3)[k] * np.sign(way[k]))


def _line(points: Float, weight: Float) -> Float:
    """The direction of the line from the origin that points (n, 3) of some `weight` (n,) lie
    nearest to, away from most of them."""
    way = np.linalg.eigh((weight[:, None] * points).T @ points)[1][:, -1]
    return np.asarray(way if weight @ points @ way < 0 else -way)
