"""Find the glue for the joints of a device: a row of `data/glues.csv`."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import DeviceError
from ..storage.package_data import read_rows
from .device import Device
from .materials import default_material

_GLUES, _MATERIALS = "glues.csv", "materials.csv"
_SLOW_GLUE = "polyurethane-sealant"
_CAST_GLUE, _PRINT_GLUE = "silicone-sealant", "toughened-cyanoacrylate"
#: Open time that bonded cords need: they are glued along their grooves before the joint closes.
_BONDED_OPEN_MIN = 10.0


@dataclass(frozen=True)
class Glue:
    """A kind of glue.

    Attributes:
        name: Name of the row.
        kind: Kind of glue, in words.
        example: A product of this kind.
        preparation: How to prepare the faces, as a clause in the imperative.
        application: How to apply it, as a noun phrase.
        open_minutes: Time in which faces can be joined and moved, min.
        press_hours: Time for which a joint is pressed together, h.
        cure_hours: Time until full strength at room temperature, h.
        source: Source of the values.
    """

    name: str
    kind: str
    example: str
    preparation: str
    application: str
    open_minutes: float
    press_hours: float
    cure_hours: float
    source: str


def find_glue(device: Device) -> Glue:
    """Return the glue for a device's material and assembly.

    A custom material is glued like the default material of its process. Bonded cords need a glue
    with a long open time.
    """
    name = _glue_of_material(device)
    glue = _read(name)
    if device.fabrication.assembly == "bonded" and glue.open_minutes < _BONDED_OPEN_MIN:
        return _read(_SLOW_GLUE)
    return glue


def find_slow_glue(device: Device) -> Glue | None:
    """Return the glue for faces on which the device's glue sets too fast; None for a slow glue."""
    is_slow = find_glue(device).open_minutes >= _BONDED_OPEN_MIN
    return None if is_slow else _read(_SLOW_GLUE)


def _glue_of_material(device: Device) -> str:
    materials = read_rows(_MATERIALS)
    row = materials.get(device.material.name)
    if row is None:
        try:
            row = materials[default_material(device.fabrication.process)]
        except DeviceError:  # a user-defined process
            return _CAST_GLUE if device.fabrication.kind == "cast" else _PRINT_GLUE
    return row["glue"]


def _read(name: str) -> Glue:
    row = read_rows(_GLUES)[name]
    return Glue(
        name,
        row["kind"],
        row["example"],
        row["preparation"],
        row["application"],
        float(row["open_minutes"]),
        float(row["press_hours"]),
        float(row["cure_hours"]),
        row["source"],
    )
