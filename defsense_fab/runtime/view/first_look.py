"""Where a browser looks from when it comes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float

_FROM = np.array([0.45, -1.0, 0.55])  # times the body's diagonal, from its middle


def look_at_body(server: Any, vertices: Float) -> None:
    """At a body's `vertices` (v, 3) mm as a whole, z being up; in each browser as it connects."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))

    def place(client: Any) -> None:
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(middle + size * _FROM)
        client.camera.look_at = tuple(middle)  # last: moving the camera moves it too

    server.on_client_connect(place)
    for client in server.get_clients().values():
        place(client)
