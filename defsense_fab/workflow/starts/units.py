"""Units of the lengths in files of bodies, guessed from the size of the body."""

from __future__ import annotations

from ...core.arrays import Float
from ...core.errors import DeviceError

#: Units of lengths, and mm in each; units that programs write more often come first.
UNITS = {"mm": 1.0, "inch": 25.4, "cm": 10.0, "m": 1000.0, "um": 0.001}
#: The units in words.
UNIT_WORDS = {
    "mm": "millimetres",
    "inch": "inches",
    "cm": "centimetres",
    "m": "metres",
    "um": "micrometres",
}
#: Lengths of soft devices along their longest axis, mm; shorter ones have no room for a cord.
USUAL_LENGTH_MM, POSSIBLE_LENGTH_MM = (40.0, 600.0), (15.0, 1500.0)


def guess_unit(longest: float, format_unit: str = "mm") -> tuple[str, bool]:
    """Guess the unit of a file from the size of its body.

    Args:
        longest: Longest extent of the body, in the numbers of the file.
        format_unit: Unit of the file's format; mm if the format has none, as most files are in mm.

    Returns:
        The unit in which the body has the size of a device, and whether that is doubtful. Only the
        unit of the format is not doubtful.
    """
    for low, high in (USUAL_LENGTH_MM, POSSIBLE_LENGTH_MM):
        for unit in (format_unit, *UNITS):
            if low <= longest * UNITS[unit] <= high:
                is_doubtful = unit != format_unit or (low, high) != USUAL_LENGTH_MM
                return unit, is_doubtful
    return format_unit, True


def parse_unit(text: str) -> str:
    """Return the unit that a word means, such as "inches".

    Raises:
        DeviceError: There is no such unit (`unknown-unit`).
    """
    word = text.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")
    synonyms = {"in": "inch", '"': "inch"} | {words: unit for unit, words in UNIT_WORDS.items()}
    unit = synonyms.get(word, word)
    if unit not in UNITS:
        raise unknown_unit(text)
    return unit


def unknown_unit(text: str) -> DeviceError:
    """Return the error for a unit that does not exist."""
    return DeviceError(
        f"{text!r} is not a unit",
        code="unknown-unit",
        where="units",
        action=f"Use one of {', '.join(UNITS)}",
        unit=text,
    )


def describe_unusual_size(size: Float) -> str:
    """Return a note on extents (3,) mm that soft devices do not have; empty for others."""
    longest = float(size.max())
    if USUAL_LENGTH_MM[0] <= longest <= USUAL_LENGTH_MM[1]:
        return ""
    kind = "long" if longest > USUAL_LENGTH_MM[1] else "small"
    return f"{longest:,.4g} mm is unusually {kind} for a soft device; check the unit of the file"
