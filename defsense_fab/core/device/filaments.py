"""Conductive filaments that printed traces are made of: the table `data/traces.csv`."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

FILE = "traces.csv"
#: Kinds of evidence for a number.
BASES = ("measured", "data sheet", "assumed")
#: What the table has for each filament.
QUANTITIES = (
    "resistivity",
    "across",
    "between_layers",
    "min_width",
    "min_height",
    "young_modulus",
    "max_strain",
    "gauge_factor",
    "noise",
    "contact",
    "spread",
)


@dataclass(frozen=True)
class Quantity:
    """A number of a filament.

    Attributes:
        value: The number, in the unit that `QUANTITIES` has in `docs/printed-reference.md`.
        basis: Evidence for it, a name in `BASES`.
        source: Where it comes from.
    """

    value: float
    basis: str
    source: str


@dataclass(frozen=True)
class TraceSpec:
    """Printed traces of a device.

    Attributes:
        filament: Name of the conductive filament.
        width: Width of a trace across its path, mm.
        height: Height of a trace along the direction of printing, mm.
        resistivity: Resistivity along beads, ohm mm.
        across: Resistivity across beads of a layer, as a multiple of `resistivity`.
        between_layers: Resistivity between layers, as a multiple of `resistivity`.
        young_modulus: Young's modulus of the filament, MPa.
        spread: Relative standard deviation of gauge factor and resistance between prints.
    """

    filament: str
    width: float
    height: float
    resistivity: float
    across: float
    between_layers: float
    young_modulus: float
    spread: float

    @property
    def area(self) -> float:
        """Area of the cross-section, mm^2."""
        return self.width * self.height

    @property
    def diameter(self) -> float:
        """Diameter (mm) of the circle around the cross-section, by which walls are kept."""
        return math.hypot(self.width, self.height)


def has_second_extruder(process: str) -> bool:
    """Return whether a process of `printers.csv` can print traces within a body."""
    return process.startswith("fdm")


@cache
def read_filaments() -> Mapping[str, Mapping[str, Quantity]]:
    """Return the quantities of each conductive filament by name; do not change them."""
    text = (files("defsense_fab") / "data" / FILE).read_text(encoding="utf-8")
    filaments: dict[str, dict[str, Quantity]] = {}
    for row in csv.DictReader(text.splitlines()):
        quantity = Quantity(float(row["value"]), row["basis"], row["source"])
        filaments.setdefault(row["filament"], {})[row["quantity"]] = quantity
    return filaments
