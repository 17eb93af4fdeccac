"""Where a browser looks from when it comes."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...core.arrays import Float

_FROM = np.array([0.45, -1.0, 0.55])  # times the body's diagonal, from its middle


_places: WeakKeyDictionary[Any, tuple[Float, float]] = WeakKeyDictionary()  # of each server


def look_at_body(server: Any, vertices: Float) -> None:
    """At a body's `vertices` (v, 3) mm as a whole, z being up; in each browser, now and as it
    connects, until another body is looked at."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    first = server not in _places
    _places[server] = (low + high) / 2, float(np.linalg.norm(high - low))

    def place(client: Any) -> None:
        middle, size = _places[server]
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(middle + size * _FROM)
        client.camera.look_at = tuple(middle)  # last: moving the camera moves it too

    if first:  # it cannot be taken back
        server.on_client_connect(place)
    for client in server.get_clients().values():
        place(client)
