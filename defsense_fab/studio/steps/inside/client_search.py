"""The search of one browser for the best place of another cord."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from ....core.errors import LayoutError
from ....workflow.design.next_cord import NextCord
from ....workflow.view import Arrays, Client, Problem
from ...messages.inside import NextCordState
from ...session.cord_states import rounded
from .next_cord_search import NextCordSearch, SearchRequest


class ClientSearch:
    """Searches for one browser, and reports to it.

    Args:
        client: The browser.

    Attributes:
        cord_map: The map that was found last, or None.
        request: The search that runs or has ended, or None.
    """

    def __init__(self, client: Client) -> None:
        self._client, self._lock = client, threading.RLock()
        self.cord_map: NextCord | None = None
        self.request: SearchRequest | None = None
        self._state = NextCordState(state="none")
        self._search = NextCordSearch(self._follow, self._show_map, self._fail)

    def start(self, request: SearchRequest) -> None:
        """Start a search, which replaces the running one."""
        with self._lock:
            self.request, self.cord_map = request, None
            self._send(NextCordState(state="searching", length=request.length))
            self._search.start(request)

    def stop(self, *, keeps_map: bool) -> None:
        """Cancel the search; an outdated map is never kept."""
        with self._lock:
            self._search.cancel()
            if not keeps_map or self.cord_map is None:
                self.cord_map = self.request = None
                self._send(NextCordState(state="canceled" if keeps_map else "none"))
            elif self._state.state == "searching":
                self._change(state="found", share=1.0)

    def outdate(self) -> None:
        """Forget a map of other cords or of another simulation."""
        with self._lock:
            if self.request is None:
                return
            self._search.cancel()
            self.cord_map = self.request = None
            self._send(NextCordState(state="outdated"))

    def found(self, at: list[float] | None) -> tuple[SearchRequest, NextCord, int]:
        """Return the search, its map, and the index of the best point, or of that nearest to `at`.

        Raises:
            LayoutError: The search has not ended, or no cord fits or lowers the error there.
        """
        with self._lock:
            request, cord_map = self.request, self.cord_map
        if request is None or cord_map is None:
            raise LayoutError(
                "the best place of a cord is not known yet",
                code="search-not-done",
                action="Wait until the search has ended",
            )
        if at is None:
            if cord_map.best is None:
                raise LayoutError(
                    "no cord in this plane lowers the expected error",
                    code="no-better-cord",
                    action="Move the plane, or try cords of the other kind",
                )
            return request, cord_map, cord_map.best
        distances = np.linalg.norm(cord_map.points - np.array(at, float), axis=1)
        index = int(distances.argmin()) if len(distances) else -1
        if index < 0 or distances[index] > cord_map.step or np.isnan(cord_map.drop[index]):
            raise LayoutError(
                "no cord fits at this point", code="no-cord-fits", action="Choose a colored point"
            )
        return request, cord_map, index

    def close(self) -> None:
        """End the thread of the search."""
        self._search.close()

    def _follow(self, share: float | None) -> None:
        with self._lock:
            if share is not None and self._state.state == "searching":
                self._change(share=share)

    def _show_map(self, request: SearchRequest, cord_map: NextCord) -> None:
        with self._lock:
            if request is not self.request:
                return
            self.cord_map = cord_map
            self._client.send_arrays(
                Arrays(
                    name="next-cord",
                    arrays={
                        "points": cord_map.points,
                        "drop": cord_map.drop,
                        "ends": cord_map.ends,
                    },
                    facts={"step": cord_map.step},
                )
            )
            ends = cord_map.best_ends
            self._send(
                NextCordState(
                    state="found" if cord_map.is_fine else "searching",
                    share=1.0 if cord_map.is_fine else 0.0,
                    has_map=True,
                    length=request.length,
                    tried=cord_map.tried,
                    error=cord_map.error,
                    drop=cord_map.best_drop,
                    ends=[] if ends is None else rounded(ends),
                )
            )

    def _fail(self, error: Exception) -> None:
        with self._lock:
            self.cord_map = self.request = None
            self._send(NextCordState(state="failed", problem=Problem.of(error)))

    def _change(self, **values: Any) -> None:
        now = {name: getattr(self._state, name) for name in NextCordState.__struct_fields__}
        self._send(NextCordState(**{**now, **values}))

    def _send(self, state: NextCordState) -> None:
        self._state = state
        self._client.send(state)
