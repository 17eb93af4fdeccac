"""Changes to cords: their planes, paths and freedoms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, catmull_rom
from ...core.device.device import FREEDOMS, Sensor
from ...core.errors import DeviceError
from .edit import Edit
from .tables import append, index, inline, named, number, numbers, remove, rows, strings

_KEY = "sensors"


def add_cord(name: str, plane: Plane, curve: Hermite, free: Sequence[str] = ()) -> Edit:
    """A cord along a `curve` in a `plane`; its tangents are written where they are not those that
    the points give."""

    def change(document: TOMLDocument) -> None:
        values: dict[str, Any] = {
            "name": name,
            "plane": _plane(plane),
            "control_points": numbers(curve.points),
        }
        if not np.allclose(curve.tangents, catmull_rom(curve.points), atol=1e-3):
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
    """All cords anew, as the optimiser has left them; what was free stays free."""

    def change(document: TOMLDocument) -> None:
        free = {str(row["name"]): row.get("free") for row in rows(document, _KEY)}
        for k in reversed(range(len(rows(document, _KEY)))):
            remove(document, _KEY, k)
        for sensor in sensors:
            given = free.get(sensor.name, ["path"])
            add_cord(sensor.name, sensor.plane, sensor.curve, given or ()).change(document)
        design: Any = document.get("design", {})
        if "sensors" in design and design["sensors"] <= len(sensors):
            design.pop("sensors")  # all of them are drawn now

    return Edit("take the optimised cords", change)


def rename_cord(name: str, to: str) -> Edit:
    """Another name for a cord."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["name"] = to

    return Edit(f"rename `{name}` to `{to}`", change)


def move_point(name: str, at: int, to: Float) -> Edit:
    """Control point `at` of a cord to (2,) mm in its plane."""

    def change(document: TOMLDocument) -> None:
        points = _points(document, name, at)
        for k in range(2):
            points[at][k] = number(to[k])

    return Edit(f"move control point {at + 1} of `{name}`", change)


def insert_point(name: str, before: int, place: Float) -> Edit:
    """A control point before another, at (2,) mm; tangents that are written get one that goes from
    its neighbour to the other."""

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        points = _points(document, name, before, last=1)
        if "tangents" in cord:
            after = min(max(before, 1), len(points) - 1)
            along = np.array(points[after], float) - np.array(points[after - 1], float)
            cord["tangents"].insert(before, numbers(along / 2))
        points.insert(before, numbers(place))

    return Edit(f"add a control point to `{name}`", change)


def delete_point(name: str, at: int) -> Edit:
    """Delete a control point, and its tangent."""

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        del _points(document, name, at)[at]
        if "tangents" in cord:
            del cord["tangents"][at]

    return Edit(f"delete control point {at + 1} of `{name}`", change)


def set_path(name: str, curve: Hermite) -> Edit:
    """Another curve in the same plane."""

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        cord["control_points"] = numbers(curve.points)
        if np.allclose(curve.tangents, catmull_rom(curve.points), atol=1e-3):
            cord.pop("tangents", None)
        else:
            cord["tangents"] = numbers(curve.tangents)

    return Edit(f"redraw `{name}`", change)


def bend_at(name: str, at: int, curve: Hermite) -> Edit:
    """Another tangent at a control point; all are written, as those that the points give are not
    any more."""

    def change(document: TOMLDocument) -> None:
        points = _points(document, name, at)
        if len(points) != len(curve.tangents):
            raise DeviceError(f"device.toml: `{name}` has {len(points)} control points now")
        named(document, _KEY, name)["tangents"] = numbers(curve.tangents)

    return Edit(f"bend `{name}` at control point {at + 1}", change)


def smooth(name: str) -> Edit:
    """Tangents follow from the points again."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name).pop("tangents", None)

    return Edit(f"smooth `{name}`", change)


def set_plane(name: str, plane: Plane) -> Edit:
    """Another plane; the path stays as it is in it."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["plane"] = _plane(plane)

    return Edit(f"move the plane of `{name}`", change)


def set_freedoms(name: str, free: Sequence[str]) -> Edit:
    """What the optimiser may move: none of it is a lock."""
    order = [word for word in FREEDOMS if word in free]

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        if order or "free" in cord:
            cord["free"] = strings(order)

    told = "free " + " and ".join(order) if order else "lock"
    return Edit(f"{told} of `{name}`" if order else f"{told} `{name}`", change)


def mirror_cord(name: str, to: str, origin: Float, normal: Float) -> Edit:
    """A copy of a cord beyond the plane through `origin` (3,) mm with a `normal` (3,)."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)

    def change(document: TOMLDocument) -> None:
        cord = named(document, _KEY, name)
        told = cord["plane"].unwrap()
        axes = {key: np.array(told[key], float) for key in ("normal", "x_axis")}
        place = np.array(told["origin"], float)
        mirrored = {
            "origin": place - 2 * n * ((place - origin) @ n),
            "x_axis": axes["x_axis"] - 2 * n * (axes["x_axis"] @ n),
        }
        # The second axis of the plane is normal x x_axis, which a reflection turns round.
        mirrored["normal"] = -(axes["normal"] - 2 * n * (axes["normal"] @ n))
        values = {key: value for key, value in cord.unwrap().items() if key != "plane"}
        plane = inline({k: numbers(mirrored[k]) for k in ("origin", "normal", "x_axis")})
        for key in ("control_points", "tangents"):
            if key in values:
                values[key] = numbers(values[key])
        append(document, _KEY, {"name": to, "plane": plane} | {**values, "name": to})

    return Edit(f"mirror `{name}` to `{to}`", change)


def cord_names(document: TOMLDocument) -> list[str]:
    """In their order."""
    return [str(row["name"]) for row in rows(document, _KEY)]


def _points(document: TOMLDocument, name: str, at: int, last: int = 0) -> Any:
    points = named(document, _KEY, name)["control_points"]
    if not 0 <= at < len(points) + last:
        raise DeviceError(
            f"device.toml: `{name}` has no control point {at + 1} any more; it has {len(points)}"
        )
    return points


def _plane(plane: Plane) -> Any:
    return inline(
        {"origin": numbers(plane.origin), "normal": _direction(plane.axes[:, 2]),
         "x_axis": _direction(plane.axes[:, 0])}
    )  # fmt: skip


def _direction(vector: Float) -> Any:
    """To a millionth: a thousandth turns the ends of a long plane out of place."""
    rounded = [round(float(x), 6) for x in vector]
    return [int(x) if x == int(x) else x for x in rounded]
