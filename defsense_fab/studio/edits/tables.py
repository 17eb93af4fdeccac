"""Tables of a device's file, written as a person would: comments and order stay, numbers are short.

Lists of tables come as `[[poses]]` or as arrays of inline tables; both are edited as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import tomlkit
from tomlkit import TOMLDocument
from tomlkit.items import AoT, Array, InlineTable

from ...core.errors import DeviceError

_DIGITS = 3


def number(value: float) -> int | float:
    """As a person writes it: to a thousandth, and whole where it is whole."""
    rounded = round(float(value), _DIGITS)
    return int(rounded) if rounded == int(rounded) else rounded


def numbers(values: Iterable[Any]) -> Array:
    """[1, 2.5], or [[1, 2.5], ...] in one line."""
    out = tomlkit.array()
    for value in values:
        nested = isinstance(value, Sequence | np.ndarray)
        out.append(numbers(value) if nested else number(value))
    return out


def strings(values: Iterable[str]) -> Array:
    """["a", "b"] in one line."""
    out = tomlkit.array()
    out.extend(values)
    return out


def inline(values: Mapping[str, Any]) -> InlineTable:
    """{ a = 1, b = 2 }."""
    rows = ", ".join(
        f"{tomlkit.key(k).as_string()} = {tomlkit.item(v).as_string()}" for k, v in values.items()
    )
    out = tomlkit.value(f"{{ {rows} }}" if rows else "{}")
    assert isinstance(out, InlineTable)
    return out


def rows(document: Any, key: str) -> Any:
    """The list of tables `key`, an AoT or an Array; empty where there is none."""
    found = document.get(key)
    return found if found is not None else []


def named(document: TOMLDocument, key: str, name: str) -> Any:
    """The table of that name in the list `key`. Raises DeviceError where it is not there."""
    return rows(document, key)[index(document, key, name)]


def index(document: TOMLDocument, key: str, name: str) -> int:
    """Where that table is. Raises DeviceError where it is not there."""
    there = [str(row.get("name", "")) for row in rows(document, key)]
    if name not in there:
        raise DeviceError(
            f"device.toml: there is no {key.removesuffix('s')} {name!r} any more; there are"
            f" {', '.join(there) or 'none'}"
        )
    return there.index(name)


def append(document: Any, key: str, values: Mapping[str, Any]) -> None:
    """A table at the end of the list `key`, in the way in which the list is written."""
    found = document.get(key)
    if isinstance(found, Array):
        found.append(inline(values))
        return
    table = tomlkit.table()
    table.update(dict(values))
    if found is None:
        found = tomlkit.aot()
        found.append(table)
        document[key] = found
        return
    if not found[-1].as_string().endswith("\n\n"):
        found[-1].add(tomlkit.nl())
    if list(document)[-1] != key:
        table.add(tomlkit.nl())
    found.append(table)


def remove(document: Any, key: str, at: int) -> None:
    """A table of a list; the list, too, where it was the last."""
    found = document[key]
    del found[at]
    if isinstance(found, AoT) and not len(found):
        del document[key]


def rename_key(table: Any, key: str, to: str) -> None:
    """Another key for a value, which stays in its place with its comment."""
    behind = list(table)[list(table).index(key) :]
    values = [table.pop(k) for k in behind]
    for k, value in zip(behind, values, strict=True):
        table[to if k == key else k] = value


def free_name(wanted: str, taken: Iterable[str]) -> str:
    """`wanted`, or with a number where it is taken."""
    there, number, name = set(taken), 1, wanted
    while name in there:
        number += 1
        name = f"{wanted}_{number}"
    return name
