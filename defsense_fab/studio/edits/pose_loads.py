"""Edits that set how a pose turns, shifts, pulls and loads, as they are typed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import tomlkit
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.device.device_file import DEVICE
from ...core.errors import DeviceError
from .edit import Edit, append, inline, named, number, numbers, remove, rows
from .poses import check_region, handle_table, rotation_table, table_array

#: How a region turns: by an angle, freely about an axis, or freely about its center.
Turn = Literal["angle", "hinge", "free"]
_KEY = "poses"
_Z_AXIS = np.array([0.0, 0.0, 1.0])


def set_turn(
    name: str, region: str, turn: Turn, axis: Sequence[float], degrees: float = 0.0
) -> Edit:
    """Set how a pose turns a region; its pivot stays.

    Args:
        name: Name of the pose.
        region: Name of the moved region.
        turn: How it turns.
        axis: Axis (3,) of any length but zero.
        degrees: The angle; used for "angle" only.
    """

    def change(document: TOMLDocument) -> None:
        handle = handle_table(document, name, region)
        if turn == "free":
            handle["rotate"] = "free"
            return
        vector = np.asarray(axis, float)
        if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
            raise _invalid("the axis must have three numbers that are not all zero", "axis")
        table = rotation_table(vector, degrees)
        if turn == "hinge":
            table["degrees"] = "free"
        before = handle.get("rotate")
        if isinstance(before, Mapping) and "about" in before:
            table["about"] = before["about"]
        handle["rotate"] = table

    return Edit(f"turn `{region}` in `{name}`", change)


def set_pivot(name: str, region: str, about: Sequence[float] | None) -> Edit:
    """Set the point (3,) mm about which a pose turns a region; None for the region's center."""

    def change(document: TOMLDocument) -> None:
        handle = handle_table(document, name, region)
        rotate = handle.get("rotate")
        if rotate == "free":
            raise _invalid(f"`{region}` turns freely in `{name}`, and has no pivot", "about")
        if rotate is None:
            rotate = handle["rotate"] = rotation_table(_Z_AXIS, 0.0)
        if about is not None:
            rotate["about"] = numbers(about)
        elif "about" in rotate:
            del rotate["about"]

    return Edit(f"set the pivot of `{region}` in `{name}`", change)


def set_translation(name: str, region: str, shift: Sequence[float | None]) -> Edit:
    """Set the translation (3,) mm of a moved region; None is free."""

    def change(document: TOMLDocument) -> None:
        handle = handle_table(document, name, region)
        if all(value is None for value in shift):
            handle["translate"] = "free"
            return
        array = tomlkit.array()
        array.extend("free" if value is None else number(value) for value in shift)
        handle["translate"] = array

    return Edit(f"move `{region}` in `{name}`", change)


def set_pull(
    name: str, at_index: int, at: Sequence[float], by: Sequence[float], stiffness: float
) -> Edit:
    """Change the point (3,), the displacement (3,) and the spring of a pull, mm and N/mm."""

    def change(document: TOMLDocument) -> None:
        pulls = rows(named(document, _KEY, name), "drags")
        _check_index(name, at_index, len(pulls))
        pull = pulls[at_index]
        pull["at"], pull["by"], pull["stiffness"] = numbers(at), numbers(by), number(stiffness)

    return Edit(f"change a pull in `{name}`", change)


def delete_pull(name: str, at_index: int) -> Edit:
    """Delete a pull."""

    def change(document: TOMLDocument) -> None:
        pose = named(document, _KEY, name)
        _check_index(name, at_index, len(rows(pose, "drags")))
        remove(pose, "drags", at_index)

    return Edit(f"delete a pull in `{name}`", change)


def set_pressure(name: str, region: str, value: float | None) -> Edit:
    """Set the pressure in a region, MPa; None removes it."""

    def change(document: TOMLDocument) -> None:
        _set_row(document, name, "pressures", region, "value", value)

    return Edit(f"set the pressure on `{region}` in `{name}`", change)


def set_symmetry(name: str, region: str, normal: Sequence[float] | None) -> Edit:
    """Let a region stay in a plane with a normal (3,); None releases it."""

    def change(document: TOMLDocument) -> None:
        value = None if normal is None else numbers(normal)
        _set_row(document, name, "symmetry", region, "normal", value)

    return Edit(f"set the plane of `{region}` in `{name}`", change)


def set_gravity(name: str, gravity: Sequence[float]) -> Edit:
    """Set gravity (3,) in multiples of standard gravity; zero removes it."""

    def change(document: TOMLDocument) -> None:
        pose = named(document, _KEY, name)
        if any(gravity):
            pose["gravity"] = numbers(gravity)
        elif "gravity" in pose:
            del pose["gravity"]

    return Edit(f"set gravity in `{name}`", change)


def _set_row(
    document: TOMLDocument, name: str, key: str, region: str, field: str, value: Any
) -> None:
    """Set a field of the row of a region in a list of a pose; None removes the row."""
    pose = named(document, _KEY, name)
    at = [k for k, row in enumerate(rows(pose, key)) if row.get("region") == region]
    if value is None:
        for k in reversed(at):
            remove(pose, key, k)
        if key in pose and not len(pose[key]):
            del pose[key]
    elif at:
        pose[key][at[0]][field] = value
    else:
        check_region(document, region)
        row = {"region": region, field: value}
        if key in pose:
            append(pose, key, row)
        else:
            pose[key] = table_array([inline(row)])


def _check_index(name: str, index: int, count: int) -> None:
    if not 0 <= index < count:
        raise DeviceError(
            f"the pose `{name}` no longer has a pull {index + 1}; it has {count}",
            code="point-not-pulled",
            where=DEVICE,
            pose=name,
        )


def _invalid(problem: str, key: str) -> DeviceError:
    return DeviceError(problem, code="edit-not-possible", where=DEVICE, key=key)


def finite(values: Sequence[float], count: int, what: str) -> Float:
    """Return finite numbers (count,). Raises DeviceError naming `what` is not valid."""
    array = np.asarray(values, float)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise _invalid(f"{what} needs {count} finite numbers", "")
    return array
