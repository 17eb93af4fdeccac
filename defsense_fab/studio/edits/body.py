"""Edits of the body's parameters and of single values of the device."""

from __future__ import annotations

from typing import Any

from tomlkit import TOMLDocument

from ...core.device.cord_tables import SHEET
from ...core.device.fabrication_table import FabricationTable
from ...core.device.materials import default_material, is_makeable, list_processes
from .edit import Edit, inline, number, rename_key, rows

#: Keys of [material] that a row of the catalogue replaces.
_MATERIAL_KEYS = (
    *("young_modulus", "shore", "poisson_ratio", "density"),
    *("model", "c10", "c01", "c20", "c30"),
)
#: Keys of [cord] that a row of the catalogue replaces. Noise and piece lengths are kept, as they
#: do not depend on the cord alone.
_CORD_KEYS = (
    *("response", "compression", "contact", "min_stretch", "min_bend_radius", "ferrule_diameter"),
    *("ferrule_length", "modulus", *SHEET),
)
#: Keys of [cord] that a filament of the catalogue replaces; the size of the traces is kept.
_TRACE_KEYS = (
    *("response", "compression", "contact", "min_stretch", "min_bend_radius", "modulus"),
    *("resistivity", "between_layers", "gauge_factor", "max_strain"),
)


def set_parameter(name: str, value: float | str | bool) -> Edit:
    """Set a parameter of the body's script."""

    def change(document: TOMLDocument) -> None:
        body: Any = document["body"]
        parameters = body.setdefault("parameters", inline({}))
        parameters[name] = shorten(value)

    return Edit(f"set {name} to {shorten(value)}", change)


def reset_parameter(name: str) -> Edit:
    """Remove a parameter of the body's script, so that the script's default applies."""

    def change(document: TOMLDocument) -> None:
        body: Any = document["body"]
        parameters = body.get("parameters", {})
        parameters.pop(name, None)
        if not parameters:
            body.pop("parameters", None)

    return Edit(f"reset {name}", change)


def set_value(table: str, key: str, value: float | str | bool) -> Edit:
    """Set a value of a table, such as `wall` of [fabrication]; add the table if it is missing."""

    def change(document: TOMLDocument) -> None:
        document.setdefault(table, {})[key] = shorten(value)

    return Edit(f"set {table}.{key} to {shorten(value)}", change)


def reset_value(table: str, key: str) -> Edit:
    """Remove a value, so that its default applies."""

    def change(document: TOMLDocument) -> None:
        document.get(table, {}).pop(key, None)

    return Edit(f"reset {table}.{key}", change)


def choose_material(name: str) -> Edit:
    """Choose a material of the catalogue, and remove the values of the previous one.

    If the device's process does not make it, the first one that does is chosen, too.
    """
    choice = _choose("material", name, _MATERIAL_KEYS)

    def change(document: TOMLDocument) -> None:
        choice.change(document)
        if not is_makeable(name, _process(document)):
            document.setdefault("fabrication", {})["process"] = list_processes(name)[0]

    return Edit(choice.name, change)


def choose_cord(name: str) -> Edit:
    """Choose a cord of the catalogue, and remove the values of the previous one."""
    return _choose("cord", name, _CORD_KEYS)


def choose_trace(name: str) -> Edit:
    """Choose a conductive filament, and remove the values of the previous one."""
    return _choose("cord", name, _TRACE_KEYS, "trace")


def choose_printer(name: str) -> Edit:
    """Choose a printer of the catalogue.

    If it does not make the device's material, its default material is chosen, too.
    """

    def change(document: TOMLDocument) -> None:
        document.setdefault("fabrication", {})["process"] = name
        if not is_makeable(str(document.get("material", {}).get("name", "")), name):
            _choose("material", default_material(name), _MATERIAL_KEYS).change(document)

    return Edit(f"set fabrication.process to {name}", change)


def set_edge_length(value: float) -> Edit:
    """Set the edge length of the mesh in mm; it replaces an accuracy."""
    return _replace_in_mesh(
        "accuracy", "edge_length", value, f"set the edge length to {shorten(value)} mm"
    )


def set_accuracy(value: float) -> Edit:
    """Set the accuracy of the signals; it replaces an edge length of the mesh."""
    return _replace_in_mesh("edge_length", "accuracy", value, f"set the accuracy to {value:g}")


def set_cord_count(count: int) -> Edit:
    """Set the number of cords; the drawn cords are a lower limit."""

    def change(document: TOMLDocument) -> None:
        if count > len(rows(document, "sensors")):
            document.setdefault("design", {})["sensors"] = count
        else:
            document.get("design", {}).pop("sensors", None)

    return Edit(f"set the number of cords to {count}", change)


def set_searches(count: int) -> Edit:
    """Limit the number of searches; 0 lets it depend on the number of cords."""
    if count == 0:
        return reset_value("design", "searches")
    return set_value("design", "searches", count)


def use_response(file: str) -> Edit:
    """Use a measured response of the cord instead of the data sheet.

    Args:
        file: Name of the response's file in the device's folder.
    """

    def change(document: TOMLDocument) -> None:
        cord: Any = document["cord"]
        cord.pop("compression", None)  # part of the response
        cord["response"] = file

    return Edit(f"use the measured response {file}", change)


def rename_device(name: str) -> Edit:
    """Rename the device."""

    def change(document: TOMLDocument) -> None:
        document["name"] = name

    return Edit(f"rename the device to `{name}`", change)


def shorten(value: float | str | bool) -> Any:
    """Round a number to a thousandth, or to four digits if it is smaller than 1."""
    if isinstance(value, bool | str):
        return value
    return number(value) if abs(value) >= 1 or not value else float(f"{value:.4g}")


def _replace_in_mesh(old: str, new: str, value: float, name: str) -> Edit:
    def change(document: TOMLDocument) -> None:
        mesh: Any = document.setdefault("mesh", {})
        if old in mesh:
            rename_key(mesh, old, new)
        mesh[new] = shorten(value)

    return Edit(name, change)


def _process(document: TOMLDocument) -> str:
    """Return the name of the process of a device."""
    chosen = document.get("fabrication", {}).get("process")
    return FabricationTable(process=chosen).row["name"]


def _choose(table: str, name: str, keys: tuple[str, ...], row_key: str = "name") -> Edit:
    def change(document: TOMLDocument) -> None:
        values: Any = document.setdefault(table, {})
        for key in keys:
            values.pop(key, None)
        values[row_key] = name

    return Edit(f"choose the {table} {name}", change)
