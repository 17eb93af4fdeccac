"""Materials, cords, filaments and printers: their key numbers, and the device's choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ....core.device.device import Device
from ....core.device.filaments import read_filaments
from ....core.errors import DeviceError
from ....core.storage.package_data import read_rows
from ...edits.body import choose_cord, choose_material, choose_printer, choose_trace
from ...edits.edit import Edit
from ...messages import body as messages

_Cell = float | str | None


@dataclass(frozen=True)
class _Kind:
    """A catalogue.

    Attributes:
        table: Table of `device.toml` that names the row.
        columns: Label, unit, and name in the catalogue and in `device.toml` of each column.
        rows: Returns the rows by name.
        choose: Returns the edit that chooses a row.
        chosen: Returns the name of the row that a device uses.
        note: Column that states what kind of values the row has.
    """

    table: str
    columns: tuple[tuple[str, str, str], ...]
    rows: Callable[[], Mapping[str, Mapping[str, str]]]
    choose: Callable[[str], Edit]
    chosen: Callable[[Device], str]
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


_KINDS: dict[messages.CatalogueName, _Kind] = {
    "material": _Kind(
        "material",
        (
            ("Young's modulus", "MPa", "young_modulus"),
            ("Shore hardness", "", "shore"),
            ("Elongation at break", "%", "elongation_at_break"),
            ("Poisson's ratio", "", "poisson_ratio"),
            ("Density", "g/cm³", "density"),
            ("Processes", "", "processes"),
        ),
        _material_rows,
        choose_material,
        lambda device: device.material.name,
        "basis",
    ),
    "cord": _Kind(
        "cord",
        (
            ("Diameter", "mm", "diameter"),
            ("Resistance", "Ω/mm", "ohm_per_mm"),
            ("Gauge factor", "", "gauge_factor"),
            ("Largest strain", "", "max_strain"),
            ("Bend radius", "mm", "min_bend_radius"),
        ),
        lambda: read_rows("cords.csv"),
        choose_cord,
        lambda device: device.cord.name,
    ),
    "trace": _Kind(
        "cord",
        (
            ("Resistivity", "Ω mm", "resistivity"),
            ("Gauge factor", "", "gauge_factor"),
            ("Largest strain", "", "max_strain"),
            ("Young's modulus", "MPa", "modulus"),
        ),
        _filament_rows,
        choose_trace,
        lambda device: device.cord.name,
    ),
    "printer": _Kind(
        "fabrication",
        (
            ("Wall", "mm", "wall"),
            ("Clearance", "mm", "clearance"),
            ("Layer", "mm", "layer"),
            ("Smallest hole", "mm", "hole"),
            ("Bed", "mm", "bed"),
        ),
        _printer_rows,
        choose_printer,
        lambda device: device.fabrication.process,
        "kind",
    ),
}
#: Names of the files in words, by the content of the column `note`.
_NOTES = {"print": "printed", "cast": "cast in printed moulds"}


@cache
def catalogues() -> messages.Catalogues:
    """Return all catalogues."""
    return messages.Catalogues(
        catalogues=[
            messages.Catalogue(
                name=name,
                columns=[
                    messages.CatalogueColumn(label=label, unit=unit)
                    for label, unit, _ in kind.columns
                ],
                rows=[
                    messages.CatalogueRow(
                        name=row_name,
                        values=[_cell(row.get(column)) for *_, column in kind.columns],
                        note=_NOTES.get(row.get(kind.note, ""), row.get(kind.note, "")),
                        source=row["source"],
                    )
                    for row_name, row in kind.rows().items()
                ],
            )
            for name, kind in _KINDS.items()
        ]
    )


def catalogue_choices(
    device: Device, document: Mapping[str, Any]
) -> list[messages.CatalogueChoice]:
    """Return the rows that a device uses.

    Args:
        device: The device.
        document: Content of its `device.toml`.
    """
    sensor: messages.CatalogueName = "cord" if device.cord.trace is None else "trace"
    return [_choice(name, device, document) for name in ("material", sensor, "printer")]


def row_edit(name: messages.CatalogueName, row: str) -> Edit:
    """Return the edit that chooses a row.

    Raises:
        DeviceError: The catalogue has no such row (`unknown-row`).
    """
    kind = _KINDS[name]
    rows = kind.rows()
    if row not in rows:
        raise DeviceError(
            f"{row!r} is not a {name} of the catalogue",
            code="unknown-row",
            action=f"Choose one of: {', '.join(rows)}",
            name=row,
        )
    return kind.choose(row)


def _choice(
    name: messages.CatalogueName, device: Device, document: Mapping[str, Any]
) -> messages.CatalogueChoice:
    kind = _KINDS[name]
    chosen = kind.chosen(device)
    row, table = kind.rows().get(chosen), document.get(kind.table, {})
    values = [_cell(table.get(column, (row or {}).get(column))) for *_, column in kind.columns]
    if name == "material":  # it may follow from the hardness or from other constants
        values[0] = device.material.young_modulus
    return messages.CatalogueChoice(
        catalogue=name,
        name=chosen,
        values=values,
        is_custom=row is None,
        changed=[label for label, _, column in kind.columns if column in table],
    )


def _cell(value: Any) -> _Cell:
    """Return a number, a text that is not a number, or None for an empty cell."""
    if isinstance(value, list):
        return " × ".join(f"{x:g}" for x in value)
    if value is None or value == "":
        return None
    try:
        return float(value)
    except ValueError:
        return str(value)
