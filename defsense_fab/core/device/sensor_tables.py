"""The tables `[[sensors]]` of `device.toml`: cords and traces that are drawn, and their names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from string import ascii_uppercase
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from ..curve import REST_FRAME, Hermite, Plane, catmull_rom
from ..schema.declare import Problem, Table, Vector, key
from .device import FREEDOMS, Sensor

_MIN_POINT_DISTANCE_MM = 1e-6


class PlaneTable(Table, frozen=True):
    """The plane of a cord, along which the body is cut."""

    origin: Annotated[
        Vector, key("Point of the plane at which its coordinates are zero.", unit="mm")
    ]
    normal: Annotated[Vector, key("Normal of the plane, of any length but zero.")]
    x_axis: Annotated[Vector, key("Direction of the first coordinate, across the normal.")]

    def check(self) -> Iterator[Problem]:
        """Yield a problem if the directions do not make a plane."""
        try:
            self.record()
        except ValueError as error:
            yield Problem((), str(error), "plane-invalid")

    def record(self) -> Plane:
        """Return the plane."""
        return Plane.from_normal(*map(np.array, (self.origin, self.normal, self.x_axis)))


class SensorTable(Table, frozen=True):
    """A cord or printed trace that is drawn: points in a plane, or in space for a trace."""

    name: Annotated[str, key("Name of the cord or trace, which no other has.")]
    control_points: Annotated[
        Annotated[list[list[float]], Meta(min_length=4)],
        key(
            "Points `[x, y]` in the plane, or `[x, y, z]` of the device without a plane; the first"
            " and last two are the ends and stay in place.",
            unit="mm",
            form="a list of at least 4 points [x, y] or [x, y, z]",
        ),
    ]
    plane: Annotated[
        PlaneTable | None,
        key(
            "Plane of the cord, along which the body is cut.",
            default="none: a printed trace in space",
        ),
    ] = None
    tangents: Annotated[
        list[list[float]] | None,
        key(
            "Tangents, one for each control point.",
            unit="mm",
            form="a list of [x, y] or [x, y, z], one for each control point",
            default="Catmull-Rom",
        ),
    ] = None
    free: Annotated[
        tuple[str, ...],
        key(
            "What the optimizer may change: the `path`, with it the `plane`, or its `offset` only,"
            " which keeps the direction; with a path in space also its `ends`; `[]` keeps the cord"
            " as drawn.",
            choices=FREEDOMS,
        ),
    ] = ()

    def check(self) -> Iterator[Problem]:
        """Yield problems of points and tangents that make no curve, and of freedoms."""
        with np.errstate(over="ignore", invalid="ignore"):  # huge numbers end as not finite
            yield from self._check_curve()
        if {"plane", "offset"} <= set(self.free):
            yield Problem(
                ("free",),
                "a free plane may also shift",
                "keys-exclusive",
                "Leave out either 'plane' or 'offset'",
            )

        allowed = {"path", "ends"} if self.plane is None else {"path", "plane", "offset"}
        if extra := sorted(set(self.free) - allowed):
            where = "in space" if self.plane is None else "in a plane"
            text = f"{extra[0]!r} does not apply to a path {where}"
            yield Problem(("free",), text, "key-not-applicable", "Remove it")

    def _check_curve(self) -> Iterator[Problem]:
        size = 3 if self.plane is None else 2
        for name in ("control_points", "tangents"):
            for point in getattr(self, name) or ():
                if len(point) != size:
                    form = "[x, y, z] without a plane" if size == 3 else "[x, y] in its plane"
                    text = f"{point} is not {form}"
                    yield Problem((name,), text, "wrong-shape", data={"expected": size})
                    return
        steps = np.diff(self.control_points, axis=0)
        if (np.linalg.norm(steps, axis=1) < _MIN_POINT_DISTANCE_MM).any():
            text = "two neighbours coincide"
            yield Problem(("control_points",), text, "points-coincide", "Move or remove one")
        elif self.tangents is not None and len(self.tangents) != len(self.control_points):
            expected = (len(self.control_points), size)
            text = f"must be one for each control point, not {len(self.tangents)}"
            yield Problem(("tangents",), text, "wrong-shape", data={"expected": expected})
        elif (np.linalg.norm(self._tangents, axis=1) < _MIN_POINT_DISTANCE_MM).any():
            yield Problem(("tangents",), "a tangent is zero", "zero-vector", "Give it a direction")
        else:
            try:
                Hermite(np.array(self.control_points), self._tangents)
            except ValueError as error:
                yield Problem(("control_points",), str(error), "not-finite")

    @property
    def _tangents(self) -> Any:
        if self.tangents is None:
            return catmull_rom(np.array(self.control_points, float))
        return np.array(self.tangents, float)

    def record(self) -> Sensor:
        """Return the cord or trace."""
        curve = Hermite(np.array(self.control_points, float), self._tangents)
        plane = REST_FRAME if self.plane is None else self.plane.record()
        return Sensor(self.name, plane, curve, frozenset(self.free))


def new_sensor_names(taken: Iterable[str]) -> Iterator[str]:
    """Yield names for new sensors: A to Z, then AA, AB and so on.

    They say nothing of the place, which a search changes.

    Args:
        taken: Names of other sensors, which are not used again, in upper or lower case.
    """
    names = {name.upper() for name in taken}
    pairs = (a + b for a in ascii_uppercase for b in ascii_uppercase)
    return (name for name in chain(ascii_uppercase, pairs) if name not in names)
