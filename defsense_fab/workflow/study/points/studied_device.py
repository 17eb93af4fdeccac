"""A device with other values at dotted keys of its `device.toml`."""

from __future__ import annotations

import copy
import difflib
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import tomlkit

from ....core.device.device import Device
from ....core.device.device_file import DEVICE, DeviceFile, read_device
from ....core.errors import BodyError, StudyError
from ....core.schema.document import Document
from ....core.schema.fields import declared_keys
from ....geometry.bodies.script_source import read_parameters

_PARAMETERS = "body.parameters."


def studied_device(text: str, folder: Path, values: Mapping[str, Any]) -> Device:
    """Return the device that a file's text describes, with other values.

    Args:
        text: Text of `device.toml`.
        folder: Folder of the file, and of the files that it names.
        values: Values by dotted key, as in `{"cord.noise": 0.002}`.

    Raises:
        DeviceError: if there is no such device.
        StudyError: if a key leads through a value that is not a table.
    """
    changed = changed_values(tomllib.loads(text), values)
    return read_device(Document(changed, Path(DEVICE), text), folder, {})


def studied_text(text: str, values: Mapping[str, Any]) -> str:
    """Return the text of `device.toml` with other values; comments are kept."""
    document = tomlkit.parse(text)
    for key, value in values.items():
        _put(document, key, value)
    return tomlkit.dumps(document)


def known_keys(text: str, values: Mapping[str, Any]) -> list[str]:
    """Return the dotted keys that `device.toml` with these values may have, with names of poses."""
    data = changed_values(tomllib.loads(text), values)
    return sorted(_dotted(data, path) for path in declared_keys(DeviceFile, data))


def script_keys(device: Device) -> list[str]:
    """Return the keys of the script's parameters, or the given ones if the script is invalid."""
    names = list(device.body.parameters)
    if device.body.kind == "script":
        with suppress(BodyError):  # the stage of the body reports it, with the line
            names += [p.name for p in read_parameters(device.body.path, device.body.parameters)]
    return sorted({f"{_PARAMETERS}{name}" for name in names})


def find_similar_keys(key: str, known: Iterable[str]) -> list[str]:
    """Return up to three known keys that are similar to a key, as a whole or in their last name."""
    known = [k for k in known if "." in k]
    similar = difflib.get_close_matches(key, known, 3, 0.7)
    last = key.rpartition(".")[2]
    similar += [
        k for k in known if difflib.SequenceMatcher(None, k.rpartition(".")[2], last).ratio() > 0.8
    ]
    return list(dict.fromkeys(similar))[:3]


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
    known = ", ".join(names) or f"1 to {len(rows)}"
    raise StudyError(
        f"there is no {name!r} in {DEVICE}",
        code="unknown-name",
        where=key,
        action=f"Use one of: {known}",
        name=name,
    )


def _dotted(data: Any, path: tuple[Any, ...]) -> str:
    """Return a dotted key, with the names of rows in lists."""
    parts = []
    for name in path:
        if isinstance(name, int):
            row = data[name] if isinstance(data, list) and name < len(data) else None
            is_named = isinstance(row, dict) and "name" in row
            parts.append(str(row["name"]) if is_named and row else str(name + 1))
            data = row
        else:
            parts.append(name)
            data = data.get(name) if isinstance(data, dict) else None
    return ".".join(parts)
