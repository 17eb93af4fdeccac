"""The search for the best place of another cord, and the texts of its result."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float, format_point
from ....core.curve import Plane
from ....core.device.device import Sensor
from ....workflow.design.body_section import BodySection
from ....workflow.design.layout_judge import LayoutJudge
from ....workflow.design.next_cord import NextCord, map_next_cord
from ...background.latest_worker import LatestWorker


@dataclass(frozen=True)
class SearchRequest:
    """A search for the best place of another cord.

    Attributes:
        judge: Predicts the error of the cords.
        body: The body.
        plane: The plane of the cord.
        sensors: The present cords.
        length: Length of the cord, mm; None for cords from surface to surface.
    """

    judge: LayoutJudge
    body: BodySection
    plane: Plane
    sensors: Sequence[Sensor]
    length: float | None


class NextCordSearch:
    """Search for the best place of another cord, one search at a time, on a thread.

    Args:
        on_progress: Called with the completed share (0 to 1), and with None when no search runs.
        on_map: Called with the coarse map and with the fine one.
        on_error: Called with the error of a search.
    """

    def __init__(
        self,
        on_progress: Callable[[float | None], None],
        on_map: Callable[[SearchRequest, NextCord], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._on_progress, self._on_map = on_progress, on_map
        self._lock = threading.Lock()
        self._request: SearchRequest | None = None
        self._worker = LatestWorker(self._search, on_error)

    def start(self, request: SearchRequest) -> None:
        """Start a search; it replaces the running one."""
        with self._lock:
            self._request = request
        self._worker.give(request)

    def cancel(self) -> None:
        """End the running search without a map, within some hundredths of a second."""
        with self._lock:
            self._request = None

    def wait(self, timeout_s: float) -> bool:
        """Wait until no search runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def close(self) -> None:
        """End the search and its thread."""
        self.cancel()
        self._worker.close()

    def _search(self, request: SearchRequest) -> None:
        if self._request is not request:
            return
        try:
            self._on_progress(0.0)
            for cord_map in map_next_cord(
                request.judge, request.body, request.plane, request.sensors, request.length
            ):
                if self._request is not request:
                    return
                self._on_progress(cord_map.share if cord_map.is_fine else 0.0)
                if cord_map.share == 1.0:
                    self._on_map(request, cord_map)
        finally:
            self._on_progress(None)


def map_text(cord_map: NextCord, length: float | None) -> str:
    """Return the best place, the decrease of the error and the tried cords in markdown."""
    kind = "from surface to surface" if length is None else f"of {length:g} mm"
    if not cord_map.tried:
        return (
            f"No cord {kind} fits in this plane next to the present cords. Move the plane, or try"
            " other cords or lengths."
        )
    tried = f"{cord_map.tried} cords {kind} were tried, {cord_map.step:.1f} mm apart"
    if cord_map.best is None:
        return f"No cord here lowers the expected error of {cord_map.error:.2f} mm. {tried}."
    middle = format_point(cord_map.ends[cord_map.best].mean(axis=0))
    best_error = cord_map.error - cord_map.best_drop
    return (
        f"Best place: **{cord_map.error:.2f} → {best_error:.2f} mm** near {middle}."
        f" {tried}, judged in unseen states by the fast decoders."
    )


def drop_text(cord_map: NextCord, rest: Float) -> str:
    """Return the effect of a cord through a point (3,) mm at rest."""
    distances = np.linalg.norm(cord_map.points - rest, axis=1)
    index = int(distances.argmin()) if len(distances) else -1
    if index < 0 or np.isnan(cord_map.drop[index]) or distances[index] > cord_map.step:
        return "No cord fits here"
    change = f"{-cord_map.drop[index]:+.2f}"
    return f"Change of the expected error by a cord here: {change} mm"
