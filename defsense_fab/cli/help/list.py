"""Command `defsense list`: show the materials, cords, printers and others to choose from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Literal

from ...core.device.catalogues import CATALOGUES, Catalogue
from ...core.errors import DeviceError
from ..app import command
from ..output import OutputOptions, console, print_json, print_lines, standard_output

_NO_OUTPUT = OutputOptions()
_MAX_WIDTH = 30  # characters of the columns of a table; longer texts are shown with a name only

list_rows = command(
    "list",
    "defsense list materials",
    "defsense list printers fdm-tpu",
    "defsense list cords --json",
)


@list_rows.default
def _list(
    kind: Literal["materials", "cords", "filaments", "printers", "silicones", "glues"]
    | None = None,
    name: str = "",
    /,
    *,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Show the materials, cords, printers and others that device.toml can name.

    With a name, all its numbers and their source are shown.

    Args:
        kind: What to list; the lists if omitted.
        name: One of them.
    """
    if kind is None:
        counts = {key: len(catalogue.rows()) for key, catalogue in CATALOGUES.items()}
        with standard_output():
            if output.json:
                print_json(counts)
            else:
                print_lines(
                    f"{count:3} {key}: defsense list {key}" for key, count in counts.items()
                )
        return
    catalogue = CATALOGUES[kind]
    rows = catalogue.rows()
    if name and name not in rows:
        similar = get_close_matches(name, rows, n=1)
        raise DeviceError(
            f"{name!r} is not one of the {kind}",
            code="unknown-row",
            action=f"Did you mean {similar[0]}?" if similar else f"See defsense list {kind}",
            name=name,
        )
    with standard_output():
        if output.json:
            print_json(rows[name] if name else rows)
        elif name:
            print_lines(_describe_row(rows[name], catalogue))
        else:
            _print_table(kind, catalogue)
            print_lines([f"All numbers of one, and their source: defsense list {kind} NAME"])


def _describe_row(row: Mapping[str, str], catalogue: Catalogue) -> Iterator[str]:
    """Yield a line for each number of a row, the key numbers with their units first."""
    for column in catalogue.columns:
        if row[column.name]:
            yield f"{column.label}: {row[column.name]} {column.unit}".rstrip()
    shown = {column.name for column in catalogue.columns}
    for key, value in row.items():
        if value and key not in shown:
            yield f"{key}: {value}"


def _print_table(kind: str, catalogue: Catalogue) -> None:
    from rich.table import Table

    table = Table(title=kind.capitalize(), box=None, padding=(0, 1, 0, 0), pad_edge=False)
    columns = [(column.name, column.label, column.unit) for column in catalogue.columns]
    if catalogue.note:
        columns.append((catalogue.note, catalogue.note.capitalize(), ""))
    rows = catalogue.rows().values()
    columns = [c for c in columns if max(len(row[c[0]]) for row in rows) <= _MAX_WIDTH]
    table.add_column("Name", no_wrap=True)
    for key, label, unit in columns:
        heading = f"{label}\n({unit})" if unit else label
        width = max(map(len, [*(row[key] for row in rows), *heading.split()]))
        table.add_column(heading, justify="right", min_width=width)
    for name, row in catalogue.rows().items():
        table.add_row(name, *(row[key] for key, *_ in columns))
    console().print(table)
