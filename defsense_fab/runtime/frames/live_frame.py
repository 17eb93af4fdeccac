"""What is known of the device at one sample of its read-out board."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ...core.arrays import Float


class Quality(StrEnum):
    """How far a frame is to be believed, from the best to the worst."""

    TRUSTED = "trusted"
    UNTRAINED = "untrained"  # readings that training has not seen
    FALLBACK = "fallback"  # a cord is lost: decoded without it
    LOST = "lost"  # nothing can be said: the last good positions stand

    @property
    def level(self) -> int:
        """3 of the best to 0 of the worst, for receivers of numbers."""
        return len(Quality) - 1 - list(Quality).index(self)


@dataclass(frozen=True)
class LiveFrame:
    """`time` (s) is of the sample on the board's clock, `arrived` (s) when it was read, on this
    machine's `time.monotonic`; `ohms` and `signals` (R - R0)/R0 with drift taken out are (c,),
    of the cords named `channels`; `markers` (m, 3) mm in the rest frame, by their numbers `ids`
    (m,), and `radius` (m,) mm of the 90 % interval around each (NaN: not known); `distance` from
    what was trained on (above 1: outside of it); `controls` by name, 0..1 or -1..1, `confidence` of
    each, 0..1; `vertices` (v, 3) mm of the surface, None where none is solved; `tracks` (m, 3) mm
    where cameras saw the markers (NaN: did not), None without cameras. `lost` names a cord that
    failed, `notes` say in sentences what a user should know."""

    device: str
    number: int
    time: float
    arrived: float
    channels: tuple[str, ...]
    ohms: Float
    signals: Float
    ids: tuple[int, ...]
    markers: Float
    radius: Float
    distance: float
    quality: Quality
    lost: str | None = None
    controls: Mapping[str, float] = field(default_factory=dict)
    confidence: Mapping[str, float] = field(default_factory=dict)
    vertices: Float | None = None
    tracks: Float | None = None
    notes: tuple[str, ...] = ()

    @property
    def off(self) -> float | None:
        """Root mean square (mm) of the markers' distances from where cameras saw them; None where
        they saw none."""
        if self.tracks is None or not np.isfinite(self.tracks).any():
            return None
        return float(np.sqrt(np.nanmean(((self.markers - self.tracks) ** 2).sum(axis=1))))
