"""Define the records of parts: the rules that they keep, the parts, and their checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core.arrays import Float
from ...core.device.regions import Shape
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..channels.channel_ends import Pockets
from ..channels.cord_channels import Channel
from ..kernels.cutting_tools import Tool
from .alignment_pins import Pin
from .channel_openings import ChannelOpening
from .division import Cut
from .engraving import Label, Seat
from .part_contacts import Contact


@dataclass(frozen=True)
class Check:
    """A measurement of finished parts, as checks make it and manifests store it.

    Attributes:
        name: What was measured.
        value: The value.
        limit: The limit, including the rounding of facets.
        unit: Unit of both.
        at: Where.
        note: What the maker should know, if anything.
        at_least: Whether the limit is the least allowed value; otherwise the largest.
        point: Point (3,) mm that the note is about, if any.
    """

    name: str
    value: float
    limit: float
    unit: str
    at: str
    note: str = ""
    at_least: bool = False
    point: Float | None = None

    @property
    def holds(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def require(self, needed: float, code: str, action: str = "", **data: Any) -> Check:
        """Return a measured wall or room, or raise FabricationError if it is too small.

        Args:
            needed: What is needed, without allowance for facets, mm.
            code: Code of the error.
            action: What the maker can do.
            **data: Data of the error.
        """
        if not self.holds:
            raise FabricationError(
                f"{self.value:.2f} mm near {self.at}, and {needed:.2f} mm is needed",
                code=code,
                where=self.name,
                action=action,
                **data,
            )
        return self


@dataclass(frozen=True)
class PartRules:
    """Rules of the cord and the printing process.

    Attributes:
        cord: Diameter of the cord, mm.
        channel: Diameter of its channel, mm.
        clearance: Clearance of pins on the diameter, mm.
        wall: Least wall to the skin, mm.
        limit: Whether cuts are limited to what their cords need.
        pockets: Pockets at the cords' ends, or None.
        seats: Number of seats for tags in the skin.
        tag: Side of a square tag, mm.
        through: Whether every cut goes right through, as moulds require.
        across: Length between the ferrules, mm, below which a cord is placed in one joint, since it
            cannot be held across an open one.
        kept: Regions that pins and seats avoid.
    """

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
    kept: tuple[Shape, ...] = ()

    @property
    def inner_wall(self) -> float:
        """Least wall between two hollows in one part, which the glue closes later, mm."""
        return 2 * self.wall / 3


@dataclass(frozen=True)
class Part:
    """One printable piece in the rest frame.

    Attributes:
        name: Its name.
        surface: Surface, as in its STL file.
        volume: Volume of the facets, mm^3.
        center: Center of mass (3,) of the facets, mm.
        down: Direction (3,) to the bed as it is printed.
        solid: TopoDS_Solid if the body is CAD, else None.
    """

    name: str
    surface: Surface
    volume: float
    center: Float
    down: Float
    solid: Any = None


def outward_planes(contacts: Sequence[Contact], index: int) -> list[tuple[Float, float]]:
    """Return the planes of a part's faces in contacts, largest face first.

    Each is an outward normal (3,) and the offset of the plane along it, mm.
    """
    faces = [c for c in contacts if index in (c.lower, c.upper)]
    faces.sort(key=lambda c: -c.area)
    normals = [c.plane.normal if c.lower == index else -c.plane.normal for c in faces]
    return [(n, float(n @ c.plane.origin)) for n, c in zip(normals, faces, strict=True)]


def outward_normals(contacts: Sequence[Contact], index: int) -> list[Float]:
    """Return the outward normals (3,) of a part's faces in contacts, largest first."""
    return [normal for normal, _ in outward_planes(contacts, index)]


@dataclass(frozen=True)
class PartSet:
    """The parts of a device and how they are held together.

    Attributes:
        parts: The parts, in the order of their numbers.
        cuts: Cuts in the order in which the body was divided; the device is closed in reverse
            order.
        contacts: Faces in which parts meet.
        pins: Pins between parts.
        labels: Engraved numbers.
        seats: Seats for tags.
        channels: Channels of the cords.
        checks: Measurements.
        warnings: What the maker should know, each with the point (3,) mm that it is about, or None
            if it is about the whole device.
        cut_out: Volume of all that was removed, mm^3.
        body_volume: Volume of the body, mm^3.
        bare: The parts without channels, sockets and numbers (manifold3d solids).
        carved: The parts without sockets and numbers, from which exact solids are checked.
        rules: Rules that the parts were made by.
        traces: Conductive traces that are printed in the only part, if any.
        openings: Stretches of channels that are open, or almost open, to faces of other cuts.
    """

    parts: tuple[Part, ...]
    cuts: tuple[Cut, ...]
    contacts: tuple[Contact, ...]
    pins: tuple[Pin, ...]
    labels: tuple[Label, ...]
    seats: tuple[Seat, ...]
    channels: tuple[Channel, ...]
    checks: tuple[Check, ...]
    warnings: Mapping[str, Float | None]
    cut_out: float
    body_volume: float
    rules: PartRules
    bare: tuple[Any, ...] = ()
    carved: tuple[Any, ...] = ()
    traces: tuple[Part, ...] = ()
    openings: tuple[ChannelOpening, ...] = ()

    def cut_faces(self, index: int) -> list[Float]:
        """Return the outward normals (3,) of the faces in which a part meets others, largest
        first.
        """
        return outward_normals(self.contacts, index)

    def cut_planes(self, index: int) -> list[tuple[Float, float]]:
        """Return the planes of the faces in which a part meets others, largest face first.

        Each is an outward normal (3,) and the offset of the plane along it, mm.
        """
        return outward_planes(self.contacts, index)

    def tools(self, index: int) -> list[Tool]:
        """Return the tools that cut one part alone: its sockets and its number."""
        out: list[Tool] = []
        for pin in self.pins:
            contact = self.contacts[pin.contact]
            if index in (contact.lower, contact.upper):
                out.append(pin.socket_in(upper=index == contact.upper))
        return out + [t for label in self.labels if label.part == index for t in label.tools]

    def with_warnings(self, notes: Mapping[str, Float | None]) -> PartSet:
        """Return the parts with further warnings; a warning keeps a point that it has."""
        warnings = dict(self.warnings)
        for text, point in notes.items():
            warnings[text] = warnings.get(text) if point is None else point
        return replace(self, warnings=warnings)
