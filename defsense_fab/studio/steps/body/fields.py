"""The fields of `device.toml` that have controls: as they are declared, with their values."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from msgspec import inspect

from ....core.device.device import Device
from ....core.device.device_file import DEVICE, DeviceFile
from ....core.errors import DeviceError
from ....core.mesh import Surface
from ....core.schema.fields import Field, field
from ....core.schema.reader import check_value
from ....core.schema.types import members
from ....core.storage.package_data import read_rows
from ....workflow.design.pose_preview import check_edge_length
from ...edits.body import (
    reset_value,
    set_accuracy,
    set_cord_count,
    set_edge_length,
    set_value,
)
from ...edits.edit import Edit
from ...messages import body as messages

_EDGE_LENGTH, _ACCURACY, _CORDS = "mesh.edge_length", "mesh.accuracy", "design.sensors"
_MATERIAL = ("young_modulus", "shore", "poisson_ratio", "density")
_CORD = (
    *("diameter", "ohm_per_mm", "gauge_factor", "max_strain", "min_bend_radius", "modulus"),
    *("noise", "contact", "min_stretch", "ferrule_diameter", "ferrule_length", "compression"),
)
_TRACE = (
    *("width", "height", "resistivity", "between_layers", "gauge_factor", "max_strain"),
    *("min_bend_radius", "modulus", "noise", "contact", "min_stretch"),
)
_PARTS = (
    *("pockets", "limit_cuts", "strain_relief", "prestretch", "lead", "wire_diameter", "line"),
    *("layer", "rate", "hole", "copies", "marker_seats", "marker_size"),
)
_MOULDS = ("mould_wall", "shrinkage")
#: Fields whose name alone is not clear on a page.
_LABELS = {
    "body.time_limit": "Time limit of the body",
    "body.scale": "Scale",
    "mesh.time_limit": "Time limit of the mesh",
    "design.prefer": "Preferred layouts",
    "design.planes": "Largest number of planes",
    "design.searches": "Largest number of searches",
    "design.seed": "Random seed",
    "fabrication.hole": "Smallest hole",
    "fabrication.lead": "Free cord at each end",
    "fabrication.limit_cuts": "Shorten cuts",
    "fabrication.line": "Line width",
    "fabrication.layer": "Layer height",
    "fabrication.mould_wall": "Wall of the moulds",
    "material.young_modulus": "Young's modulus",
    "material.shore": "Shore hardness",
    "material.poisson_ratio": "Poisson's ratio",
    "cord.ohm_per_mm": "Resistance per length",
    "cord.max_strain": "Largest strain",
    "cord.min_bend_radius": "Smallest bend radius",
    "cord.modulus": "Young's modulus",
    "cord.contact": "Spread of contact resistance",
    "cord.min_stretch": "Smallest stretched length",
    "cord.between_layers": "Resistivity between layers, relative",
}


def device_fields(device: Device, document: Mapping[str, Any]) -> list[messages.FieldGroup]:
    """Return the fields of a device.

    Args:
        device: The device.
        document: Content of its `device.toml`.
    """
    body = ("time_limit", *(["scale"] if device.body.kind == "mesh" else []))
    cord = _CORD if device.cord.trace is None else _TRACE
    parts = _PARTS + (_MOULDS if device.fabrication.kind == "cast" else ())
    groups = (
        ("Mesh", (_EDGE_LENGTH,), (_ACCURACY, *_keys("mesh", ("time_limit",)))),
        (
            "Design",
            _keys("design", ("sensors", "decoder", "searches")),
            _keys("design", ("prefer", "parts", "planes", "seed")),
        ),
        ("Fabrication", _keys("fabrication", ("wall", "clearance", "assembly")),
         _keys("fabrication", parts)),
        ("Readout", _keys("readout", ("board", "converter")), ()),
        ("Material values", (), _keys("material", _MATERIAL)),
        (f"{device.cord.noun.capitalize()} values", (), _keys("cord", cord)),
        ("Body file", (), _keys("body", (*body, "fill_cavities"))),
    )  # fmt: skip
    return [
        messages.FieldGroup(
            title=title,
            fields=[_device_field(key, device, document) for key in keys],
            more=[_device_field(key, device, document) for key in more],
        )
        for title, keys, more in groups
    ]


def field_edit(
    key: str, value: float | bool | str, device: Device, surface: Surface | None
) -> Edit:
    """Return the edit that sets a key, after checking the value before it is rounded.

    Args:
        key: Dotted name of the key.
        value: The value.
        device: The device.
        surface: The body, or None if it has not been made.

    Raises:
        DeviceError: The page has no such field (`unknown-field`), or it does not accept the value.
        MeshingError: An edge length does not fit the body.
    """
    declared = _declared(key)
    if _kind(declared) == "whole" and isinstance(value, float) and value.is_integer():
        value = int(value)
    if value == "" and _kind(declared) == "text":
        return reset_edit(key)
    check_value(declared, value, DeviceError, f"{DEVICE}: {key}", key)
    if key == _EDGE_LENGTH:
        if surface is not None:
            check_edge_length(surface, float(value))
        return set_edge_length(float(value))
    if key == _ACCURACY:
        return set_accuracy(float(value))
    if key == _CORDS:
        _check_cord_count(int(value), device)
        return set_cord_count(int(value))
    table, name = key.split(".")
    return set_value(table, name, value)


def _check_cord_count(count: int, device: Device) -> None:
    drawn, noun = len(device.sensors), device.cord.noun
    if count < drawn:
        raise DeviceError(
            f"must be at least {drawn}, as {drawn} {noun}s are drawn, not {count}",
            code="too-few-sensors",
            where=f"{DEVICE}: {_CORDS}",
            key=_CORDS,
        )


def reset_edit(key: str) -> Edit:
    """Return the edit that removes a key.

    Raises:
        DeviceError: The page has no such field (`unknown-field`).
    """
    _declared(key)
    table, name = key.split(".")
    return reset_value(table, name)


@cache
def _declared(key: str) -> Field:
    table, _, name = key.partition(".")
    known = {
        "mesh": ("edge_length", "accuracy", "time_limit"),
        "design": ("sensors", "decoder", "searches", "prefer", "parts", "planes", "seed"),
        "fabrication": ("wall", "clearance", "assembly", *_PARTS, *_MOULDS),
        "readout": ("board", "converter"),
        "material": _MATERIAL,
        "cord": (*_CORD, *_TRACE),
        "body": ("time_limit", "scale", "fill_cavities"),
    }
    if name not in known.get(table, ()):
        raise DeviceError(f"{key!r} has no field on this page", code="unknown-field", key=key)
    return field(DeviceFile, key)


def _keys(table: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{table}.{name}" for name in names)


def _device_field(key: str, device: Device, document: Mapping[str, Any]) -> messages.DeviceField:
    declared = _declared(key)
    table, name = key.split(".")
    stored = document.get(table, {})
    value = stored.get(name)
    default, default_text = _default(key, declared, device)
    label = _LABELS.get(key, declared.label.removesuffix(f", {declared.unit}"))
    low = declared.bounds[0]
    can_reset = value is not None and not declared.is_required
    if key == _EDGE_LENGTH:
        can_reset = False  # a mesh needs it or an accuracy
        if value is None:
            default_text = f"from the accuracy of {device.mesh.accuracy:g}"
    elif key == _ACCURACY:
        can_reset, default_text = False, "" if value is not None else "the edge length is given"
    elif key == _CORDS:
        noun, drawn = device.cord.noun, len(device.sensors)
        label, low = f"Number of {noun}s", max(1, drawn)
        value = drawn + device.propose or None
        can_reset = name in stored
        default_text = f"only the drawn {noun}s"
    numbers = declared.numbers
    return messages.DeviceField(
        key=key,
        label=label,
        kind=_kind(declared),
        unit=declared.unit,
        description=declared.description.replace("`", ""),
        value=value,
        default=default,
        default_text=default_text,
        low=low,
        high=declared.bounds[1],
        is_low_open=numbers is not None and numbers.gt is not None,
        is_high_open=numbers is not None and numbers.lt is not None,
        choices=list(declared.choices),
        can_reset=can_reset,
    )


def _default(key: str, declared: Field, device: Device) -> tuple[messages.FieldValue, str]:
    """Return the value without the key, and that value in words."""
    words = declared.default_words.replace("`", "")
    default = declared.default
    table, name = key.split(".")
    if table == "fabrication":
        cell = read_rows("printers.csv")[device.fabrication.process].get(name)
    elif table == "material" and name != "shore":  # it takes the place of the modulus
        cell = read_rows("materials.csv").get(device.material.name, {}).get(name)
    elif table == "cord" and device.cord.trace is None:
        cell = read_rows("cords.csv").get(device.cord.name, {}).get(name)
    else:
        cell = None
    if default is None and cell:
        default = float(cell) if _kind(declared) in ("number", "whole") else cell
    if name == "density" and default is None:
        default = device.material.density
    if not isinstance(default, bool | int | float | str):
        return None, words
    return default, ""


def _kind(declared: Field) -> messages.FieldKind:
    if declared.choices:
        return "choice"
    if any(isinstance(option, inspect.BoolType) for option in members(declared.kind)):
        return "switch"
    if declared.numbers is None:
        return "text"
    return "whole" if isinstance(declared.numbers, inspect.IntType) else "number"
