"""The unit that a body's file is likely in, by its size."""

from __future__ import annotations

from ...core.arrays import Float
from ...core.errors import DeviceError

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


def unit_name(text: str) -> str:
    """The unit that a word means, as in "inches". Raises DeviceError for one that there is not."""
    word = text.strip().lower().replace("\u00b5", "u").replace("\u03bc", "u")
    others = {"in": "inch", '"': "inch"} | {words: unit for unit, words in UNIT_WORDS.items()}
    unit = others.get(word, word)
    if unit not in UNITS:
        raise DeviceError(f"units {text}: there is {', '.join(UNITS)}")
    return unit


def unusual(size: Float) -> str:
    """What to say of extents (3,) mm that soft devices do not have; nothing of others."""
    longest = float(size.max())
    if _USUAL[0] <= longest <= _USUAL[1]:
        return ""
    how = "long" if longest > _USUAL[1] else "small"
    return f"{longest:,.4g} mm is unusually {how} for a soft device; check the unit of the file"
