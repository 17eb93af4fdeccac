"""What a session says of itself, `session.json` in its folder: one format for sessions on the
specimen and for those before cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..errors import CalibrationError, CaptureError
from . import typed_json


@dataclass(frozen=True)
class Criterion:
    """A reading has settled when the means over the last two halves of `window` s differ by less
    than `tolerance` of the resistance, in every channel (or by less than three standard errors,
    where noise hides that much), not before `least` s; after `most` s it is taken as it is."""

    window: float = 6.0
    tolerance: float = 0.0005
    least: float = 8.0
    most: float = 90.0

    def __str__(self) -> str:
        half = self.window / 2
        return (
            f"settled = means over the last {half:g} s and the {half:g} s before differ by less"
            f" than {self.tolerance:.2%} (after {self.least:g} s or more; taken anyway after"
            f" {self.most:g} s)"
        )


FILE = "session.json"
#: Where capture sessions were described before; it is still read.
OLD_FILE = "session.toml"


@dataclass(frozen=True)
class CaptureManifest:
    """Of a session before cameras: the poses to show and for how many seconds; the channels' names
    and reference resistors, ohm; when it was begun (ISO 8601); which built device it is of (`unit`)
    and the hash of its cords' `layout`, empty where not known."""

    SCHEMA: ClassVar[int] = 1

    device: str
    begun: str
    channels: tuple[str, ...]
    reference: tuple[float, ...]
    steps: tuple[tuple[str, float], ...]
    unit: str = ""
    layout: str = ""


@dataclass(frozen=True)
class SpecimenRecord:
    """Name, length, thickness, and how far below its faces the outer cords lie, mm."""

    name: str
    length: float
    thickness: float
    offset: float


@dataclass(frozen=True)
class CalibrationManifest:
    """Of a session on the specimen: the steps (round, radius of the jig in mm or None for the flat
    one, face), the seed of their order, reference resistors (ohm), when a reading has settled, the
    read-out's rate (Hz) and conversions per sample (None: the read-out board's own)."""

    SCHEMA: ClassVar[int] = 1

    specimen: SpecimenRecord
    channels: tuple[str, ...]
    steps: tuple[tuple[int, float | None, str], ...]
    seed: int
    reference: tuple[float, ...]
    criterion: Criterion
    rate: int
    average: int | None
    begun: str


def manifest_path(folder: Path) -> Path | None:
    """The file in a session's folder; None where there is no session."""
    return next((p for p in (folder / FILE, folder / OLD_FILE) if p.exists()), None)


def load_capture(folder: Path) -> CaptureManifest:
    """Raises CaptureError."""
    path = manifest_path(folder) or folder / FILE
    remedy = "'defsense capture record' makes sessions"
    return typed_json.load(path, CaptureManifest, remedy, CaptureError)


def load_calibration(folder: Path) -> CalibrationManifest:
    """Raises CalibrationError."""
    remedy = "'defsense calibrate record' makes sessions"
    return typed_json.load(folder / FILE, CalibrationManifest, remedy, CalibrationError)
