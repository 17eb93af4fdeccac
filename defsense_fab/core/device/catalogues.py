"""Materials, cords, filaments, printers, silicones and glues: their key numbers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial

from ..storage.package_data import read_rows
from .filaments import read_filaments


@dataclass(frozen=True)
class Column:
    """A number or text of each row.

    Attributes:
        label: What it is.
        unit: Its unit; empty without one.
        name: Its name in the row, and in `device.toml` if it can be set there.
    """

    label: str
    unit: str
    name: str


@dataclass(frozen=True)
class Catalogue:
    """Rows to choose from in `device.toml`.

    Attributes:
        columns: The key numbers, the most important ones first.
        rows: Returns the rows by name, each with its cells by column; do not change them. The cell
            `source` states where the numbers are from.
        note: Column that states what kind of values or process the row has; empty for none.
    """

    columns: tuple[Column, ...]
    rows: Callable[[], Mapping[str, Mapping[str, str]]]
    note: str = ""


@cache
def _material_rows() -> dict[str, dict[str, str]]:
    return {
        name: {**row, "processes": row["processes"].replace(" ", ", ")}
        for name, row in read_rows("materials.csv").items()
    }


@cache
def _printer_rows() -> dict[str, dict[str, str]]:
    return {
        name: {**row, "bed": " × ".join(row[f"bed_{axis}"] for axis in "xyz")}
        for name, row in read_rows("printers.csv").items()
    }


@cache
def _filament_rows() -> dict[str, dict[str, str]]:
    columns = {
        "resistivity": "resistivity",
        "gauge_factor": "gauge_factor",
        "max_strain": "max_strain",
        "young_modulus": "modulus",
    }
    return {
        name: {
            **{to: str(row[column].value) for column, to in columns.items()},
            "source": row["resistivity"].source,
        }
        for name, row in read_filaments().items()
    }


@cache
def _silicone_rows() -> dict[str, dict[str, str]]:
    return {
        name: {**row, "ratio": f"{row['part_a']} : {row['part_b']} by {row['by']}"}
        for name, row in read_rows("silicones.csv").items()
    }


CATALOGUES: Mapping[str, Catalogue] = {
    "materials": Catalogue(
        (
            Column("Young's modulus", "MPa", "young_modulus"),
            Column("Shore hardness", "", "shore"),
            Column("Elongation at break", "%", "elongation_at_break"),
            Column("Poisson's ratio", "", "poisson_ratio"),
            Column("Density", "g/cm³", "density"),
            Column("Processes", "", "processes"),
        ),
        _material_rows,
        "basis",
    ),
    "cords": Catalogue(
        (
            Column("Diameter", "mm", "diameter"),
            Column("Resistance", "Ω/mm", "ohm_per_mm"),
            Column("Gauge factor", "", "gauge_factor"),
            Column("Largest strain", "", "max_strain"),
            Column("Bend radius", "mm", "min_bend_radius"),
        ),
        partial(read_rows, "cords.csv"),
    ),
    "filaments": Catalogue(
        (
            Column("Resistivity", "Ω mm", "resistivity"),
            Column("Gauge factor", "", "gauge_factor"),
            Column("Largest strain", "", "max_strain"),
            Column("Young's modulus", "MPa", "modulus"),
        ),
        _filament_rows,
    ),
    "printers": Catalogue(
        (
            Column("Wall", "mm", "wall"),
            Column("Clearance", "mm", "clearance"),
            Column("Layer", "mm", "layer"),
            Column("Smallest hole", "mm", "hole"),
            Column("Bed", "mm", "bed"),
        ),
        _printer_rows,
        "kind",
    ),
    "silicones": Catalogue(
        (
            Column("Mix A to B", "", "ratio"),
            Column("Pot life", "min", "pot_life"),
            Column("Cure", "h", "cure"),
            Column("Shrinkage", "", "shrinkage"),
        ),
        _silicone_rows,
    ),
    "glues": Catalogue(
        (
            Column("Open", "min", "open_minutes"),
            Column("Pressed", "h", "press_hours"),
            Column("Full strength", "h", "cure_hours"),
        ),
        partial(read_rows, "glues.csv"),
    ),
}
