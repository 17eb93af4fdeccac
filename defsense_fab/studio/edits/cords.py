"""Edits of cords: their planes, paths and freedoms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, is_smooth
from ...core.device.device import FREEDOMS, Sensor
from ...core.device.device_file import DEVICE
from ...core.errors import DeviceError
from .edit import (
    Edit,
    append,
    combine,
    index,
    inline,
    named,
    number,
    numbers,
    remove,
    rows,
    strings,
)

_KEY = "sensors"
_DIRECTION_DECIMALS = 6  # three would misplace the ends of a long plane


def add_cord(name: str, plane: Plane, curve: Hermite, free: Sequence[str] = ()) -> Edit:
    """Add a cord along a curve in a plane.

    Args:
        name: Name of the cord.
        plane: The plane; it is not written for a path in space.
        curve: The path. Its tangents are written only if they do not follow from the points.
        free: Freedoms of the optimizer, as in `FREEDOMS`.
    """

    def change(document: TOMLDocument) -> None:
        values: dict[str, Any] = {"name": name, "control_points": numbers(curve.points)}
        if curve.is_planar:
            values = {"name": name, "plane": _plane_table(plane), **values}
        if not is_smooth(curve):
            values["tangents"] = numbers(curve.tangents)
        if free:
            values["free"] = strings(free)
        append(document, _KEY, values)

    return Edit(f"draw `{name}`", change)


def remove_cord(name: str) -> Edit:
    """Delete a cord."""

    def change(document: TOMLDocument) -> None:
        remove(document, _KEY, index(document, _KEY, name))

    return Edit(f"delete `{name}`", change)


def take_cords(sensors: Sequence[Sensor]) -> Edit:
    """Replace all cords by those of a layout, and lock them: a build does not change them."""

    def change(document: TOMLDocument) -> None:
        for k in reversed(range(len(rows(document, _KEY)))):
            remove(document, _KEY, k)
        for sensor in sensors:
            add_cord(sensor.name, sensor.plane, sensor.curve).change(document)
        design: Any = document.get("design", {})
        if "sensors" in design and design["sensors"] <= len(sensors):
            design.pop("sensors")  # all of them are drawn now

    return Edit("take the optimized cords", change)


def rename_cord(name: str, to: str) -> Edit:
    """Rename a cord."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["name"] = to

    return Edit(f"rename `{name}` to `{to}`", change)


def move_point(name: str, at: int, to: Float) -> Edit:
    """Move the control point with index `at` to (2,) mm in the plane, or (3,) mm in space."""

    def change(document: TOMLDocument) -> None:
        points = _points(document, name, at)
        for k, coordinate in enumerate(to):
            points[at][k] = number(coordinate)

    return Edit(f"move control point {at + 1} of `{name}`", change)


def insert_point(name: str, before: int, position: Float) -> Edit:
    """Insert a control point.

    Args:
        name: Name of the cord.
        before: Index of the new point.
        position: Position (2,) mm in the cord's plane. If the cord has tangents, the new point's
            tangent points from its one neighbor to the other.
    """

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        points = _points(document, name, before, extra=1)
        if "tangents" in cord:
            after = min(max(before, 1), len(points) - 1)
            along = np.array(points[after], float) - np.array(points[after - 1], float)
            cord["tangents"].insert(before, numbers(along / 2))
        points.insert(before, numbers(position))

    return Edit(f"add a control point to `{name}`", change)


def delete_point(name: str, at: int) -> Edit:
    """Delete the control point with index `at`, and its tangent."""

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        del _points(document, name, at)[at]
        if "tangents" in cord:
            del cord["tangents"][at]

    return Edit(f"delete control point {at + 1} of `{name}`", change)


def set_path(name: str, curve: Hermite) -> Edit:
    """Replace a cord's curve in its plane."""

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        cord["control_points"] = numbers(curve.points)
        if is_smooth(curve):
            cord.pop("tangents", None)
        else:
            cord["tangents"] = numbers(curve.tangents)

    return Edit(f"redraw `{name}`", change)


def redraw(sensor: Sensor) -> Edit:
    """Replace a cord's curve, and the plane of a planar one."""
    path = set_path(sensor.name, sensor.curve)
    if not sensor.curve.is_planar:
        return path
    return combine(path.name, [set_plane(sensor.name, sensor.plane), path])


def bend_at(name: str, at: int, curve: Hermite) -> Edit:
    """Change the tangent at the control point with index `at`; all tangents are written."""

    def change(document: TOMLDocument) -> None:
        points = _points(document, name, at)
        if len(points) != len(curve.tangents):
            raise DeviceError(
                f"`{name}` has {len(points)} control points now, not {len(curve.tangents)}",
                code="control-points-changed",
                where=DEVICE,
                action="Drag the tangent again",
                cord=name,
                count=len(points),
            )
        named(document, _KEY, name)["tangents"] = numbers(curve.tangents)

    return Edit(f"bend `{name}` at control point {at + 1}", change)


def smooth(name: str, moved: Sensor | None = None) -> Edit:
    """Remove a cord's tangents, so that they follow from the points.

    Args:
        name: Name of the cord.
        moved: The cord with moved points; None if they stay.
    """

    def change(document: TOMLDocument) -> None:
        if moved is not None:
            redraw(moved).change(document)
        named(document, _KEY, name).pop("tangents", None)

    return Edit(f"smooth `{name}`", change)


def repair(sensors: Sequence[Sensor]) -> Edit:
    """Redraw cords so that they keep the limits, in one step of undo."""
    names = ", ".join(f"`{sensor.name}`" for sensor in sensors)
    return combine(f"repair {names}", [redraw(sensor) for sensor in sensors])


def set_plane(name: str, plane: Plane) -> Edit:
    """Move a cord to another plane; its path in the plane stays."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["plane"] = _plane_table(plane)

    return Edit(f"move the plane of `{name}`", change)


def set_freedoms(name: str, free: Sequence[str]) -> Edit:
    """Set what the optimizer may move; nothing locks the cord."""
    freedoms = [word for word in FREEDOMS if word in free]

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        if freedoms or "free" in cord:
            cord["free"] = strings(freedoms)

    action = f"free {' and '.join(freedoms)} of" if freedoms else "lock"
    return Edit(f"{action} `{name}`", change)


def lock_cords() -> Edit:
    """Lock all cords and add none, so that a build contains the cords as drawn."""

    def change(document: TOMLDocument) -> None:
        for cord in rows(document, _KEY):
            if "free" in cord:
                cord["free"] = strings(())
        document.get("design", {}).pop("sensors", None)

    return Edit("lock all cords", change)


def unlock_cords() -> Edit:
    """Let a search move all cords: their path, and the plane of cords in a plane."""

    def change(document: TOMLDocument) -> None:
        for cord in rows(document, _KEY):
            cord["free"] = strings(("path", "plane") if "plane" in cord else ("path",))

    return Edit("unlock all cords", change)


def mirror_cord(name: str, to: str, origin: Float, normal: Float) -> Edit:
    """Add a mirrored copy of a cord.

    Args:
        name: Name of the cord.
        to: Name of the copy.
        origin: Point (3,) mm of the mirror plane.
        normal: Normal (3,) of the mirror plane, of any length.
    """
    n = np.asarray(normal, float) / np.linalg.norm(normal)

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        if "plane" not in cord:
            _mirror_in_space(document, cord.unwrap(), to, origin, n)
            return
        plane = cord["plane"].unwrap()
        axes = {key: np.array(plane[key], float) for key in ("normal", "x_axis")}
        position = np.array(plane["origin"], float)
        mirrored = {
            "origin": position - 2 * n * ((position - origin) @ n),
            "x_axis": axes["x_axis"] - 2 * n * (axes["x_axis"] @ n),
        }
        # The plane's second axis is normal x x_axis, whose direction a reflection reverses.
        mirrored["normal"] = -(axes["normal"] - 2 * n * (axes["normal"] @ n))
        values = {key: value for key, value in cord.unwrap().items() if key != "plane"}
        table = inline({k: numbers(mirrored[k]) for k in ("origin", "normal", "x_axis")})
        for key in ("control_points", "tangents"):
            if key in values:
                values[key] = numbers(values[key])
        append(document, _KEY, {"name": to, "plane": table} | {**values, "name": to})

    return Edit(f"mirror `{name}` to `{to}`", change)


def _mirror_in_space(
    document: TOMLDocument, cord: dict[str, Any], to: str, origin: Float, n: Float
) -> None:
    """Add the mirrored copy of a path in space; `n` is the unit normal (3,) of the mirror plane."""
    points = np.array(cord["control_points"], float)
    cord["control_points"] = numbers(points - 2 * np.outer((points - origin) @ n, n))
    if "tangents" in cord:
        tangents = np.array(cord["tangents"], float)
        cord["tangents"] = numbers(tangents - 2 * np.outer(tangents @ n, n))
    append(document, _KEY, {**cord, "name": to})


def _points(document: TOMLDocument, name: str, at: int, extra: int = 0) -> Any:
    """Return a cord's control points, of which index `at` must exist; `extra` are allowed."""
    points = named(document, _KEY, name)["control_points"]
    if not 0 <= at < len(points) + extra:
        raise DeviceError(
            f"`{name}` no longer has a control point {at + 1}; it has {len(points)}",
            code="no-control-point",
            where=DEVICE,
            cord=name,
            number=at + 1,
            count=len(points),
        )
    return points


def _plane_table(plane: Plane) -> Any:
    return inline(
        {
            "origin": numbers(plane.origin),
            "normal": _direction(plane.axes[:, 2]),
            "x_axis": _direction(plane.axes[:, 0]),
        }
    )


def _direction(vector: Float) -> Any:
    rounded = [round(float(x), _DIRECTION_DECIMALS) for x in vector]
    return [int(x) if x == int(x) else x for x in rounded]
