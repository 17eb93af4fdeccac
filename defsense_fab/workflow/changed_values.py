"""Change a `device.toml` at dotted keys, such as `cord.noise` or `poses.bend.fixed`."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from ..core.device.device import Device
from ..core.device.device_file import DEVICE, read_device
from ..core.errors import StudyError
from ..core.schema.document import Document


def changed_device(text: str, folder: Path, values: Mapping[str, Any]) -> Device:
    """Return the device that a file's text describes, with other values.

    Args:
        text: Text of `device.toml`.
        folder: Folder of the file, and of the files that it names.
        values: Values by dotted key, as in `{"cord.noise": 0.002}`.

    Raises:
        DeviceError: There is no such device.
        StudyError: A key leads through a value that is not a table (`not-a-table`), or names a row
            that does not exist (`unknown-name`).
    """
    changed = changed_values(tomllib.loads(text), values)
    return read_device(Document(changed, Path(DEVICE), text), folder, {})


def changed_text(text: str, values: Mapping[str, Any]) -> str:
    """Return the text of `device.toml` with other values; comments are kept."""
    document = tomlkit.parse(text)
    for key, value in values.items():
        _put(document, key, value)
    return tomlkit.dumps(document)


def changed_values(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the contents of a `device.toml` with other values.

    Args:
        data: Contents of the file.
        values: Values by dotted key, as in `{"cord.noise": 0.002}`.

    Raises:
        StudyError: A key leads through a value that is not a table.
    """
    changed = copy.deepcopy(dict(data))
    for key, value in values.items():
        _put(changed, key, copy.deepcopy(value))
    return changed


def _put(data: Any, key: str, value: Any) -> None:
    """Set a value in tables and lists of tables; missing tables are created."""
    *parents, last = key.split(".")
    for name in parents:
        if isinstance(data, list):
            data = data[_find_row(data, name, key)]
        elif name in data:
            data = data[name]
        else:
            data[name] = {}
            data = data[name]
        if not isinstance(data, dict | list):
            raise StudyError(
                f"{name} is a value in {DEVICE}, not a table",
                code="not-a-table",
                where=key,
                name=name,
            )
    if isinstance(data, list):
        data[_find_row(data, last, key)] = value
    else:
        data[last] = value


def _find_row(rows: list[Any], name: str, key: str) -> int:
    """Return the index of a pose, cord or handle, by its name or its number from 1 on."""
    for k, row in enumerate(rows):
        if isinstance(row, dict) and row.get("name") == name:
            return k
    if name.isdecimal() and 1 <= int(name) <= len(rows):
        return int(name) - 1
    names = [str(r["name"]) for r in rows if isinstance(r, dict) and "name" in r]
    choices = ", ".join(names) or f"1 to {len(rows)}"
    raise StudyError(
        f"there is no {name!r} in {DEVICE}",
        code="unknown-name",
        where=key,
        action=f"Use one of: {choices}",
        name=name,
    )
