"""The search for the place of the next cord, beside the page."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...core.curve import Plane
from ...core.device.device import Sensor
from ...optimize.prediction.body_section import BodySection
from ...optimize.prediction.layout_judge import LayoutJudge
from ...optimize.prediction.next_cord import NextCord, next_cord
from ..workbench.latest import Latest


@dataclass(frozen=True)
class Asked:
    """Beside which `sensors`, in which `plane`, of which `length` (mm; None: from skin to skin)."""

    judge: LayoutJudge
    body: BodySection
    plane: Plane
    sensors: Sequence[Sensor]
    length: float | None


class HeatSearch:
    """One search at a time. `told` hears of the share that is done, 0 to 1, or None once nothing is
    under way; `found` takes the coarse map and the fine one; all on a thread of this."""

    def __init__(
        self,
        told: Callable[[float | None], None],
        found: Callable[[Asked, NextCord], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._told, self._found = told, found
        self._lock = threading.Lock()
        self._wanted: Asked | None = None
        self._work = Latest(self._search, failed)

    def start(self, asked: Asked) -> None:
        """In place of what is under way."""
        with self._lock:
            self._wanted = asked
        self._work.give(asked)

    def cancel(self) -> None:
        """What is under way ends within some hundredths of a second, without a map."""
        with self._lock:
            self._wanted = None

    def wait(self, seconds: float) -> bool:
        """Whether nothing is under way within so many s."""
        return self._work.wait(seconds)

    def close(self) -> None:
        self.cancel()
        self._work.close()

    def _search(self, asked: Asked) -> None:
        if self._wanted is not asked:
            return
        try:
            self._told(0.0)
            for known in next_cord(
                asked.judge, asked.body, asked.plane, asked.sensors, asked.length
            ):
                if self._wanted is not asked:
                    return
                self._told(known.share if known.fine else 0.0)
                if known.share == 1.0:
                    self._found(asked, known)
        finally:
            self._told(None)
