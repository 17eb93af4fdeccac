"""Define the records of moulds: the rules that they keep, their faces and pieces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.arrays import Float
from ...core.mesh import Surface
from ..parts.records import Check


@dataclass(frozen=True)
class MouldRules:
    """Rules of a mould.

    Attributes:
        wall: Wall between cavity and outside where nothing is screwed, mm.
        line: Width of the printer's line, mm.
        shrinkage: Linear shrinkage of the cast material.
    """

    wall: float = 5.0
    line: float = 0.4
    shrinkage: float = 0.0


@dataclass(frozen=True)
class Face:
    """A face in which a part meets others.

    Where the part wraps around the face, the `notch` over it is filled, the point lies as high as
    the part reaches, and the notch belongs to the core, too.

    Attributes:
        normal: Outward unit normal (3,).
        origin: Point (3,) of the face, mm.
        area: Area, mm^2.
        core: What is hollowed out of the part there (manifold3d solid), or None.
        notch: The filled notch, or None.
    """

    normal: Float
    origin: Float
    area: float
    core: Any
    notch: Any = None

    @property
    def height(self) -> float:
        """Height of the face along its normal, mm."""
        return float(self.normal @ self.origin)


@dataclass(frozen=True)
class MouldPiece:
    """A piece of a mould in the part's rest frame, enlarged by the shrinkage.

    Attributes:
        name: Its name.
        surface: Its surface, mm.
        opens: Direction (3,) in which it comes off.
        down: Direction (3,) to the bed as it is printed.
    """

    name: str
    surface: Surface
    opens: Float
    down: Float


@dataclass(frozen=True)
class Mould:
    """The mould of a part.

    Attributes:
        part: Name of the part.
        pieces: Pieces in the order in which they come off.
        up: Direction (3,) that points up while it is filled.
        pour: Pouring hole (3,), mm.
        vents: Vents (v, 3), mm.
        cavity: Volume of the cavity, mm^3.
        block: Volume of the whole block, mm^3.
        strain: Largest strain of the part as it is taken out.
        at: Where (3,), mm, or None if there is none.
        checks: Measurements.
    """

    part: str
    pieces: tuple[MouldPiece, ...]
    up: Float
    pour: Float
    vents: Float
    cavity: float
    block: float
    strain: float
    at: Float | None
    checks: tuple[Check, ...]
