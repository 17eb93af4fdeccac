"""Every browser's camera flies to a place."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ...core.arrays import Float

_NEAR = 0.45  # of the body's size, from the place
_FRAMES, _PAUSE = 15, 0.03  # s between them


def approach(place: Float, middle: Float, camera: Float, size: float) -> Float:
    """Where a camera (3,) mm goes to see a place (3,) mm of a body around `middle` of that size:
    out along the way from the middle, and a little to where the camera was."""
    out = place - middle
    back = camera - place
    way = _unit(out) + 0.8 * _unit(back)
    if np.linalg.norm(way) < 1e-6:
        way = np.array([0.3, -1.0, 0.5])
    return np.asarray(place + _NEAR * size * _unit(way))


def fly(server: Any, place: Float, middle: Float, size: float, pause: float = _PAUSE) -> int:
    """Takes half a second; how many browsers there were."""
    clients = list(server.get_clients().values())
    begun = [np.asarray(c.camera.position, float) for c in clients]
    looked = [np.asarray(c.camera.look_at, float) for c in clients]
    ends = [approach(place, middle, p, size) for p in begun]
    for k in range(1, _FRAMES + 1):
        share = k / _FRAMES
        eased = share * share * (3 - 2 * share)
        for client, p, look, end in zip(clients, begun, looked, ends, strict=True):
            with client.atomic():
                client.camera.position = tuple(p + eased * (end - p))
                client.camera.look_at = tuple(look + eased * (place - look))  # last
        time.sleep(pause)
    return len(clients)


def _unit(way: Float) -> Float:
    length = float(np.linalg.norm(way))
    return np.zeros(3) if length < 1e-9 else way / length
