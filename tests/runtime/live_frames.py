"""Live frames of a bending bar."""

import time

import numpy as np

from defsense_fab.runtime.frames.live_frame import LiveFrame, Quality


def frame(number=1, count=3, **changes):
    at = np.arange(3.0 * count).reshape(-1, 3) / 7
    values = {
        "device": "bar",
        "number": number,
        "time": 0.01 * number,
        "arrived": time.monotonic(),
        "channels": ("a", "b"),
        "ohms": np.array([1500.0, 1510.0]),
        "signals": np.array([0.01, -0.02]),
        "ids": tuple(range(count)),
        "markers": at,
        "radius": np.full(count, 0.4),
        "distance": 0.3,
        "quality": Quality.TRUSTED,
        "controls": {"bend": 0.25, "twist": -0.5},
        "confidence": {"bend": 0.9, "twist": 0.8},
    }
    return LiveFrame(**{**values, **changes})


def frame_before_rest(number=1, **changes):
    """Return a frame from before the resistances at rest are known."""
    unknown = {
        "quality": Quality.LOST,
        "signals": np.full(2, np.nan),
        "controls": {},
        "confidence": {},
    }
    return frame(number, **{**unknown, **changes})


def wait_for(condition, seconds=120.0):
    """Wait for a condition; return whether it came true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.005)
    return False
