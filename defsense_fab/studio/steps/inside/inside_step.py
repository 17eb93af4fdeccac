"""The step Inside: sections through the simulated body, and the best place of another cord."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from ....core.device.sensor_tables import new_sensor_names
from ....core.errors import DefsenseError, LayoutError
from ....workflow.design.next_cord import best_sensor
from ....workflow.view import Arrays, Client, Request
from ...background.latest_worker import LatestWorker
from ...edits.cords import add_cord
from ...messages import inside as messages
from ...messages.sensors import CordResult
from ...session.cord_states import plane_of
from ...session.device_session import DeviceSession
from ...session.step import Handler, Step
from .client_search import ClientSearch
from .next_cord_search import SearchRequest
from .simulated_body import SimulatedBody, empty_state

_NO_BODY = "Make the body and simulate the poses to see the strain inside"
_NO_POSES = "Add a pose and simulate it to see the strain inside"
_NOT_SIMULATED = "Simulate the poses to see the strain inside"


class InsideStep(Step):
    """Answers each browser with the sections that it asks for.

    Args:
        session: The device.

    Attributes:
        body: The simulated body, or None.
    """

    def __init__(self, session: DeviceSession) -> None:
        super().__init__(session)
        self.body: SimulatedBody | None = None
        self._revision, self._published = 0, ""
        self._searches: dict[Client, ClientSearch] = {}
        self._lock = threading.Lock()
        self._preparation = LatestWorker[SimulatedBody](
            lambda body: body.prepare(), session.show_error
        )

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            messages.GetSkin: lambda _, __: self._simulated().skin,
            messages.GetShape: lambda _, r: self._simulated().shape(r.state, self._sensors),
            messages.ShowSection: self._show_section,
            messages.ProbePoint: self._probe,
            messages.SearchNextCord: self._search,
            messages.StopNextCord: self._stop,
            messages.AddNextCord: self._add,
        }

    def on_build_loaded(self) -> None:
        judge = self.session.judge
        if judge is None:
            self.body = None
            self._outdate()
            self._publish_empty()
        elif self.body is None or self.body.judge is not judge:
            self._revision += 1
            self.body = SimulatedBody(judge, self._revision)
            self._outdate()
            self._published = ""
            self.session.server.publish(self.body.state())

    def on_device_changed(self) -> None:
        if self.body is None:
            self._publish_empty()
        for search in self._open_searches():
            if search.request is not None and search.request.sensors is not self._sensors:
                search.outdate()

    def disconnect(self, client: Client) -> None:
        with self._lock:
            search = self._searches.pop(client, None)
        if search is not None:
            search.close()

    def close(self) -> None:
        self._preparation.close()
        for search in self._open_searches():
            search.close()

    @property
    def _sensors(self) -> Any:
        return self.session.device.sensors

    def _show_section(self, client: Client, request: messages.ShowSection) -> Arrays:
        return self._simulated().section(request, self._sensors, self._map_of(client))

    def _probe(self, client: Client, request: messages.ProbePoint) -> messages.PointNumbers:
        return self._simulated().probe(request, self._sensors, self._map_of(client))

    def _search(self, client: Client, request: messages.SearchNextCord) -> None:
        body = self._simulated()
        self._preparation.give(body)
        plane = plane_of(request.origin, request.axes)
        body.body.cut(plane)  # a plane that misses the body is refused at once
        search = self._search_of(client)
        search.start(SearchRequest(body.judge, body.body, plane, self._sensors, request.length))

    def _stop(self, client: Client, request: messages.StopNextCord) -> None:
        search = self._searches.get(client)
        if search is not None:
            search.stop(keeps_map=request.keeps_map)

    def _add(self, client: Client, request: messages.AddNextCord) -> CordResult:
        search, cord_map, index = self._search_of(client).found(request.at)
        name = next(new_sensor_names(sensor.name for sensor in self._sensors))
        cord = best_sensor(cord_map, index, name, search.judge)
        self.session.apply(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))
        return CordResult(name=cord.name)

    def _simulated(self) -> SimulatedBody:
        body = self.body
        if body is None:
            raise LayoutError(
                "the poses are not simulated yet",
                code="not-simulated",
                action="Simulate the poses first",
            )
        return body

    def _map_of(self, client: Client) -> Any:
        search = self._searches.get(client)
        return None if search is None else search.cord_map

    def _search_of(self, client: Client) -> ClientSearch:
        with self._lock:
            if not client.is_open:
                raise DefsenseError("the page was closed", code="cancelled")
            return self._searches.setdefault(client, ClientSearch(client))

    def _open_searches(self) -> tuple[ClientSearch, ...]:
        with self._lock:
            return tuple(self._searches.values())

    def _outdate(self) -> None:
        for search in self._open_searches():
            search.outdate()

    def _publish_empty(self) -> None:
        text = _NOT_SIMULATED if self.session.device.poses else _NO_POSES
        if self.session.surface is None:
            text = _NO_BODY
        if text != self._published:
            self._published = text
            self.session.server.publish(empty_state(self._revision, text))
