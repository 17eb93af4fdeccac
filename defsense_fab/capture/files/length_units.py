"""Units of positions, as files of motion capture spell them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from ...core.errors import CaptureError

#: Units that a user can state for files that do not.
LengthUnit = Literal["mm", "cm", "m"]
_MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_NAMES = {"milli": "mm", "centi": "cm", "": "m"}
_MIN_CUT = 4  # letters, to which C3D and older programs cut names


def mm_per_unit(text: str) -> float | None:
    """Return mm per unit for a unit's symbol or name in any case; None if it is not known.

    Names may be British, American, singular or plural, and cut after four letters or more.
    """
    unit = text.strip().strip("\0").strip(" .[]()").lower()
    if unit in _MM_PER_UNIT:
        return _MM_PER_UNIT[unit]
    if len(unit) < _MIN_CUT:
        return None
    for prefix, symbol in _NAMES.items():
        if any(f"{prefix}{end}".startswith(unit) for end in ("meters", "metres")):
            return _MM_PER_UNIT[symbol]
    return None


def resolve_unit(
    stated: str, unit: LengthUnit | None, where: object, name: str, **data: object
) -> float:
    """Return mm per unit of a file's positions.

    Args:
        stated: Unit that the file states, or empty.
        unit: Unit that the user states for a file without a unit that is known; None if none.
        where: The file, with its line where it has lines.
        name: What the format calls the unit, such as `POINT:UNITS`.
        **data: Facts for the errors, such as the line.

    Raises:
        CaptureError: If neither is a known unit (`length-unit-unknown`), or the two differ
            (`unit-conflict`).
    """
    factor = mm_per_unit(stated)
    if factor is None and unit is None:
        shown = f"{stated.strip()!r}, not mm, cm or m" if stated.strip() else "not stated"
        raise CaptureError(
            f"the unit of its positions ({name}) is {shown}",
            code="length-unit-unknown",
            where=where,
            action="State the unit, such as mm",
            unit=stated.strip(),
            **data,
        )
    if unit is None:
        assert factor is not None
        return factor
    if factor not in (None, _MM_PER_UNIT[unit]):
        raise CaptureError(
            f"its positions are in {stated.strip()} ({name}), but the stated unit is {unit}",
            code="unit-conflict",
            where=where,
            action="Omit the unit, or correct it in the file",
            unit=stated.strip(),
            **data,
        )
    return _MM_PER_UNIT[unit]


def require_mm(path: Path, unit: LengthUnit | None) -> None:
    """Check the unit that the user states for a format whose positions are in mm by definition."""
    if unit is not None:
        resolve_unit("mm", unit, path, "by the format's definition")
