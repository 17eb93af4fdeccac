"""The tables `[cord]` and `[[sensors]]` of `device.toml`: the kind of cord, and drawn cords."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from ..curve import Hermite, Plane, catmull_rom
from ..response import MeasuredResponse, ResponseSpec, read_measured, read_response
from ..schema.declare import (
    NonNegative,
    Positive,
    Problem,
    Table,
    Vector,
    key,
    missing,
    unknown_choice,
)
from ..storage.package_data import read_rows
from .device import COMPRESSION_FACTORS, FREEDOMS, CordSpec, Sensor

#: Keys that replace a row of the catalogue, all from the data sheet of a cord.
SHEET = ("diameter", "ohm_per_mm", "gauge_factor", "max_strain")
#: Further keys with a number in each row.
_ASSUMED = (
    "min_bend_radius",
    "ferrule_diameter",
    "ferrule_length",
    "modulus",
    "noise",
    "contact",
    "min_stretch",
)
_ROWS = "cords.csv"
_SHEET_DEFAULT = "the row's; required without a row"
_MIN_POINT_DISTANCE_MM = 1e-6
_Points = list[tuple[float, float]]


class CordTable(Table, frozen=True):
    """The conductive cord that senses the deformation."""

    name: Annotated[
        str | None,
        key(
            "Row of `data/cords.csv`, or any name together with the next four keys.",
            default='required; `"custom"` with the next four keys',
        ),
    ] = None
    diameter: Annotated[
        Positive | None, key("Diameter of the cord.", unit="mm", default=_SHEET_DEFAULT)
    ] = None
    ohm_per_mm: Annotated[
        Positive | None,
        key(
            "Resistance at rest: a tenth of the ohm/cm that sellers give.",
            unit="Ω/mm",
            default=_SHEET_DEFAULT,
        ),
    ] = None
    gauge_factor: Annotated[
        Positive | None,
        key(
            "(R - R0)/R0 divided by the strain: 2 if the resistance doubles at 50 %.",
            default=_SHEET_DEFAULT,
        ),
    ] = None
    max_strain: Annotated[
        Positive | None,
        key("Largest strain that the cord withstands, 0.5 for 50 %.", default=_SHEET_DEFAULT),
    ] = None
    min_bend_radius: Annotated[
        Positive | None,
        key(
            "Smallest radius of the channel's centre line.",
            unit="mm",
            default="the row's, or 2.5 diameters",
        ),
    ] = None
    ferrule_diameter: Annotated[
        Positive | None,
        key(
            "Outer diameter of the ferrule that joins cord and wire.",
            unit="mm",
            default="the row's, or the diameter and 0.6",
        ),
    ] = None
    ferrule_length: Annotated[
        Positive | None, key("Length of that ferrule.", unit="mm", default="the row's, or 7")
    ] = None
    modulus: Annotated[
        Positive | None,
        key("Young's modulus of the cord's rubber.", unit="MPa", default="the row's, or 3"),
    ] = None
    noise: Annotated[
        Positive | None,
        key(
            "Standard deviation of a reading of (R - R0)/R0, whatever the cord's length.",
            default="the row's, or 0.002",
        ),
    ] = None
    contact: Annotated[
        NonNegative | None,
        key(
            "Standard deviation of the resistance of each joint of cord and wire, which affects"
            " short cords most.",
            unit="Ω",
            default="the row's, or 1",
        ),
    ] = None
    min_stretch: Annotated[
        NonNegative | None,
        key(
            "Smallest stretched length between a cord's ends; shorter cords are not proposed, and"
            " drawn ones are refused.",
            unit="mm",
            default="the row's, or 10 diameters",
        ),
    ] = None
    compression: Annotated[
        str | None,
        key(
            "Behaviour of bonded cords below zero strain, which data sheets omit: `same` slope as"
            " in tension, `half` of it, `none`, or `rising` resistance both ways; not together"
            " with `response`.",
            default="the row's, or `same`",
            choices=COMPRESSION_FACTORS,
        ),
    ] = None
    response: Annotated[
        str | None,
        key(
            "File `response.json` of `defsense calibrate fit`, in place of the gauge factor and"
            " `compression`: signals follow it, strains outside its range are reported, and built"
            " devices scatter by the spread of the measured pieces.",
            default="none",
        ),
    ] = None
    length: Annotated[
        tuple[float, float] | None,
        key(
            "Smallest and largest length, `[min, max]`, of the pieces that you have, free ends"
            " included; layouts keep to it, and drawn cords that do not are refused.",
            unit="mm",
            default="any",
        ),
    ] = None

    @property
    def _row(self) -> Mapping[str, str]:
        return read_rows(_ROWS).get(self.name or "", {})

    def _number(self, name: str) -> float | None:
        """Return the number of a key, or that of the row."""
        value: float | None = getattr(self, name)
        if value is None and name in self._row:
            return float(self._row[name])
        return value

    def check(self) -> Iterator[Problem]:
        """Yield problems of values that are missing, or that exclude each other."""
        has_sheet = any(getattr(self, name) is not None for name in SHEET)
        rows = read_rows(_ROWS)
        if not has_sheet and self.name not in rows:
            if self.name is None:
                yield missing("name")
            else:
                yield unknown_choice(("name",), self.name, rows, "cord", "unknown-cord")
            return
        absent = [name for name in SHEET if self._number(name) is None]
        yield from map(missing, absent)
        if not absent:
            numbers = self._numbers()
            if numbers["ferrule_diameter"] <= numbers["diameter"]:
                yield Problem(
                    ("ferrule_diameter",),
                    f"must be more than the cord's {numbers['diameter']:g} mm",
                    "ferrule-too-thin",
                )
        if self.response is not None and self.compression is not None:
            text = "the measured response includes it"
            yield Problem(("compression",), text, "keys-exclusive", "Remove it, or 'response'")
        if self.length is not None and not 0 <= self.length[0] <= self.length[1] - 1:
            yield Problem(
                ("length",),
                "needs a smallest length, and a largest one that is at least 1 mm more",
                "out-of-range",
                "Write it as in [100, 400]",
            )

    def check_length(self, lead: float) -> Iterator[Problem]:
        """Yield a problem if two free ends of `lead` mm use up the longest piece."""
        if self.length is not None and self.length[1] < 2 * lead + 1:
            yield Problem(
                ("length",),
                f"a piece of {self.length[1]:g} mm is used up by its two free ends of {lead:g} mm"
                " ([fabrication] lead)",
                "cord-too-short",
                "Give longer pieces, or a shorter lead",
            )

    def _numbers(self) -> dict[str, float]:
        """Return all numbers of the cord.

        Those that no data sheet gives follow the rules by which the catalogue's were assumed.
        """
        numbers = {name: self._number(name) for name in (*SHEET, *_ASSUMED)}
        diameter = numbers["diameter"] or 0.0
        assumed = {
            "min_bend_radius": 2.5 * diameter,
            "ferrule_diameter": diameter + 0.6,
            "ferrule_length": 7.0,
            "modulus": 3.0,
            "noise": 0.002,
            "contact": 1.0,
            "min_stretch": 10 * diameter,
        }
        return {name: assumed[name] if v is None else v for name, v in numbers.items()}

    def record(self, folder: Path) -> CordSpec:
        """Return the cord, completed from its row.

        Args:
            folder: Folder of `device.toml`, where the measured response is.

        Raises:
            CalibrationError: if the measured response cannot be read.
        """
        numbers = self._numbers()
        compression = self.compression or self._row.get("compression", "same")
        response = _data_sheet_response(numbers.pop("gauge_factor"), compression)
        measured: MeasuredResponse | None = None
        if self.response is not None:
            compression = "measured"
            response = read_response(folder / self.response)
            measured = read_measured(folder / self.response)
        return CordSpec(
            name=self.name or "custom",
            response=response,
            lengths=self.length or (0.0, float("inf")),
            compression=compression,
            measured=measured,
            **numbers,
        )


def _data_sheet_response(gauge_factor: float, compression: str) -> ResponseSpec:
    """Return the response of a cord of which only the behaviour in tension is known."""
    if COMPRESSION_FACTORS[compression] == 1:
        return ResponseSpec.line(gauge_factor)
    slopes = {
        "tension": gauge_factor,
        "compression": gauge_factor * COMPRESSION_FACTORS[compression],
    }
    return ResponseSpec("two-slopes", slopes)


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
    """A cord that is drawn: points in a plane."""

    name: Annotated[str, key("Name of the cord, which no other has.")]
    plane: Annotated[
        PlaneTable, key("Plane in which the cord lies, and along which the body is cut.")
    ]
    control_points: Annotated[
        Annotated[_Points, Meta(min_length=4)],
        key(
            "Points of the cord in its plane; the first and last two are the ends and stay in"
            " place.",
            unit="mm",
            form="a list of at least 4 points [x, y]",
        ),
    ]
    tangents: Annotated[
        _Points | None,
        key(
            "Tangents in the plane, one for each control point.",
            unit="mm",
            form="a list of [x, y], one for each control point",
            default="Catmull-Rom",
        ),
    ] = None
    free: Annotated[
        tuple[str, ...],
        key(
            "What the optimiser may change: the `path`, with it the `plane`, or its `offset` only,"
            " which keeps the direction; `[]` keeps the cord as drawn.",
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

    def _check_curve(self) -> Iterator[Problem]:
        steps = np.diff(self.control_points, axis=0)
        if (np.linalg.norm(steps, axis=1) < _MIN_POINT_DISTANCE_MM).any():
            text = "two neighbours coincide"
            yield Problem(("control_points",), text, "points-coincide", "Move or remove one")
        elif self.tangents is not None and len(self.tangents) != len(self.control_points):
            expected = (len(self.control_points), 2)
            text = f"must be one [x, y] for each control point, not {len(self.tangents)}"
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
            return catmull_rom(np.array(self.control_points))
        return np.array(self.tangents)

    def record(self) -> Sensor:
        """Return the cord."""
        curve = Hermite(np.array(self.control_points), self._tangents)
        return Sensor(self.name, self.plane.record(), curve, frozenset(self.free))
