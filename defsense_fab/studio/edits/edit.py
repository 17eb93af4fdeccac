"""Edits of a device's file, and the TOML operations that they consist of.

The operations keep comments and the order of keys, and write short numbers. Lists of tables are
written as `[[poses]]` or as arrays of inline tables; both are edited in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import tomlkit
from tomlkit import TOMLDocument
from tomlkit.items import AoT, Array, InlineTable

from ...core.device.device_file import DEVICE
from ...core.errors import DeviceError

_DECIMALS = 3


@dataclass(frozen=True)
class Edit:
    """An edit of a device's file.

    Attributes:
        name: Name of the edit for undo, such as "delete `top`".
        change: Changes the current document in place, or returns a document to replace it. It
            finds by name what it changes, as two users may edit one device, and raises
            DeviceError if the name no longer exists.
    """

    name: str
    change: Callable[[TOMLDocument], TOMLDocument | None]


def combine(name: str, edits: Sequence[Edit]) -> Edit:
    """Return the edit that makes several edits in one step of undo."""

    def change(document: TOMLDocument) -> TOMLDocument:
        for edit in edits:
            document = edit.change(document) or document
        return document

    return Edit(name, change)


def number(value: float) -> int | float:
    """Round to a thousandth, and return an integer if the result is whole."""
    rounded = round(float(value), _DECIMALS)
    return int(rounded) if rounded == int(rounded) else rounded


def numbers(values: Iterable[Any]) -> Array:
    """Return an array in one line, such as [1, 2.5] or [[1, 2.5], [3, 4]]."""
    array = tomlkit.array()
    for value in values:
        is_nested = isinstance(value, Sequence | np.ndarray)
        array.append(numbers(value) if is_nested else number(value))
    return array


def strings(values: Iterable[str]) -> Array:
    """Return an array in one line, such as ["a", "b"]."""
    array = tomlkit.array()
    array.extend(values)
    return array


def inline(values: Mapping[str, Any]) -> InlineTable:
    """Return an inline table, such as { a = 1, b = 2 }."""
    pairs = ", ".join(
        f"{tomlkit.key(k).as_string()} = {tomlkit.item(v).as_string()}" for k, v in values.items()
    )
    table = tomlkit.value(f"{{ {pairs} }}" if pairs else "{}")
    assert isinstance(table, InlineTable)
    return table


def rows(document: Any, key: str) -> Any:
    """Return the list of tables under `key`, an AoT or an Array; empty if there is none."""
    tables = document.get(key)
    return tables if tables is not None else []


def named(document: TOMLDocument, key: str, name: str) -> Any:
    """Return the table with a name in the list under `key`.

    Raises:
        DeviceError: There is no such table.
    """
    return rows(document, key)[index(document, key, name)]


def index(document: TOMLDocument, key: str, name: str) -> int:
    """Return the index of the table with a name in the list under `key`.

    Raises:
        DeviceError: There is no such table.
    """
    names = [str(row.get("name", "")) for row in rows(document, key)]
    if name not in names:
        raise not_in_device(key.removesuffix("s"), name, names)
    return names.index(name)


def not_in_device(kind: str, name: str, names: Sequence[str]) -> DeviceError:
    """Return the error of an edit whose cord, pose or region no longer exists."""
    return DeviceError(
        f"no longer has the {kind} {name!r}",
        code="not-in-device",
        where=DEVICE,
        action=f"Choose one of: {', '.join(names)}" if names else "",
        table=kind,
        name=name,
        names=tuple(names),
    )


def append(document: Any, key: str, values: Mapping[str, Any]) -> None:
    """Add a table to the end of the list under `key`, in the style of the list."""
    tables = document.get(key)
    if isinstance(tables, Array):
        tables.append(inline(values))
        return
    table = tomlkit.table()
    table.update(dict(values))
    if tables is None:
        tables = tomlkit.aot()
        tables.append(table)
        document[key] = tables
        return
    if not tables[-1].as_string().endswith("\n\n"):
        tables[-1].add(tomlkit.nl())
    if list(document)[-1] != key:
        table.add(tomlkit.nl())
    tables.append(table)


def remove(document: Any, key: str, at: int) -> None:
    """Remove a table from the list under `key`, and the list if it becomes empty."""
    tables = document[key]
    del tables[at]
    if isinstance(tables, AoT) and not len(tables):
        del document[key]


def rename_key(table: Any, key: str, to: str) -> None:
    """Rename a key; its value keeps its position and comment."""
    following = list(table)[list(table).index(key) :]
    values = [table.pop(k) for k in following]
    for k, value in zip(following, values, strict=True):
        table[to if k == key else k] = value


def free_name(name: str, taken: Iterable[str]) -> str:
    """Return `name`, with a number appended if it is taken."""
    names, count, candidate = set(taken), 1, name
    while candidate in names:
        count += 1
        candidate = f"{name}_{count}"
    return candidate
