"""The records of this folder: what parts must keep, the parts, and how they were found to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.arrays import Float
from ...core.mesh import Surface
from ..channels.channel_ends import Pockets
from ..channels.cord_channels import Channel
from .alignment_pins import Pin
from .division import Cut
from .engraving import Label, Seat
from .part_contacts import Contact

# A measurement of finished parts, as inspections make it and manifests keep it.


@dataclass(frozen=True)
class Check:
    """`value` as measured, and the `limit` that it keeps, rounding of facets allowed for: it is
    `at_least` so large, or else at most. Beyond it an inspection raises, or leaves a `note`: what a
    maker should be told; `at` is where."""

    name: str
    value: float
    limit: float
    unit: str
    at: str
    note: str = ""
    at_least: bool = False

    @property
    def holds(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class PartRules:
    """What the cord and the printing process ask for, mm: diameters of the `cord` and its
    `channel`, `clearance` of pins on the diameter, least `wall` to the skin;
    whether to `limit` cuts to what their cords need; the `pockets` at cords' ends, or None;
    how many `seats` for square tags of `tag` mm the skin gets; whether every cut goes `through`, as
    moulds of the parts ask for; `across`: cords of less mm between their ferrules are to be laid in
    one joint, for they cannot be held across an open one."""

    cord: float
    channel: float
    clearance: float
    wall: float
    limit: bool = False
    pockets: Pockets | None = None
    seats: int = 0
    tag: float = 10.0
    through: bool = False
    across: float = 0.0

    @property
    def inner_wall(self) -> float:
        """Least wall between two hollows in one part, which the glue closes later, mm."""
        return 2 * self.wall / 3


@dataclass(frozen=True)
class Part:
    """One printable piece in the rest frame: `surface` is what its STL holds, `volume` (mm^3) and
    `center` (3,) mm are those facets', `down` (3,) points to the bed as it is printed; `solid` is
    its TopoDS_Solid where the body is CAD."""

    name: str
    surface: Surface
    volume: float
    center: Float
    down: Float
    solid: Any = None


@dataclass(frozen=True)
class PartSet:
    """The parts, in the order of their numbers, and how they are held together. Cuts come in the
    order in which the body was divided: it is closed in the opposite one. `cut_out` is the volume
    of all that was removed, mm^3; `bare` are the parts without channels, sockets and numbers
    (manifold3d)."""

    parts: tuple[Part, ...]
    cuts: tuple[Cut, ...]
    contacts: tuple[Contact, ...]
    pins: tuple[Pin, ...]
    labels: tuple[Label, ...]
    seats: tuple[Seat, ...]
    channels: tuple[Channel, ...]
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    cut_out: float
    body_volume: float
    bare: tuple[Any, ...] = ()
