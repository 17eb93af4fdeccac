"""Files of bodies as users give them: their surface, the unit of their lengths, and repairs."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import BodySpec
from ...core.errors import BodyError, DeviceError
from ...core.mesh import Surface
from ...core.storage.file_names import safe_name
from ...core.storage.files import storage_errors
from ...geometry.bodies.body import SIZE_RANGE_MM, load_body, read_body_file
from ...geometry.bodies.mesh_files import FORMAT_NAMES as FORMAT_NAMES
from ...geometry.bodies.mesh_files import detect_format
from .body_ends import estimate_thickness
from .body_scripts import read_parameters
from .options import UNIT_WORDS, UNITS, parse_unit

EDGES_PER_THICKNESS, EDGES_PER_LENGTH, MAX_DEFAULT_TETS = 5, 10, 60_000  # of the default mesh
#: Tets in the volume of a cube whose side is their edge length.
TETS_PER_CUBE = 8.5
#: Lengths of soft devices along their longest axis, mm; shorter ones have no room for a cord.
USUAL_LENGTH_MM, POSSIBLE_LENGTH_MM = (40.0, 600.0), (15.0, 1500.0)
SCRIPT = ".py"
_MAX_SUFFIX_CHARACTERS = 8
_MM = re.compile(r"\bmm(?=3?\b)")


@dataclass(frozen=True)
class BodyFile:
    """A file of a body.

    Attributes:
        content: Content of the file.
        name: A safe file name without suffix.
        suffix: Suffix that fits the content.
        surface: The surface, in mm if the file is in the unit of its format.
        unit: The most likely unit of the file.
        is_doubtful: Whether that unit is doubtful.
        repair_notes: Repairs of the surface, in words.
        parameters: Defaults of the parameters of a script.
        others: Other files that a script needs, by their path relative to it.
        format_unit: Unit of the file's format.
        factor: Factor from the size in that unit to a requested size.
    """

    content: bytes
    name: str
    suffix: str
    surface: Surface
    unit: str
    is_doubtful: bool
    repair_notes: tuple[str, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, bytes] = field(default_factory=dict)
    format_unit: str = "mm"
    factor: float = 1.0

    @property
    def key(self) -> str:
        """Its key in [body] of device.toml: `step`, `script` or `mesh`."""
        return {".step": "step", SCRIPT: "script"}.get(self.suffix, "mesh")

    def scale(self, unit: str) -> float:
        """Return the scale in [body] of device.toml if the file is in a unit."""
        return self.factor * UNITS[unit] / UNITS[self.format_unit]

    def size(self, unit: str) -> Float:
        """Return the extents (3,) mm if the file is in a unit."""
        return np.asarray(np.ptp(self.surface.vertices, axis=0) * self.scale(unit))

    def format_size(self, unit: str) -> str:
        """Return the extents as text, if the file is in a unit."""
        return " x ".join(f"{x:,.4g}" if x < 1e4 else f"{x:,.0f}" for x in self.size(unit)) + " mm"

    def repairs(self, unit: str) -> tuple[str, ...]:
        """Return the repairs in words, with lengths in the unit in which the file is."""
        if self.scale(unit) == 1:
            return self.repair_notes
        is_in_unit = self.format_unit == "mm" and self.factor == 1
        word = unit if is_in_unit else "of the file's lengths"
        return tuple(_MM.sub(word, line) for line in self.repair_notes)

    def table(self, file: str, unit: str) -> dict[str, Any]:
        """Return the table `[body]` of device.toml.

        Args:
            file: Name of the file next to device.toml.
            unit: Unit of the file.
        """
        body: dict[str, Any] = {self.key: file}
        if self.parameters:
            body["parameters"] = dict(self.parameters)
        if self.scale(unit) != 1:
            body["scale"] = float(f"{self.scale(unit):.12g}")
        if any(line.startswith("filled ") for line in self.repair_notes):
            body["fill_cavities"] = True
        return body

    def in_mm(self, unit: str) -> Surface:
        """Return the surface in mm if the file is in a unit."""
        return Surface(self.surface.vertices * self.scale(unit), self.surface.faces)

    def edge_length(self, unit: str) -> float:
        """Return the default edge length, mm: a fifth of the thickness, more for large bodies."""
        surface = self.in_mm(unit)
        edge = min(
            estimate_thickness(surface) / EDGES_PER_THICKNESS,
            self.size(unit).max() / EDGES_PER_LENGTH,
        )
        return float(
            f"{max(edge, float(np.cbrt(TETS_PER_CUBE * surface.volume / MAX_DEFAULT_TETS))):.2g}"
        )


def notable_repairs(repairs: Iterable[str]) -> list[str]:
    """Return the repairs without merged vertices, which every STL file has."""
    return [line for line in repairs if not line.startswith("merged")]


def load_body_file(path: Path) -> BodyFile:
    """Load a file of a body. Scripts are run.

    Raises:
        BodyError: There is no such file (`file-not-found`), or it is not a body.
        StorageError: The file cannot be read.
    """
    if path.is_dir():
        raise BodyError(
            "is a folder", code="file-is-folder", where=path, action="Give the file of a body"
        )
    if not path.exists():
        raise BodyError(
            "does not exist",
            code="file-not-found",
            where=path,
            action="Check its name and folder",
        )
    with storage_errors(path):
        content = path.read_bytes()
    if not content:
        raise BodyError("is empty", code="file-empty", where=path, action="Export the body again")
    if path.suffix.lower() == SCRIPT:
        return _load_script(path, content)
    return load_body_content(path.name, content)


def load_body_content(name: str, content: bytes) -> BodyFile:
    """Load a body from the content of a STEP or mesh file.

    Args:
        name: Name of the file; its suffix is not used.
        content: Content of the file.

    Raises:
        BodyError: The content is neither STEP nor a mesh (`unknown-format`), or not a body.
    """
    suffix = detect_format(content)
    shown = safe_name(name)
    if suffix is None:
        raise BodyError(
            "its content is neither STEP nor a mesh",
            code="unknown-format",
            where=shown + _shown_suffix(name),
            action=f"Export the body as STEP, {FORMAT_NAMES}",
        )
    with tempfile.TemporaryDirectory(prefix="defsense-") as folder:
        path = Path(folder) / f"{shown}{suffix}"
        path.write_bytes(content)
        body = read_body_file(path)
    longest = float(np.ptp(body.surface.vertices, axis=0).max())
    format_unit = next((name for name, mm in UNITS.items() if mm == body.unit), "mm")
    unit, is_doubtful = ("mm", False)
    if suffix != ".step":
        unit, is_doubtful = guess_unit(longest / UNITS[format_unit], format_unit)
    return BodyFile(
        content,
        shown,
        suffix,
        body.surface,
        unit,
        is_doubtful,
        body.repairs,
        format_unit=format_unit,
    )


def _shown_suffix(name: str) -> str:
    """Return the suffix of a file of unknown origin for messages."""
    _, stop, suffix = name.rpartition(".")
    return stop + re.sub(r"\W+", "", suffix)[:_MAX_SUFFIX_CHARACTERS]


def _load_script(path: Path, content: bytes) -> BodyFile:
    path = path.absolute()
    body = load_body(BodySpec("script", path, {}))
    used = [s.path for s in body.sources if s.content and s.path.is_relative_to(path.parent)]
    with storage_errors(path):
        others = {p.relative_to(path.parent).as_posix(): p.read_bytes() for p in used if p != path}
    defaults = {
        p.name: p.default
        for p in read_parameters(path, {})
        if isinstance(p.default, str | int | float)
    }
    return BodyFile(
        content,
        safe_name(path.name),
        SCRIPT,
        body.surface,
        "mm",
        False,
        body.repairs,
        defaults,
        others,
    )


def guess_unit(longest: float, format_unit: str = "mm") -> tuple[str, bool]:
    """Guess the unit of a file from the size of its body.

    Args:
        longest: Longest extent of the body, in the numbers of the file.
        format_unit: Unit of the file's format; mm if the format has none, as most files are in mm.

    Returns:
        The unit in which the body has the size of a device, and whether that is doubtful. Only the
        unit of the format is not doubtful.
    """
    for low, high in (USUAL_LENGTH_MM, POSSIBLE_LENGTH_MM):
        for unit in (format_unit, *UNITS):
            if low <= longest * UNITS[unit] <= high:
                is_doubtful = unit != format_unit or (low, high) != USUAL_LENGTH_MM
                return unit, is_doubtful
    return format_unit, True


def describe_unusual_size(size: Float) -> str:
    """Return a note on extents (3,) mm that soft devices do not have; empty for others."""
    longest = float(size.max())
    if USUAL_LENGTH_MM[0] <= longest <= USUAL_LENGTH_MM[1]:
        return ""
    kind = "long" if longest > USUAL_LENGTH_MM[1] else "small"
    return f"{longest:,.4g} mm is unusually {kind} for a soft device; check the unit of the file"


def scale_to_size(body: BodyFile, size: float | None) -> BodyFile:
    """Return a mesh scaled so that its longest side has a size, in mm.

    Args:
        body: The file.
        size: The size, mm; None to leave it as it is.

    Raises:
        DeviceError: The file is a STEP file or a script (`size-not-applicable`).
    """
    if size is None:
        return body
    if body.key != "mesh":
        raise DeviceError(
            f"{size:g} mm is given, but a STEP file contains its unit, and a script returns mm",
            code="size-not-applicable",
            where="size",
            action="Leave it out, and scale the body in the program that made it",
            size=size,
        )
    factor = size / float(np.ptp(body.surface.vertices, axis=0).max())
    return replace(body, unit=body.format_unit, is_doubtful=False, factor=factor)


def choose_unit(body: BodyFile, units: str | None) -> str:
    """Return the unit of a file.

    Args:
        body: The file.
        units: The unit; None to guess it.

    Raises:
        DeviceError: There is no such unit (`unknown-unit`), the format of the file determines
            another one (`unit-not-applicable`), or the guess is doubtful (`unit-doubtful`).
        BodyError: No device has that size (`body-size-impossible`).
    """
    unit = body.unit
    if units is not None:
        unit = parse_unit(units)
        if body.key != "mesh" and unit != "mm":
            raise DeviceError(
                f"{units} is given, but a STEP file contains its unit, and a script returns mm",
                code="unit-not-applicable",
                where="units",
                action="Leave it out",
                unit=unit,
            )
    elif body.is_doubtful:
        raise _doubtful_unit(body)
    check_unit(body, unit)
    return unit


def _doubtful_unit(body: BodyFile) -> DeviceError:
    unit, format_unit = body.unit, body.format_unit
    if unit == format_unit:
        problem = (
            f"in {UNIT_WORDS[unit]} the body is {body.format_size(unit)}, which is unusual for a"
            " soft device"
        )
        action = f"Give units {unit} if that is right, another unit, or the longest side in mm"
    else:
        problem = (
            f"in {UNIT_WORDS[format_unit]} the body would be {body.format_size(format_unit)};"
            f" in {UNIT_WORDS[unit]} it is {body.format_size(unit)}"
        )
        action = f"Give units {unit}, another unit, or the longest side in mm"
    return DeviceError(problem, code="unit-doubtful", where="units", action=action, unit=unit)


def check_unit(body: BodyFile, unit: str) -> None:
    """Check that the body has the size of a device if its file is in a unit.

    Raises:
        BodyError: No device has that size (`body-size-impossible`).
    """
    size = float(np.linalg.norm(body.size(unit)))
    if not SIZE_RANGE_MM[0] <= size <= SIZE_RANGE_MM[1]:
        action = f"Choose another unit than {UNIT_WORDS[unit]}"
        if body.key != "mesh":
            action = "Export it again in its true unit"
        elif body.factor != 1:
            action = "Choose another size"
        raise BodyError(
            f"would be {size:,.3f} mm across",
            code="body-size-impossible",
            where=body.name,
            action=action,
            size=size,
        )
