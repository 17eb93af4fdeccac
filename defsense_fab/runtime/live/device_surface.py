"""The surface that a device's markers carry, by what its build knows of how it moves."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.errors import LiveError
from ...decoding.trained_model import TrainedModel
from ..surface.live_surface import FRAME, LiveSurface, Mode, make_surface
from ..surface.surface_mesh import SurfaceBasis
from .live_device import LiveDevice
from .live_loop import deviation

_NEAR = 0.7  # of the training's range: what a model mostly sees


def device_surface(live: LiveDevice, mode: Mode = "default", frame: float = FRAME) -> LiveSurface:
    """Of the model's markers; a mesh that this machine does not solve in `frame` seconds is moved
    by a coarser cage. Raises LiveError for a device without a build."""
    if live.rest is None or live.states is None:
        raise LiveError(f"{live.model.device}: no build is known, which tells the surface")
    fixed = np.abs(live.states).max(axis=(0, 2)) < 1e-9
    basis = SurfaceBasis(
        live.rest.vertices, np.asarray(live.rest.faces, np.int64), live.states, fixed
    )
    typical = typical_deviation(live.model)
    return make_surface(basis, live.model.rest_points, typical, mode, frame)


def typical_deviation(model: TrainedModel) -> Float:
    """(m,) mm: standard deviations of the markers near the training."""
    intervals = model.main.intervals
    if intervals is None:
        return deviation(np.full(len(model.ids), np.nan))
    return deviation(intervals(np.array([_NEAR]))[0])
