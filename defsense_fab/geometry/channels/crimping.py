"""The end of a cord that is crimped when its channel is closed: it is pulled out of its mouth."""

from __future__ import annotations

#: Of a cord that has to be held or cut to length outside of its mouth, mm.
_ROOM = 5.0


def reach(ferrule: float, lead: float) -> float:
    """How far outside of its mouth the middle of a ferrule of this length must be for it to be
    crimped, mm; `lead` is how far outside it stays."""
    return max(ferrule / 2 + _ROOM, lead)


def pulled(between: float, loose: float, pocket: float, ferrule: float, lead: float) -> float:
    """By how much of its length a cord is stretched then, of which so many mm lie `between` its
    ferrules in the device and are as long when `loose`; the end's `pocket`, 0 for none, in mm."""
    inside = pocket - ferrule / 2 if pocket else -lead
    return (between + inside + reach(ferrule, lead)) / loose - 1
