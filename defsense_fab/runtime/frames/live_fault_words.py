"""What is said of a cord that fails."""

from __future__ import annotations

from collections.abc import Sequence

from ...decoding.channel_faults import LOOSE, SHORTED, STUCK, TORN

SWAPPED = "swapped"
_WORDS = {
    TORN: "{} is open: is the cord torn, or its plug out?",
    SHORTED: "{} is shorted: do its wires touch?",
    STUCK: "{} does not change while others do: is its plug in the right place?",
    LOOSE: "{} jumps from sample to sample: its contact is loose",
    SWAPPED: "{} look swapped: exchange their plugs",
}


def fault_told(names: Sequence[str], kind: str, channels: Sequence[int]) -> str:
    """A sentence on channels by index."""
    return _WORDS[kind].format(" and ".join(names[c] for c in channels))
