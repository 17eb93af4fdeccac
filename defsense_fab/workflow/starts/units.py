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
#: mm: what soft devices measure along their longest axis; shorter ones hold no cord that stretches.
_USUAL, _POSSIBLE = (40.0, 600.0), (15.0, 1500.0)


def likely_unit(longest: float, own: str = "mm") -> tuple[str, bool]:
    """The unit in which a body so long, in the file's numbers, is a device, and whether that is
    doubtful: only of the format's `own` it is not, which is mm where the format has none, since
    most files are in mm."""
    for least, most in (_USUAL, _POSSIBLE):
        for unit in (own, *UNITS):
            if least <= longest * UNITS[unit] <= most:
                return unit, unit != own or (least, most) != _USUAL
    return own, True


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
