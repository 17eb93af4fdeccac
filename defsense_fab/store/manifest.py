"""Results of the stage "fabricate": `parts/manifest.json`, and the parts' surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from ..core.arrays import Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import DefsenseError, StorageError
from ..core.mesh import Surface
from ..core.storage import typed_json
from ..geometry.parts.records import Check
from .casting import Casting as Casting
from .casting import MouldPieceRecord as MouldPieceRecord
from .casting import MouldRecord as MouldRecord
from .layout import Prediction
from .traces import TraceRecord as TraceRecord

FOLDER, MANIFEST = "parts", "parts/manifest.json"
#: Names of a cord's ends, in their order in the records.
END_NAMES = ("start", "end")


def part_label(part: str) -> str:
    """Return "1 (second from left)" for the part `1-second-from-left`."""
    number, _, place = part.partition("-")
    return f"{number} ({place.replace('-', ' ')})" if number.isdigit() and place else part


def load_part(path: Path) -> Surface:
    """Return the surface in an STL file, mm."""
    import trimesh  # slow, and not needed for the file alone

    mesh = trimesh.load_mesh(path)
    return Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def load_parts(folder: Path, manifest: Manifest) -> dict[str, Surface]:
    """Return the surfaces of a build's parts as assembled, mm, rest frame, by name.

    Raises:
        StorageError: A file is missing or damaged.
    """
    surfaces = {}
    for part in manifest.parts:
        path = folder / FOLDER / part.stl
        try:
            surfaces[part.name] = load_part(path)
        except (OSError, ValueError) as error:
            raise StorageError(
                f"cannot be read: {error}",
                code="file-unreadable",
                where=path,
                action=BUILD_AGAIN,
            ) from None
    return surfaces


@dataclass(frozen=True)
class Socket:
    """A hole for a pin.

    Attributes:
        center: Middle of the pin (3,), mm.
        axis: Direction of the pin (3,).
        diameter: Diameter, mm.
    """

    center: Float
    axis: Float
    diameter: float


@dataclass(frozen=True)
class PartRecord:
    """A printable part; its files are in the folder of the manifest.

    Attributes:
        name: Name, which starts with the number.
        number: Number engraved on the part.
        stl: STL file of the part as assembled.
        print: STL file of the part in print orientation.
        step: STEP file, for CAD bodies.
        volume: Volume, mm^3.
        bbox: Lowest and highest corner (2, 3) as assembled, mm.
        sockets: Holes for pins.
        step_volume: Volume of the STEP file's solid, mm^3.
        support_area: Area that needs supports as the part is printed, mm^2.
    """

    name: str
    number: int
    stl: str
    print: str
    step: str | None
    volume: float
    bbox: Float
    sockets: tuple[Socket, ...]
    step_volume: float | None = None
    support_area: float = 0.0


@dataclass(frozen=True)
class PinRecord:
    """A kind of loose pin.

    Attributes:
        name: Name.
        stl: STL file.
        count: Number of pins that are needed.
        diameter: Diameter, mm.
        length: Length, mm.
    """

    name: str
    stl: str
    count: int
    diameter: float
    length: float


@dataclass(frozen=True)
class Plate:
    """A file to print.

    Attributes:
        file: 3MF file.
        parts: Bounds (2, 3) of each piece on the bed, mm.
    """

    file: str
    parts: Mapping[str, Float]


@dataclass(frozen=True)
class WireRecord:
    """The wire of a cord's end.

    Attributes:
        leaves: Where it leaves the body: "mouth", "bend" or "bay".
        length: Its length in the body, mm.
        path: Its path (p, 3), mm, if it has one.
        drop: Vector (3,) down into the bay, mm, if it leads there.
        why: Why it has no path.
        stretches: Its stretches in joints, from its ferrule on.
        crosses: Joints that are closed only after it was inserted on both sides of them.
    """

    leaves: str
    length: float
    path: Float | None = None
    drop: Float | None = None
    why: str | None = None
    stretches: tuple[JointStretch, ...] = ()
    crosses: tuple[int, ...] = ()

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that it runs through, from its ferrule on, as indices of the assembly's steps."""
        return tuple(dict.fromkeys(s.joint for s in self.stretches))

    @property
    def line(self) -> Float | None:
        """The whole path in the body (p, 3), mm; None if it has none."""
        if self.path is None or self.drop is None:
            return self.path
        return np.concatenate([self.path, self.path[-1:] + self.drop])


@dataclass(frozen=True)
class CordEnd:
    """An end of a cord.

    Attributes:
        joint: "pocket" or "free".
        pocket: Depth of the pocket, mm.
        at: Where the channel opens (3,), mm.
        lead: Length of cord outside of the body, mm.
        wire: The wire that is crimped to it.
        why: Why there is no pocket.
        after: Joint after which the wire is crimped, outside of the channel's mouth, because the
            cord must slide until then; None: it is crimped before the cord is inserted.
    """

    joint: str
    pocket: float
    at: Float
    lead: float
    wire: WireRecord
    why: str | None = None
    after: int | None = None


@dataclass(frozen=True)
class JointStretch:
    """A stretch of a cord or a wire in one joint.

    Attributes:
        joint: Index of the assembly's step.
        start: Start of the stretch, mm along the channel or the wire's path.
        stop: End of the stretch, mm along the channel or the wire's path.
    """

    joint: int
    start: float
    stop: float


@dataclass(frozen=True)
class CutCord:
    """A cord to cut.

    Attributes:
        sensor: Name of the cord.
        cut_length: Length to cut, mm.
        slack: Extra length that is trimmed, mm.
        channel_length: Length of the channel, mm.
        between_ferrules: Length between the ferrules or wires in the device, mm.
        unstretched: The same length before the cord is inserted, mm.
        prestretch: Strain at rest; None for a bonded cord.
        sensing_length: Length that senses, mm.
        ends: Both ends.
        channel_diameter: Diameter of the channel, mm.
        resistance_before: Resistance before the cord is inserted, ohm.
        resistance: Resistance at rest in the device, ohm.
        range: Lowest and highest resistance in use, ohm.
        reference_resistor: Reference resistor of the divider, ohm.
        stretches: Its stretches in joints, from its start.
        drawn: Joints that are closed only after the cord was inserted on both sides of them: the
            joint, and the index of the stretch before which the cord crosses it.
    """

    sensor: str
    cut_length: float
    slack: float
    channel_length: float
    between_ferrules: float
    unstretched: float
    prestretch: float | None
    sensing_length: float
    ends: tuple[CordEnd, CordEnd]
    channel_diameter: float
    resistance_before: float
    resistance: float
    range: tuple[float, float]
    reference_resistor: float
    stretches: tuple[JointStretch, ...] = ()
    drawn: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class BillItem:
    """An item of the bill of materials.

    Attributes:
        item: What to buy.
        amount: How much of it.
        use: What it is for.
        good: Key of `[prices]` that has its price; empty if none has.
        quantity: How much of it in the unit of this price: kg, m, 100 cm^2 or pieces.
    """

    item: str
    amount: str
    use: str
    good: str = ""
    quantity: float = 0.0


@dataclass(frozen=True)
class JoinedPin:
    """A pin of a joint.

    Attributes:
        name: Name of its kind.
        center: Middle of the pin (3,), mm.
        socket: Diameter of the hole, mm.
        depth: Depth of the hole in each part, mm.
        between: Names of the two parts.
    """

    name: str
    center: Float
    socket: float
    depth: float
    between: tuple[str, str]


@dataclass(frozen=True)
class GluelessSpot:
    """A spot of a joint that must have no glue: a channel passes through its face, or is open or
    almost open to it.

    Attributes:
        cord: Name of the cord in the channel.
        at: Point (3,) of the channel that is nearest to the face, mm.
        reach: Distance from `at` that must stay free of glue, mm.
        is_crossing: Whether the channel passes through the joint.
    """

    cord: str
    at: Float
    reach: float
    is_crossing: bool = False


@dataclass(frozen=True)
class JoinStep:
    """A step of the assembly, which joins two groups of parts.

    Attributes:
        join: Names of the parts in each group.
        cords: Cords that are inserted in this joint.
        wires: Cords whose wires are inserted in this joint.
        opens: Direction (3,) in which the joint opens.
        pins: Pins of the joint.
        glueless: Spots of its faces that must have no glue.
    """

    join: tuple[tuple[str, ...], tuple[str, ...]]
    cords: tuple[str, ...]
    wires: tuple[str, ...]
    opens: Float
    pins: tuple[JoinedPin, ...]
    glueless: tuple[GluelessSpot, ...] = ()


@dataclass(frozen=True)
class TagSeat:
    """A flat place for a tag.

    Attributes:
        marker: Number of the marker.
        center: Middle (3,), mm.
        x_axis: Direction to the right in the tag's picture (3,).
        normal: Direction out of the body (3,).
        tag: Side of the tag, mm.
    """

    marker: int
    center: Float
    x_axis: Float
    normal: Float
    tag: float


@dataclass(frozen=True)
class Manifest:
    """The content of `parts/manifest.json`.

    Attributes:
        device: Name of the device.
        unit: Unit of lengths, "mm".
        parts: The parts, in the order of their numbers.
        pins: Kinds of loose pins.
        plates: Files to print.
        cords: The cut list.
        assembly_of_cords: "held" at their ends or "bonded" into their grooves.
        bill: Bill of materials.
        assembly: Steps of the assembly, in order.
        marker_seats: Flat places for tags.
        checks: Measurements of the parts.
        prediction: Errors predicted for the cords as they are built in.
        removed_volume: Volume removed from the body, mm^3.
        body_volume: Volume of the body, mm^3.
        warnings: What is doubtful about the parts.
        advice: How to print the parts, as sentences.
        copies: Number of devices on the plates.
        least_plates: Smallest possible number of plates.
        moulds: Moulds, for cast parts: then these are printed, and a part's `print` is its `stl`.
        casting: The silicone, for cast parts.
        places: Point (3,) mm that a warning is about, by the warning; none for the whole device.
        traces: Printed traces, in the order of `cords`, which has their resistances.
    """

    SCHEMA: ClassVar[int] = 6

    device: str
    unit: str
    parts: tuple[PartRecord, ...]
    pins: tuple[PinRecord, ...]
    plates: tuple[Plate, ...]
    cords: tuple[CutCord, ...]
    assembly_of_cords: str
    bill: tuple[BillItem, ...]
    assembly: tuple[JoinStep, ...]
    marker_seats: tuple[TagSeat, ...]
    checks: tuple[Check, ...]
    prediction: Prediction | None
    removed_volume: float
    body_volume: float
    warnings: tuple[str, ...]
    advice: tuple[str, ...] = ()
    copies: int = 1
    least_plates: int = 1
    moulds: tuple[MouldRecord, ...] = ()
    casting: Casting | None = None
    places: Mapping[str, Float] = field(default_factory=dict)
    traces: tuple[TraceRecord, ...] = ()


def save_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest of a build. Raises StorageError."""
    typed_json.save(folder / MANIFEST, manifest)


def load_manifest(folder: Path, error: type[DefsenseError] = StorageError) -> Manifest:
    """Return the manifest of a build. Raises `error`."""
    return typed_json.load(folder / MANIFEST, Manifest, BUILD_AGAIN, error)
