"""When the steps of a run were shown, as its log tells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from .session import REST

_SETTLING = 0.3  # of a rest, that is left out at its beginning


def begun(events: Sequence[Mapping[str, Any]], start: int = 0) -> list[tuple[float, str]]:
    """When each step began, s of the computer's clock after `start` ns, and its name, in order."""
    found = [
        ((event["host_ns"] - start) / 1e9, str(event["name"]))
        for event in events
        if event.get("event") == "step" and {"host_ns", "name"} <= set(event)
    ]
    return sorted(found)


def resting(events: Sequence[Mapping[str, Any]], time: Float, start: int = 0) -> Bool:
    """Frames (t,) of finished rests, but for their beginnings; times (t,) s after `start` ns."""
    out = np.zeros(len(time), bool)
    rests: dict[int, float] = {}
    for event in events:
        at, k = (event.get("host_ns", 0) - start) / 1e9, event.get("step", -1)
        if event.get("event") == "step" and event.get("name") == REST:
            rests[k] = at
        elif event.get("event") == "done" and k in rests:
            out |= (time > rests[k] + _SETTLING * (at - rests[k])) & (time < at)
    return out
