"""The table `[fabrication]` of `device.toml`: printer, parts and joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated

from msgspec import Meta

from ..schema.declare import Count, NonNegative, Positive, Problem, Table, Vector, key
from ..storage.package_data import read_rows
from .device import ASSEMBLIES, FabricationSpec
from .fabrication_limits import BedSize, Copies

_ROWS = "printers.csv"
_WallLength = Annotated[float, Meta(gt=0, le=1000)]
_Length = Annotated[float, Meta(ge=0, le=1000)]


class FabricationTable(Table, frozen=True):
    """How the device is made."""

    process: Annotated[
        str | None,
        key(
            "Name in `defsense list printers`, which has its walls, clearances and bed.",
            choices=_ROWS,
        ),
    ] = None
    clearance: Annotated[
        _Length | None,
        key(
            "Clearance of a cord in its channel, on the diameter; print the fit coupon to measure"
            " it.",
            unit="mm",
            rows=_ROWS,
        ),
    ] = None
    wall: Annotated[
        _WallLength | None,
        key("Thinnest wall between a channel and the surface.", unit="mm", rows=_ROWS),
    ] = None
    lead: Annotated[
        _Length, key("Free cord at each end, where there are no pockets.", unit="mm")
    ] = 20.0
    line: Annotated[
        Positive | None, key("Width of a line from the nozzle.", unit="mm", rows=_ROWS)
    ] = None
    layer: Annotated[Positive | None, key("Height of a layer.", unit="mm", rows=_ROWS)] = None
    hole: Annotated[
        NonNegative | None, key("Smallest hole that stays open.", unit="mm", rows=_ROWS)
    ] = None
    rate: Annotated[
        Positive | None,
        key(
            "Volume that the printer extrudes per second: it gives the printing speed and time.",
            unit="mm³/s",
            rows=_ROWS,
        ),
    ] = None
    bed: Annotated[
        tuple[BedSize, BedSize, BedSize] | None,
        key("Width, depth and height that your printer can make.", unit="mm", default="the row's"),
    ] = None
    copies: Annotated[
        Copies,
        key("Number of devices on the plates (`docs/fabrication.md`)."),
    ] = 1
    assembly: Annotated[
        str,
        key(
            "How cords are built in: `held` at their ends, so that they slide between them, or"
            " `bonded` into their grooves along their whole length (`docs/held-or-bonded.md`).",
            choices=ASSEMBLIES,
        ),
    ] = ASSEMBLIES[0]
    prestretch: Annotated[
        NonNegative | None,
        key(
            "Share of its length by which a held cord is stretched when it is inserted, below the"
            " strain that it withstands.",
            default="as much as it needs",
        ),
    ] = None
    pockets: Annotated[
        bool, key("Whether the body has pockets for the joints of cord and wire.")
    ] = True
    limit_cuts: Annotated[bool, key("Whether planes cut no further than their cords need.")] = False
    strain_relief: Annotated[
        bool | None,
        key(
            "Whether wires leave their pockets by a bend.",
            default="unless that raises the predicted error by more than 5 %",
        ),
    ] = None
    wire_diameter: Annotated[
        Positive, key("Outer diameter of a wire, less than that of the cord's ferrule.", unit="mm")
    ] = 1.1
    marker_seats: Annotated[
        Count | None, key("Number of flats for camera tags.", default="none")
    ] = None
    marker_size: Annotated[Positive, key("Side of a tag.", unit="mm")] = 10.0
    keep_whole: Annotated[
        tuple[str, ...],
        key(
            "Regions that no joint, channel, wire or pin may cross, such as bolt holes and buttons:"
            " boxes, balls or cylinders."
        ),
    ] = ()
    up: Annotated[
        Vector,
        key("Direction that points up as a body with printed traces is printed."),
    ] = (0.0, 0.0, 1.0)
    mould_wall: Annotated[
        Annotated[float, Meta(gt=2)] | None,
        key("Thickness of the moulds' walls, with a process that casts.", unit="mm", default="`5`"),
    ] = None
    shrinkage: Annotated[
        Annotated[float, Meta(ge=0, le=0.1)] | None,
        key(
            "Linear shrinkage of the silicone, as a share of the length, with a process that"
            " casts.",
            default="the one in `defsense list silicones`",
        ),
    ] = None

    @property
    def row(self) -> Mapping[str, str]:
        """The row of the process."""
        rows = read_rows(_ROWS)
        return rows[self.process or next(iter(rows))]

    def check(self) -> Iterator[Problem]:
        """Yield problems of keys that do not apply to the process."""
        if not any(self.up):
            yield Problem(("up",), "must not be zero", "zero-vector", "Give it a direction")
        if self.row["kind"] == "cast":
            for name, text in (
                ("limit_cuts", "parts that wrap round the end of a cut cannot be cast"),
                ("rate", "the time to print moulds is not estimated"),
            ):
                if getattr(self, name):
                    yield Problem((name,), text, "key-not-applicable", "Remove it")
            return
        for name in ("mould_wall", "shrinkage"):
            if getattr(self, name) is not None:
                yield Problem(
                    (name,),
                    f"is for moulds, and process {self.row['name']!r} prints the parts themselves",
                    "key-not-applicable",
                    "Remove it",
                )

    def record(self) -> FabricationSpec:
        """Return the settings, completed from the row of the process."""
        row = self.row

        def number(name: str) -> float:
            value: float | None = getattr(self, name)
            return float(row[name]) if value is None else value

        x, y, z = self.bed or (float(row[f"bed_{axis}"]) for axis in "xyz")
        return FabricationSpec(
            process=row["name"],
            clearance=number("clearance"),
            wall=number("wall"),
            lead=self.lead,
            bed=(x, y, z),
            pockets=self.pockets,
            limit_cuts=self.limit_cuts,
            strain_relief=self.strain_relief,
            wire_diameter=self.wire_diameter,
            marker_seats=self.marker_seats or 0,
            marker_size=self.marker_size,
            assembly=self.assembly,
            prestretch=self.prestretch,
            kind=row["kind"],
            line=number("line"),
            layer=number("layer"),
            hole=number("hole"),
            spacing=float(row["spacing"]),
            copies=self.copies,
            mould_wall=FabricationSpec.mould_wall if self.mould_wall is None else self.mould_wall,
            shrinkage=self.shrinkage,
            up=_normalize(self.up),
            keep_whole=self.keep_whole,
            rate=self._rate(),
        )

    def _rate(self) -> float | None:
        """Return the extruded volume per second: the row's speed with other lines or layers."""
        row = self.row
        if self.rate is not None or not row["rate"]:
            return self.rate
        line, layer = float(row["line"]), float(row["layer"])
        size = (self.line or line) * (self.layer or layer)
        return float(row["rate"]) * size / (line * layer)


def _normalize(vector: Vector) -> Vector:
    length = math.hypot(*vector) or 1.0
    x, y, z = (component / length for component in vector)
    return x, y, z
