"""What the fabricate stage leaves beside the parts: `parts/manifest.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import trimesh

from ..core.arrays import Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import DefsenseError, StorageError
from ..core.mesh import Surface
from ..core.prediction import Prediction
from ..core.storage import typed_json
from ..geometry.parts.records import Check

# Finished parts, read back from their files.


def load_part(path: Path) -> Surface:
    """The surface of an STL."""
    mesh = trimesh.load_mesh(path)
    return Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def load_parts(folder: Path, manifest: Manifest) -> dict[str, Surface]:
    """The parts of a build's `folder` by name, where they belong in the device. Raises
    StorageError."""
    out = {}
    for part in manifest.parts:
        path = folder / FOLDER / part.stl
        try:
            out[part.name] = load_part(path)
        except (OSError, ValueError) as error:
            raise StorageError(f"{path}: cannot be read: {error}; {BUILD_AGAIN}") from None
    return out


FOLDER, MANIFEST = "parts", "parts/manifest.json"


@dataclass(frozen=True)
class Socket:
    """A hole for a pin: middle (3,) mm, axis (3,), diameter mm."""

    center: Float
    axis: Float
    diameter: float


@dataclass(frozen=True)
class PartRecord:
    """A printable part: its files beside the manifest (`stl` where it belongs in the device,
    `print` as it lies on the bed, `step` of CAD bodies), volume mm^3, bounds (2, 3) mm."""

    name: str
    number: int
    stl: str
    print: str
    step: str | None
    volume: float
    bbox: Float
    sockets: tuple[Socket, ...]
    step_volume: float | None = None


@dataclass(frozen=True)
class PinRecord:
    """A kind of loose pin and how many are needed; diameter and length in mm."""

    name: str
    stl: str
    count: int
    diameter: float
    length: float


@dataclass(frozen=True)
class Plate:
    """A file to print, and the bounds (2, 3) mm of each part on it."""

    file: str
    parts: Mapping[str, Float]


@dataclass(frozen=True)
class WireRecord:
    """Where a wire leaves the body ("mouth", "bend", "bay", ...), its length in the body (mm); its
    path (p, 3) mm and the way (3,) mm down into the bay, where it has them; why it has none; the
    joints (indices of the assembly's steps) that it lies in, from its ferrule on, and those that it
    crosses, which are closed only after it was laid on both sides of them."""

    leaves: str
    length: float
    path: Float | None = None
    drop: Float | None = None
    why: str | None = None
    joints: tuple[int, ...] = ()
    crosses: tuple[int, ...] = ()

    @property
    def line(self) -> Float | None:
        """All of it in the body, (p, 3) mm, if it has a path."""
        if self.path is None or self.drop is None:
            return self.path
        return np.concatenate([self.path, self.path[-1:] + self.drop])


@dataclass(frozen=True)
class CordEnd:
    """An end of a cord: a joint in a "pocket" of so many mm or "free", behind `lead` mm outside;
    where its channel opens (3,) mm; why it is not in a pocket. `after`: the joint (index of the
    assembly's step) after which its wire is crimped outside of its mouth, for until then the cord
    must slide; None: it is crimped before the cord is laid."""

    joint: str
    pocket: float
    at: Float
    lead: float
    wire: WireRecord
    why: str | None = None
    after: int | None = None


@dataclass(frozen=True)
class CordStretch:
    """From `start` to `stop`, mm along its channel from mouth to mouth, a cord lies in a joint
    (index of the assembly's step)."""

    joint: int
    start: float
    stop: float


@dataclass(frozen=True)
class CutCord:
    """A cord to cut: lengths mm, of the channel, between the ferrules (or wires) as it lies and as
    it is before it is laid, and of the stretch that senses; by how much of its length it is
    stretched as it is laid (null: bonded); resistance before it is laid, at rest in the device, its
    range in use and the reference resistor, ohm; its `stretches` in joints, from its start on; the
    joints that draw it together only after it was laid on both sides of them (`drawn`: the joint,
    and the stretch before which it passes there)."""

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
    stretches: tuple[CordStretch, ...] = ()
    drawn: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class BillItem:
    """What to buy, how much, and what for."""

    item: str
    amount: str
    use: str


@dataclass(frozen=True)
class JoinedPin:
    """A pin of a joint: the name of its kind, middle (3,) mm, diameter of the socket and its depth
    in each part (mm), the two parts."""

    name: str
    center: Float
    socket: float
    depth: float
    between: tuple[str, str]


@dataclass(frozen=True)
class JoinStep:
    """A step in which two groups of parts are joined: cords and wires laid in it, the direction
    (3,) in which the joint opens, its pins."""

    join: tuple[tuple[str, ...], tuple[str, ...]]
    cords: tuple[str, ...]
    wires: tuple[str, ...]
    opens: Float
    pins: tuple[JoinedPin, ...]


@dataclass(frozen=True)
class TagSeat:
    """A flat for a camera tag: middle (3,) mm, directions (3,), side of the piece, mm."""

    marker: int
    center: Float
    x_axis: Float
    normal: Float
    tag: float


@dataclass(frozen=True)
class MouldPieceRecord:
    """A printed piece of a mould: its files beside the manifest (`stl` around the part in the
    device's frame, `print` as it lies on the bed), the direction (3,) in which it comes off, volume
    mm^3."""

    name: str
    stl: str
    print: str
    opens: Float
    volume: float


@dataclass(frozen=True)
class MouldRecord:
    """The mould of a part: its pieces in the order in which they come off; `up` (3,) points up as
    it is filled through `pour` (3,) mm, air leaving by `vents` (v, 3) mm; volumes of the cavity and
    of the whole block, mm^3; by how much of its thickness the part is strained as it is taken out,
    and where (3,) mm."""

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
    """What the silicone of all moulds and copies comes to: what the cavities hold and what is
    mixed, mm^3; grams of A and B; minutes that it can be poured, hours until it is taken out, where
    they are known; `steps`, sentences in the order of the work."""

    silicone: str
    shrinkage: float
    volume: float
    mixed: float
    mass_a: float
    mass_b: float
    pot_life: float | None
    cure: float | None
    steps: tuple[str, ...]


@dataclass(frozen=True)
class Manifest:
    """`parts/manifest.json`; `prediction` is that for the cords as they are built in, `held` at
    their ends or `bonded` into their grooves (`assembly_of_cords`); volumes mm^3.

    `advice` are sentences on how to print; `copies` of the device lie on the plates, of which
    there are at least `least_plates`, however the rectangles around them are laid. Of cast parts,
    `moulds` and `casting`: what is printed are the moulds then, and a part's `print` is its
    `stl`."""

    SCHEMA: ClassVar[int] = 4

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


def save_manifest(folder: Path, manifest: Manifest) -> None:
    """Into a build's folder. Raises StorageError."""
    typed_json.save(folder / MANIFEST, manifest)


def load_manifest(folder: Path, error: type[DefsenseError] = StorageError) -> Manifest:
    """From a build's folder. Raises `error`."""
    return typed_json.load(folder / MANIFEST, Manifest, BUILD_AGAIN, error)
