"""What processing a session gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...core.arrays import Float
from ...core.markers import Tracks
from .sample_table import ClockPart


@dataclass(frozen=True)
class ProcessedSession:
    """Tracks in the first camera's frame and in the device's rest frame, (R - R0)/R0 (t, c) and
    resistances (t, c) ohm at their times, the residuals (t,) mm of the alignment, quality; of each
    run how the read-out board's clock goes with the tracks' times."""

    tracks: Tracks
    aligned: Tracks
    signals: Float
    ohm: Float
    residual: Float
    quality: dict[str, Any]
    clocks: dict[str, list[ClockPart]]
