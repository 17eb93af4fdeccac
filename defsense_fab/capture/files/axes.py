"""Tracks turned so that another of their axes points upwards, by quarter turns alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.tracks import Tracks

#: To axes with y upwards, from: a camera's (x right, y down, z ahead), y upwards, z upwards.
_TO_Y = {
    "camera": np.diag([1.0, -1.0, -1.0]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
#: In words.
AXES = {
    "camera": "x right, y down, z ahead",
    "y": "x right, y up, z back",
    "z": "x right, y ahead, z up",
}


def turned(tracks: Tracks, source: str, up: str) -> Tracks:
    """From the axes `source` ("camera", "y", or "z" upwards) to those with `up`, y or z."""
    # No zero is negative, which would be written as -0.
    R = _TO_Y[up].T @ _TO_Y[source]
    return replace(tracks, points=tracks.points @ R.T + 0.0, sigma=tracks.sigma @ np.abs(R).T)
