"""`session.json`: the description of a recording session, on a specimen or before cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..errors import CalibrationError, CaptureError
from . import typed_json

FILE = "session.json"


@dataclass(frozen=True)
class Criterion:
    """When a reading has settled.

    The means over the last two halves of a window differ by less than a tolerance in every channel,
    or by less than three standard errors where noise hides that much.

    Attributes:
        window: Length of the window, s.
        tolerance: Relative tolerance of the resistance.
        least: Shortest time of a reading, s.
        most: Time after which a reading is taken as it is, s.
    """

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


@dataclass(frozen=True)
class CaptureManifest:
    """Description of a session before cameras.

    Attributes:
        device: Name of the device.
        begun: Start of the session (ISO 8601).
        channels: Names of the channels (c,).
        reference: Reference resistors (c,), ohm.
        steps: Poses to show, and for how long, s.
        unit: Name of the built device; empty where it is not known.
        layout: Hash of the layout of its cords; empty where it is not known.
    """

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
    """A bending specimen.

    Attributes:
        name: Name of the specimen.
        length: Length, mm.
        thickness: Thickness, mm.
        offset: Distance of the outer cords from the faces, mm.
    """

    name: str
    length: float
    thickness: float
    offset: float


@dataclass(frozen=True)
class CalibrationManifest:
    """Description of a session on a specimen.

    Attributes:
        specimen: The specimen.
        channels: Names of the channels (c,).
        steps: Round, radius of the jig (mm, None for the flat jig) and face of each step.
        seed: Seed of the order of the steps.
        reference: Reference resistors (c,), ohm.
        criterion: When a reading has settled.
        rate: Samples per second, Hz.
        average: Conversions per sample; None for the read-out board's own number.
        begun: Start of the session (ISO 8601).
    """

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
    """Return the description in a session's folder; None where there is no session."""
    path = folder / FILE
    return path if path.exists() else None


def load_capture(folder: Path) -> CaptureManifest:
    """Read the description of a session before cameras.

    Raises:
        CaptureError: The file cannot be read or is invalid.
    """
    action = "Create sessions with 'defsense capture record'"
    return typed_json.load(folder / FILE, CaptureManifest, action, CaptureError)


def load_calibration(folder: Path) -> CalibrationManifest:
    """Read the description of a session on a specimen.

    Raises:
        CalibrationError: The file cannot be read or is invalid.
    """
    action = "Create sessions with 'defsense calibrate record'"
    return typed_json.load(folder / FILE, CalibrationManifest, action, CalibrationError)
