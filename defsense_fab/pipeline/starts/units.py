"""The unit that a body's file is likely in, by its size."""

from __future__ import annotations

#: Units of lengths, and mm in each; those that programs write more often first.
UNITS = {"mm": 1.0, "inch": 25.4, "cm": 10.0, "m": 1000.0, "um": 0.001}
#: The same in words.
UNIT_WORDS = {
    "mm": "millimetres", "inch": "inches", "cm": "centimetres", "m": "metres", "um": "micrometres",
}  # fmt: skip
_USUAL = (15.0, 600.0)  # mm: what soft devices measure along their longest axis


def likely_unit(longest: float) -> tuple[str, bool]:
    """The unit in which so long a body is a device, and whether that is doubtful: only of mm it is
    not, since most files are in mm."""
    for unit, scale in UNITS.items():
        if _USUAL[0] <= longest * scale <= _USUAL[1]:
            return unit, unit != "mm"
    return "mm", True
