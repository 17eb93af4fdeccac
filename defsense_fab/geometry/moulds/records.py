"""What a mould must keep, its pieces, and how they were found to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.arrays import Float
from ...core.mesh import Surface
from ..parts.records import Check


@dataclass(frozen=True)
class MouldRules:
    """Sizes of a mould, mm: `wall` between cavity and outside where nothing is screwed, `rim` round
    the cavity where pieces meet, `play` between them, the printer's `line`; linear `shrinkage` of
    what is cast, and by how much of its thickness it may be strained as it is taken out."""

    wall: float = 5.0
    rim: float = 9.0
    play: float = 0.15
    line: float = 0.4
    shrinkage: float = 0.0
    strain: float = 0.1


@dataclass(frozen=True)
class Face:
    """A face in which a part meets others: its outward `normal` (3,), a point of it (3,) mm, its
    area, mm^2, and what is hollowed out of the part there, as a manifold3d solid.

    Where the part wraps round the face, the `notch` over it is filled, the point lies as high as
    the part goes, and the notch is of the core, too."""

    normal: Float
    origin: Float
    area: float
    core: Any
    notch: Any = None

    @property
    def height(self) -> float:
        """Of the face along its normal, mm."""
        return float(self.normal @ self.origin)


@dataclass(frozen=True)
class MouldPiece:
    """A piece of a mould in the part's rest frame, enlarged by the shrinkage: it is taken off along
    `opens` (3,); `down` (3,) points to the bed as it is printed."""

    name: str
    surface: Surface
    opens: Float
    down: Float


@dataclass(frozen=True)
class Mould:
    """The mould of a part: pieces in the order in which they are taken off; `up` (3,) points up as
    it is filled, through `pour` (3,) mm, air leaving through `vents` (v, 3) mm; the cavity's volume
    and that of the whole block, mm^3; the largest `strain` of the part as it is taken out, and
    where (3,) mm, where there is any."""

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
