"""Changes to the body's parameters and to single values of the device."""

from __future__ import annotations

from typing import Any

from tomlkit import TOMLDocument

from ...core.device.cord_table import SHEET
from .edit import Edit
from .tables import inline, number, rename_key, rows


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


#: What a row of the catalogue says, where a device does not say it itself.
_OF_MATERIAL = (
    "young_modulus", "shore", "poisson_ratio", "density",
    "model", "c10", "c01", "c20", "c30",
)  # fmt: skip
_OF_CORD = (
    *("response", "compression", "contact", "min_stretch", "min_bend_radius", "ferrule_diameter"),
    *("ferrule_length", "modulus", *SHEET),
)


def choose_material(name: str) -> Edit:
    """One of the catalogue, with nothing left of what was said of the one before."""
    return _chosen("material", name, _OF_MATERIAL)


def choose_cord(name: str) -> Edit:
    """One of the catalogue; noise and lengths of pieces stay, as they are not the cord's alone."""
    return _chosen("cord", name, _OF_CORD)


def set_edge_length(value: float) -> Edit:
    """Of the mesh, mm, in place of an accuracy where that was given."""

    def change(document: TOMLDocument) -> None:
        mesh: Any = document.setdefault("mesh", {})
        if "accuracy" in mesh:
            rename_key(mesh, "accuracy", "edge_length")
        mesh["edge_length"] = number(value)

    return Edit(f"set the edge length to {number(value)} mm", change)


def set_cord_count(count: int) -> Edit:
    """How many cords there are to be; those that are drawn alone where there are as many."""

    def change(document: TOMLDocument) -> None:
        if count > len(rows(document, "sensors")):
            document.setdefault("design", {})["sensors"] = count
        else:
            document.get("design", {}).pop("sensors", None)

    return Edit(f"have {count} cord{'s' if count != 1 else ''}", change)


def set_searches(count: int) -> Edit:
    """The most searches that a layout is chosen from; 0: as many as the number of cords asks."""
    if count == 0:
        return reset_value("design", "searches")
    return set_value("design", "searches", count)


def _chosen(table: str, name: str, before: tuple[str, ...]) -> Edit:
    def change(document: TOMLDocument) -> None:
        found: Any = document.setdefault(table, {})
        for key in before:
            found.pop(key, None)
        found["name"] = name

    return Edit(f"take the {table} {name}", change)


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
    """As a person writes it: to a thousandth, or to four digits where it is smaller than that."""
    if isinstance(value, bool | str):
        return value
    return number(value) if abs(value) >= 1 or not value else float(f"{value:.4g}")
