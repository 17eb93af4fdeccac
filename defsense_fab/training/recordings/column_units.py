"""Names and units of columns, from headers such as `angle_deg`, `angle [deg]` or `left_kohm`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ...decoding.quantities import RELATIVE

_BRACKETED = re.compile(r"^(.*?)[\s_]*[\[(]\s*([^\])]*)\s*[\])]$")
_AXES = re.compile(r"^(.*?)[_.\s]?([xyzXYZ])$")


@dataclass(frozen=True)
class Unit:
    """A unit that is converted to another one of its kind.

    Attributes:
        kind: The quantity, such as "length".
        name: Unit that values are converted to.
        factor: Values in that unit per value in this one.
    """

    kind: str
    name: str
    factor: float = 1.0


_OHM, _FARAD, _VOLT = "resistance", "capacitance", "voltage"
LENGTH = "length"
_ANGLE, _FORCE, _PRESSURE, _TIME = "angle", "force", "pressure", "time"
#: Units by their spelling; those of one letter count in brackets and after an underscore only.
_UNITS = {
    "mm": Unit(LENGTH, "mm"),
    "cm": Unit(LENGTH, "mm", 10.0),
    "m": Unit(LENGTH, "mm", 1000.0),
    "um": Unit(LENGTH, "mm", 1e-3),
    "inch": Unit(LENGTH, "mm", 25.4),
    "deg": Unit(_ANGLE, "deg"),
    "degree": Unit(_ANGLE, "deg"),
    "degrees": Unit(_ANGLE, "deg"),
    "°": Unit(_ANGLE, "deg"),
    "rad": Unit(_ANGLE, "deg", 180 / math.pi),
    "mrad": Unit(_ANGLE, "deg", 0.18 / math.pi),
    "N": Unit(_FORCE, "N"),
    "mN": Unit(_FORCE, "mN"),
    "kN": Unit(_FORCE, "kN"),
    "Nm": Unit("torque", "Nm"),
    "Nmm": Unit("torque", "Nmm"),
    "Pa": Unit(_PRESSURE, "Pa"),
    "kPa": Unit(_PRESSURE, "kPa"),
    "MPa": Unit(_PRESSURE, "MPa"),
    "bar": Unit(_PRESSURE, "bar"),
    "mbar": Unit(_PRESSURE, "mbar"),
    "percent": Unit("share", "%"),
    "%": Unit("share", "%"),
    "ohm": Unit(_OHM, "ohm"),
    "ohms": Unit(_OHM, "ohm"),
    "Ω": Unit(_OHM, "ohm"),
    "kohm": Unit(_OHM, "ohm", 1e3),
    "kohms": Unit(_OHM, "ohm", 1e3),
    "kΩ": Unit(_OHM, "ohm", 1e3),
    "Mohm": Unit(_OHM, "ohm", 1e6),
    "MΩ": Unit(_OHM, "ohm", 1e6),
    "pF": Unit(_FARAD, "pF"),
    "nF": Unit(_FARAD, "pF", 1e3),
    "uF": Unit(_FARAD, "pF", 1e6),
    "V": Unit(_VOLT, "V"),
    "mV": Unit(_VOLT, "V", 1e-3),
    "uV": Unit(_VOLT, "V", 1e-6),
    "mA": Unit("current", "mA"),
    "uH": Unit("inductance", "uH"),
    "counts": Unit("counts", "counts"),
    "count": Unit("counts", "counts"),
    "adc": Unit("counts", "counts"),
    "lsb": Unit("counts", "counts"),
    "raw": Unit("counts", "counts"),
    "s": Unit(_TIME, "s"),
    "sec": Unit(_TIME, "s"),
    "ms": Unit(_TIME, "s", 1e-3),
    "us": Unit(_TIME, "s", 1e-6),
    "ns": Unit(_TIME, "s", 1e-9),
    "min": Unit(_TIME, "s", 60.0),
}
_CASES = {n.casefold(): unit for n, unit in _UNITS.items() if n.islower() and len(n) > 1}
_RELATIVE = ("(R-R0)/R0", "(R - R0)/R0", "dR/R0", "dR/R", "ΔR/R0", "ΔR/R")
_TIMES = ("time", "t", "timestamp", "timestamps", "seconds")
_NUMBERS = (
    "index",
    "idx",
    "row",
    "frame",
    "frames",
    "sample",
    "samples",
    "counter",
    "#",
    "no",
    "nr",
)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: Its name without the unit.
        unit: Unit after the conversion; empty if none is stated.
        factor: What values are multiplied by.
        kind: The quantity; empty if no unit is known.
    """

    name: str
    unit: str
    factor: float = 1.0
    kind: str = ""

    @property
    def axis(self) -> tuple[str, int] | None:
        """The name of the point and the axis, 0 to 2, that a column is of; None for others."""
        match = _AXES.match(self.name)
        return None if match is None else (match[1] or "point", "xyz".index(match[2].lower()))


def find_unit(text: str) -> Unit | None:
    """Return the unit of a spelling; None if it is not known.

    Args:
        text: The spelling. Case counts where it changes the meaning (mN and MN, m and M).
    """
    text = text.strip().replace("µ", "u").replace("μ", "u").replace("\u2126", "Ω")
    return _UNITS.get(text) or _CASES.get(text.casefold())


def parse_column(header: str) -> Column:
    """Separate the name of a column from its unit.

    Args:
        header: Text of the header, such as `angle_deg`, `angle [deg]` or `angle (deg)`.

    Returns:
        The column; brackets whose text is not a known unit are kept as the unit.
    """
    header = header.strip()
    for ending in (f"{a}{text}{b}" for text in _RELATIVE for a, b in ("[]", "()")):
        if header.endswith(ending) and header != ending:
            return Column(header.removesuffix(ending).rstrip(" _"), RELATIVE, kind="relative")
    bracketed = _BRACKETED.match(header)
    if bracketed and bracketed[1]:
        unit = find_unit(bracketed[2])
        if unit is None:
            return Column(bracketed[1], bracketed[2])
        return Column(bracketed[1], unit.name, unit.factor, unit.kind)
    name, _, suffix = header.rpartition("_")
    unit = find_unit(suffix) if name else None
    if unit is None or unit.kind == _TIME:
        return Column(header, "")
    return Column(name, unit.name, unit.factor, unit.kind)


def is_clock(header: str) -> bool:
    """Return whether a column has times, or numbers of rows, by its header."""
    return find_time((header,)) is not None or header.strip().casefold() in _NUMBERS


def find_time(headers: tuple[str, ...]) -> tuple[str, float] | None:
    """Return the header of the column of times and s per value; None if there is none.

    Args:
        headers: Headers such as `time`, `t`, `time_ms`, `Time [s]` or `timestamp`.
    """
    for header in headers:
        bracketed = _BRACKETED.match(header.strip())
        if bracketed and bracketed[1]:
            name, suffix = bracketed[1], bracketed[2]
        else:
            name, _, suffix = header.strip().rpartition("_")
            if not name:
                name, suffix = suffix, "s"
        unit = find_unit(suffix)
        if name.casefold() in _TIMES and unit is not None and unit.kind == _TIME:
            return header, unit.factor
    return None
