"""Materials, cords, filaments and printers: their key numbers, and the device's choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ....core.device.catalogues import CATALOGUES, Catalogue
from ....core.device.device import Device
from ....core.errors import DeviceError
from ...edits.body import choose_cord, choose_material, choose_printer, choose_trace
from ...edits.edit import Edit
from ...messages import body as messages

_Cell = float | str | None


@dataclass(frozen=True)
class _Choice:
    """How a device chooses a row of a catalogue.

    Attributes:
        catalogue: Name of the catalogue.
        table: Table of `device.toml` that names the row.
        choose: Returns the edit that chooses a row.
        chosen: Returns the name of the row that a device uses.
    """

    catalogue: str
    table: str
    choose: Callable[[str], Edit]
    chosen: Callable[[Device], str]

    @property
    def content(self) -> Catalogue:
        """The catalogue."""
        return CATALOGUES[self.catalogue]


_CHOICES: dict[messages.CatalogueName, _Choice] = {
    "material": _Choice(
        "materials", "material", choose_material, lambda device: device.material.name
    ),
    "cord": _Choice("cords", "cord", choose_cord, lambda device: device.cord.name),
    "trace": _Choice("filaments", "cord", choose_trace, lambda device: device.cord.name),
    "printer": _Choice(
        "printers", "fabrication", choose_printer, lambda device: device.fabrication.process
    ),
}
#: Names of the files in words, by the content of the column `note`.
_NOTES = {"print": "printed", "cast": "cast in printed moulds"}


@cache
def catalogues() -> messages.Catalogues:
    """Return all catalogues."""
    return messages.Catalogues(
        catalogues=[_describe(name, choice.content) for name, choice in _CHOICES.items()]
    )


def _describe(name: messages.CatalogueName, catalogue: Catalogue) -> messages.Catalogue:
    rows = [
        messages.CatalogueRow(
            name=row_name,
            values=[_cell(row.get(column.name)) for column in catalogue.columns],
            note=_NOTES.get(row.get(catalogue.note, ""), row.get(catalogue.note, "")),
            source=row["source"],
        )
        for row_name, row in catalogue.rows().items()
    ]
    columns = [messages.CatalogueColumn(label=c.label, unit=c.unit) for c in catalogue.columns]
    return messages.Catalogue(name=name, columns=columns, rows=rows)


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
    choice = _CHOICES[name]
    rows = choice.content.rows()
    if row not in rows:
        raise DeviceError(
            f"{row!r} is not a {name} of the catalogue",
            code="unknown-row",
            action=f"Choose one of: {', '.join(rows)}",
            name=row,
        )
    return choice.choose(row)


def _choice(
    name: messages.CatalogueName, device: Device, document: Mapping[str, Any]
) -> messages.CatalogueChoice:
    choice = _CHOICES[name]
    chosen, columns = choice.chosen(device), choice.content.columns
    row, table = choice.content.rows().get(chosen), document.get(choice.table, {})
    values = [_cell(table.get(c.name, (row or {}).get(c.name))) for c in columns]
    if name == "material":  # it may follow from the hardness or from other constants
        values[0] = device.material.young_modulus
    return messages.CatalogueChoice(
        catalogue=name,
        name=chosen,
        values=values,
        is_custom=row is None,
        changed=[column.label for column in columns if column.name in table],
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
