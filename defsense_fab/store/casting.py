"""The moulds and the silicone of cast parts, as the manifest has them."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.arrays import Float


@dataclass(frozen=True)
class MouldPieceRecord:
    """A printed piece of a mould.

    Attributes:
        name: Name.
        stl: STL file in the frame of the device.
        print: STL file in print orientation.
        opens: Direction (3,) in which it comes off.
        volume: Volume, mm^3.
    """

    name: str
    stl: str
    print: str
    opens: Float
    volume: float


@dataclass(frozen=True)
class MouldRecord:
    """The mould of a part.

    Attributes:
        part: Name of the part.
        pieces: Pieces in the order in which they come off.
        up: Direction (3,) that points up while the mould is filled.
        pour: Where it is filled (3,), mm.
        vents: Where air leaves (v, 3), mm.
        cavity: Volume of the cavity, mm^3.
        block: Volume of the whole block, mm^3.
        strain: Strain of the part while it is taken out, relative to its thickness.
        strained_at: Where this strain is (3,), mm.
    """

    part: str
    pieces: tuple[MouldPieceRecord, ...]
    up: Float
    pour: Float
    vents: Float
    cavity: float
    block: float
    strain: float
    strained_at: Float | None = None


@dataclass(frozen=True)
class Casting:
    """The silicone for all moulds and copies.

    Attributes:
        silicone: Name of the silicone.
        shrinkage: Linear shrinkage.
        volume: Volume of all cavities, mm^3.
        mixed: Volume to mix, mm^3.
        mass_a: Mass of component A, g.
        mass_b: Mass of component B, g.
        pot_life: Time to pour it, minutes, if known.
        cure: Time until it is taken out, hours, if known.
        steps: The work as sentences, in order.
    """

    silicone: str
    shrinkage: float
    volume: float
    mixed: float
    mass_a: float
    mass_b: float
    pot_life: float | None
    cure: float | None
    steps: tuple[str, ...]
