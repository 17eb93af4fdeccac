"""Faults of cords and wires, as users write them: `cut=A@20-30`, `hum50=B*20`."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.errors import CaptureError
from .cords import FAULT_KINDS, SWAP, CordFault
from .wiring import BRIDGE

_PAIR_KINDS = (SWAP, BRIDGE)


def parse_faults(
    channels: Sequence[str], words: Sequence[str], kinds: Sequence[str] = FAULT_KINDS
) -> tuple[CordFault, ...]:
    """Parse faults such as `cut=A@20-30` and `swap=A+B@40`.

    Args:
        channels: Names of the channels.
        words: One fault each: kind, channels, then after `*` its size, and after `@` the seconds
            from which to which it lasts. Without seconds it lasts from the start on.
        kinds: Kinds of faults that are possible.

    Raises:
        CaptureError: A fault has another form (`fault-invalid`), names channels that do not exist
            (`unknown-channel`), or ends before it starts (`fault-ends-early`).
    """
    return tuple(_parse_fault(channels, word, kinds) for word in words)


def _parse_fault(channels: Sequence[str], word: str, kinds: Sequence[str]) -> CordFault:
    where = f"twin:{word}"
    kind, equals, rest = word.partition("=")
    rest, at, when = rest.partition("@")
    names, times, size = rest.partition("*")
    begin, _, end = when.partition("-")
    affected = [n for n in names.split("+") if n]
    if not equals or kind not in kinds:
        raise CaptureError(
            "is not a valid fault",
            code="fault-invalid",
            where=where,
            action=f"Write {', '.join(kinds)} as in cut=A@20-30",
        )
    unknown = [n for n in affected if n not in channels]
    is_pair = kind in _PAIR_KINDS
    if unknown or len(affected) != (2 if is_pair else 1):
        raise CaptureError(
            f"does not name {'two channels' if is_pair else 'one channel'} of the device",
            code="unknown-channel",
            where=where,
            action=(
                f"Name {'two' if is_pair else 'one'} of {', '.join(channels)}"
                + (", with + between them" if is_pair else "")
            ),
            channels=tuple(affected),
        )
    try:
        amount = float(size) if times else None
        start, stop = float(begin) if at else 0.0, float(end) if end else float("inf")
    except ValueError:
        raise CaptureError(
            "has no valid size or start time",
            code="fault-invalid",
            where=where,
            action="Write a size as in *20, and seconds as in @20-30",
        ) from None
    if not 0 <= start < stop:
        raise CaptureError(
            "ends before it starts",
            code="fault-ends-early",
            where=where,
            action="Write the second of its start, at least 0, and a later one, as in @20-30",
        )
    if amount is not None and not 0 < amount < float("inf"):
        raise CaptureError(
            f"has the size {amount:g}",
            code="fault-invalid",
            where=where,
            action="Write a size above zero, as in *20",
        )
    return CordFault(kind, tuple(channels.index(n) for n in affected), start, stop, amount)
