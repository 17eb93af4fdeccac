"""The table `[cord]` of `device.toml`: the kind of cord, or the printed traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from ..response import MeasuredResponse, ResponseSpec, read_measured, read_response
from ..schema.declare import (
    NonNegative,
    Positive,
    Problem,
    Table,
    key,
    missing,
    unknown_choice,
)
from ..storage.package_data import read_rows
from .device import COMPRESSION_FACTORS, CordSpec
from .filaments import TraceSpec, read_filaments

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


#: What senses: cords that are inserted, or traces that are printed with the body.
PROCESSES = ("cord", "printed")
#: Keys that only cords have, and keys that only traces have.
_CORD_KEYS = ("name", "diameter", "ohm_per_mm", "ferrule_diameter", "ferrule_length", "length")
_TRACE_KEYS = ("trace", "width", "height", "resistivity", "between_layers")
#: Quantities of a filament that a device must state without a row.
_TRACE_SHEET = ("resistivity", "gauge_factor", "max_strain", "modulus")
#: Of a filament without a row, as assumed for the rows.
_ASSUMED_FILAMENT = {
    "across": 2.0, "between_layers": 3.0, "min_width": 0.8, "min_height": 0.6,
    "noise": 0.003, "contact": 50.0, "spread": 0.15,
}  # fmt: skip
_TRACE_WIDTH_MM, _TRACE_HEIGHT_MM = 1.2, 0.8  # three lines of a 0.4 mm nozzle, four layers
_MIN_BEND_WIDTHS = 2.0  # smallest radius of a trace's path, in widths


class CordTable(Table, frozen=True):
    """The conductive cord, or the printed traces, that sense the deformation."""

    process: Annotated[
        str,
        key(
            "Whether `cord`s are inserted between parts, or traces are `printed` inside one part"
            " with a second, conductive filament (`docs/printed.md`).",
            choices=PROCESSES,
        ),
    ] = PROCESSES[0]
    trace: Annotated[
        str | None,
        key(
            "Conductive filament of printed traces, in `data/traces.csv`, or any name together with"
            " `resistivity`, `gauge_factor`, `max_strain` and `modulus`.",
            default='required with `process = "printed"`',
        ),
    ] = None
    width: Annotated[
        Positive | None, key("Width of a printed trace.", unit="mm", default="`1.2`")
    ] = None
    height: Annotated[
        Positive | None,
        key("Height of a printed trace in the direction of printing.", unit="mm", default="`0.8`"),
    ] = None
    resistivity: Annotated[
        Positive | None,
        key(
            "Resistivity of a printed trace along its beads: ten times the ohm cm that sellers"
            " give, and more, as printing raises it.",
            unit="Ω mm",
            default="the filament's",
        ),
    ] = None
    between_layers: Annotated[
        Positive | None,
        key(
            "Resistivity of a printed trace from layer to layer, as a multiple of `resistivity`.",
            default="the filament's",
        ),
    ] = None
    name: Annotated[
        str | None,
        key(
            "Name in `defsense list cords`, or any name together with the next four keys.",
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
        float | None,
        key(
            "(R - R0)/R0 divided by the strain: 2 if the resistance doubles at 50 %; negative for"
            " filaments whose resistance falls.",
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
    def is_printed(self) -> bool:
        """Whether traces are printed."""
        return self.process == "printed"

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
        others = _CORD_KEYS if self.is_printed else _TRACE_KEYS
        for name in others:
            if getattr(self, name) is not None:
                text = f'is not for process = "{self.process}"'
                yield Problem((name,), text, "key-not-applicable", "Remove it")
        if self.response is not None and self.compression is not None:
            text = "the measured response includes it"
            yield Problem(("compression",), text, "keys-exclusive", "Remove it, or 'response'")
        if self.gauge_factor is not None and not (
            self.gauge_factor > 0 or (self.is_printed and self.gauge_factor < 0)
        ):
            text = "must be more than 0" if not self.is_printed else "must not be 0"
            yield Problem(("gauge_factor",), text, "out-of-range", "Calibrate it")
        yield from self._check_trace() if self.is_printed else self._check_cord()

    def _check_trace(self) -> Iterator[Problem]:
        filaments = read_filaments()
        if self.trace is None:
            yield missing("trace")
            return
        if self.trace not in filaments:
            absent = [name for name in _TRACE_SHEET if getattr(self, name) is None]
            if len(absent) == len(_TRACE_SHEET):
                yield unknown_choice(
                    ("trace",), self.trace, filaments, "conductive filament", "unknown-filament"
                )
            else:
                yield from map(missing, absent)
            return
        for name in ("width", "height"):
            least, value = self._filament(f"min_{name}"), getattr(self, name)
            if value is not None and value < least:
                text = f"a trace of {self.trace} needs at least {least:g} mm"
                yield Problem((name,), text, "trace-too-thin", "Increase it")

    def _filament(self, quantity: str) -> float:
        """Return a quantity of the filament, assumed where there is no row."""
        row = read_filaments().get(self.trace or "", {})
        return row[quantity].value if quantity in row else _ASSUMED_FILAMENT[quantity]

    def _check_cord(self) -> Iterator[Problem]:
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
        numbers = self._trace_numbers() if self.is_printed else self._numbers()
        compression = self.compression or self._row.get("compression", "same")
        response = _data_sheet_response(numbers.pop("gauge_factor"), compression)
        measured: MeasuredResponse | None = None
        if self.response is not None:
            compression = "measured"
            response = read_response(folder / self.response)
            measured = read_measured(folder / self.response)
        return CordSpec(
            name=self.trace or self.name or "custom",
            response=response,
            lengths=self.length or (0.0, float("inf")),
            compression=compression,
            measured=measured,
            trace=self._trace_spec() if self.is_printed else None,
            **numbers,
        )

    def _trace_spec(self) -> TraceSpec:
        assert self.trace is not None
        return TraceSpec(
            self.trace,
            self.width or _TRACE_WIDTH_MM,
            self.height or _TRACE_HEIGHT_MM,
            self.resistivity or self._filament("resistivity"),
            self._filament("across"),
            self.between_layers or self._filament("between_layers"),
            self.modulus or self._filament("young_modulus"),
            self._filament("spread"),
        )

    def _trace_numbers(self) -> dict[str, float]:
        """Return the numbers that traces share with cords."""
        trace = self._trace_spec()
        given = ("gauge_factor", "max_strain", "noise", "contact")
        bend = self.min_bend_radius or _MIN_BEND_WIDTHS * trace.width
        stated = {name: getattr(self, name) for name in given}
        return {
            name: self._filament(name) if value is None else value for name, value in stated.items()
        } | {
            "diameter": trace.diameter,
            "ohm_per_mm": trace.resistivity / trace.area,
            "min_bend_radius": bend,
            "modulus": trace.young_modulus,
            "min_stretch": 10 * trace.width if self.min_stretch is None else self.min_stretch,
        }


def _data_sheet_response(gauge_factor: float, compression: str) -> ResponseSpec:
    """Return the response of a cord of which only the behaviour in tension is known."""
    if COMPRESSION_FACTORS[compression] == 1:
        return ResponseSpec.line(gauge_factor)
    slopes = {
        "tension": gauge_factor,
        "compression": gauge_factor * COMPRESSION_FACTORS[compression],
    }
    return ResponseSpec("two-slopes", slopes)
