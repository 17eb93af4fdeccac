"""A frame as JSON, for pages in a browser and other programs."""

from __future__ import annotations

import msgspec
import numpy as np

from ...frames.live_frame import LiveFrame

#: Raised when keys are renamed or change their meaning; new keys do not count.
SCHEMA = 1


def frame_json(frame: LiveFrame, markers: bool) -> str:
    """One line of JSON; what is no number is null. `markers` are rows of number, x, y, z, radius
    (mm); `level` is the quality's, 3 the best to 0 the worst; `signals` by the cords' names."""
    data = {
        "schema": SCHEMA,
        "device": frame.device,
        "number": frame.number,
        "time": frame.time,
        "quality": str(frame.quality),
        "level": frame.quality.level,
        "distance": _rounded(frame.distance),
        "lost": frame.lost,
        "controls": {name: _rounded(v) for name, v in frame.controls.items()},
        "confidence": {name: _rounded(v) for name, v in frame.confidence.items()},
        "signals": dict(zip(frame.channels, np.round(frame.signals, 6).tolist(), strict=False)),
        "notes": frame.notes,
    }
    if markers:
        places = np.column_stack([frame.markers, frame.radius]).round(3).tolist()
        data["markers"] = [[n, *row] for n, row in zip(frame.ids, places, strict=True)]
    return msgspec.json.encode(data).decode()


def _rounded(value: float) -> float:
    return round(float(value), 5)
