"""Changes to the body's parameters and to single values of the device."""

from __future__ import annotations

from typing import Any

from tomlkit import TOMLDocument

from .edit import Edit
from .tables import inline, number


def set_parameter(name: str, value: float | str | bool) -> Edit:
    """Of the body's script."""

    def change(document: TOMLDocument) -> None:
        body: Any = document["body"]
        parameters = body.setdefault("parameters", inline({}))
        parameters[name] = _value(value)

    return Edit(f"set {name} to {_value(value)}", change)


def set_value(table: str, key: str, value: float | str | bool) -> Edit:
    """One value of a table, such as the wall of [fabrication]; the table, too, where it lacks."""

    def change(document: TOMLDocument) -> None:
        document.setdefault(table, {})[key] = _value(value)

    return Edit(f"set {table}.{key} to {_value(value)}", change)


def reset_value(table: str, key: str) -> Edit:
    """Back to what it is without being written."""

    def change(document: TOMLDocument) -> None:
        document.get(table, {}).pop(key, None)

    return Edit(f"reset {table}.{key}", change)


def use_response(file: str) -> Edit:
    """The cord's response as it was measured, a file in the device's folder, in place of what the
    data sheet tells."""

    def change(document: TOMLDocument) -> None:
        cord: Any = document["cord"]
        cord.pop("compression", None)  # the response tells it
        cord["response"] = file

    return Edit(f"use the measured response {file}", change)


def rename_device(name: str) -> Edit:
    """Another name for the device."""

    def change(document: TOMLDocument) -> None:
        document["name"] = name

    return Edit(f"rename the device to `{name}`", change)


def _value(value: float | str | bool) -> Any:
    return value if isinstance(value, bool | str) else number(value)
