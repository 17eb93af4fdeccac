"""Options of a new device, with the units and poses that they name.

This module has no heavy imports, since `defsense new --help` and completion load it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from ...core.device.materials import find_process_problem
from ...core.errors import DeviceError
from ...core.schema.options import check_options
from ...core.storage.package_data import read_rows
from ..study.options import MAX_CORDS as MAX_CORDS

#: Devices of the package that users can start from, and their descriptions.
EXAMPLES = {
    "joystick": "Two cords sense where a slender stick is bent to; two hours of printing.",
    "bar": "Three cords sense bends up and down, and twists. A script makes the body.",
    "twist-bar": "One cord distinguishes left and right twists.",
    "cube": "Pressed, sheared and twisted; planes of three cords cross inside.",
    "blob": "An organic body from a mesh, whose cords are proposed.",
}
DEFAULT_PROCESS, DEFAULT_CORD = "fdm-tpu", "rubber-2mm"
#: Smallest number of cords unless another is given.
MIN_DEFAULT_CORDS = 3
#: Pose that stands for all poses that the natural modes give.
MODES = "modes"
#: Poses of one end against the other, and their descriptions.
END_POSES = {
    "bend": "the tip turns to where the body is thinnest",
    "bend_side": "the tip turns at right angles to that",
    "twist": "the tip turns about the body's length",
    "pull": "the tip is drawn away from the base",
}
#: Units of lengths, and mm in each; units that programs write more often come first.
UNITS = {"mm": 1.0, "inch": 25.4, "cm": 10.0, "m": 1000.0, "um": 0.001}
#: The units in words.
UNIT_WORDS = {
    "mm": "millimetres",
    "inch": "inches",
    "cm": "centimetres",
    "m": "metres",
    "um": "micrometres",
}
#: Tables of the package that options name a row of.
_TABLES = {"cord": "cords.csv", "process": "printers.csv", "material": "materials.csv"}


@dataclass(frozen=True)
class NewOptions:
    """Choices for a new device.

    Attributes:
        body: Set the body: joystick, bar, twist-bar, cube, blob, or a file (script .py, STEP, or
            mesh).
        units: Set the unit of a mesh's lengths: mm, cm, m, inch or um (default: guessed from the
            size).
        size: Set the longest side of a mesh in mm, for a file of unknown unit (in place of units).
        poses: Set the poses: modes (from the body's natural modes), or some of bend, bend_side,
            twist and pull, separated by commas (default: fitted to the body).
        cord: Set the cord; see defsense list cords (default: rubber-2mm, or that of the example).
        cords: Set the number of cords to place (default: one per pose, at least 3).
        name: Set the name of the device (default: name of the folder).
        process: Set the fabrication process; see defsense list printers (default: fdm-tpu, or one
            that makes the material).
        material: Set the material; see defsense list materials (default: that of the process).
        edge_length: Set the edge length of the mesh in mm (default: fitted to the body).

    Raises:
        DeviceError: A value is invalid (`unknown-unit`, `unknown-pose`, `unknown-cord`,
            `unknown-process`, `unknown-material`, `name-invalid`, `out-of-range`), the process does
            not make the material (`material-not-for-process`), or both units and size are given
            (`options-conflict`).
    """

    body: str | None = None
    units: str | None = None
    size: Annotated[float, Meta(ge=1, le=10_000)] | None = None
    poses: tuple[str, ...] = ()
    cord: str | None = None
    cords: Annotated[int, Meta(ge=1, le=MAX_CORDS)] | None = None
    name: str | None = None
    process: str | None = None
    material: str | None = None
    edge_length: Annotated[float, Meta(ge=0)] | None = None

    def __post_init__(self) -> None:
        check_options(self)
        if self.name is not None and not (self.name.strip() and self.name.isprintable()):
            raise DeviceError(
                f"{self.name!r} is not a line of printable text",
                code="name-invalid",
                where="name",
                action="Give one line of letters",
            )
        check_unit_or_size(self.units, self.size)
        if self.poses:
            check_poses(self.poses)
        for kind in _TABLES:
            row = getattr(self, kind)
            if row is not None:
                check_row(kind, row)
        if self.material is not None and self.process is not None:
            problem = find_process_problem(self.material, self.process)
            if problem is not None:
                raise DeviceError(
                    problem.text,
                    code=problem.code,
                    where="material",
                    action=problem.action,
                    **problem.data,
                )

    def check_example(self) -> None:
        """Check that no option is given whose value an example of the package has already.

        Raises:
            DeviceError: Such an option is given (`options-conflict`).
        """
        for option in ("units", "size", "poses", "cords", "process", "material", "edge_length"):
            if getattr(self, option) not in (None, ()):
                raise DeviceError(
                    f"{self.body} has its own value",
                    code="options-conflict",
                    where=option,
                    action="Omit the option, and change device.toml afterwards",
                    option=option,
                )


def check_row(kind: str, name: str) -> str:
    """Return the name of a row of a table of the package, after checking that it exists.

    Args:
        kind: `cord`, `process` or `material`.
        name: Name of the row.

    Raises:
        DeviceError: There is no such row (`unknown-cord`, `unknown-process`, `unknown-material`).
    """
    rows = read_rows(_TABLES[kind])
    if name not in rows:
        raise DeviceError(
            f"{name!r} is not a {kind}",
            code=f"unknown-{kind}",
            where=kind,
            action=f"Choose one of {', '.join(rows)}",
            value=name,
        )
    return name


def check_poses(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of poses after checking them.

    Raises:
        DeviceError: They are neither only MODES, nor different names of END_POSES (`unknown-pose`).
    """
    is_valid = names == (MODES,) or (names and set(names) <= set(END_POSES))
    if not is_valid or len(set(names)) < len(names):
        raise DeviceError(
            f"{','.join(names)!r} are not valid poses",
            code="unknown-pose",
            where="poses",
            action=f"Use {MODES}, or some of {', '.join(END_POSES)} with commas, each once",
            poses=names,
        )
    return names


def check_unit_or_size(units: str | None, size: float | None) -> None:
    """Check the unit of a mesh, and that not both a unit and a size are given.

    Raises:
        DeviceError: There is no such unit (`unknown-unit`), or both are given (`options-conflict`).
    """
    if units is not None:
        parse_unit(units)
        if size is not None:
            raise DeviceError(
                "units are given too, and either determines the other",
                code="options-conflict",
                where="size",
                action="Give one of them",
                option="size",
            )


def parse_unit(text: str) -> str:
    """Return the unit that a word means, such as "inches".

    Raises:
        DeviceError: There is no such unit (`unknown-unit`).
    """
    word = text.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")
    synonyms = {"in": "inch", '"': "inch"} | {words: unit for unit, words in UNIT_WORDS.items()}
    unit = synonyms.get(word, word)
    if unit not in UNITS:
        raise DeviceError(
            f"{text!r} is not a unit",
            code="unknown-unit",
            where="units",
            action=f"Use one of {', '.join(UNITS)}",
            unit=text,
        )
    return unit
