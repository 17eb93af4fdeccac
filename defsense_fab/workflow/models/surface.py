"""The surface of a device, of the positions of its markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Float, Int
from ...core.errors import LiveError
from ...decoding.trained_model import TrainedModel
from ...runtime.live.device_surface import device_surface
from ...runtime.surface.live_surface import Mode
from ..given import array, of_kind
from ..layout import Layout
from .fitting_device import fitting_device

MODES: tuple[Mode, ...] = ("default", "basis", "arap")


@dataclass(frozen=True, repr=False)
class MovingSurface:
    """The skin of a body in t pictures: `vertices` (t, v, 3) mm in the device's rest frame, NaN
    where no marker was known; `faces` (f, 3) outward by the right hand; `rest` (v, 3) mm where the
    vertices are at rest."""

    vertices: Float
    faces: Int
    rest: Float

    def __repr__(self) -> str:
        t, v, _ = self.vertices.shape
        return f"<MovingSurface: {t} pictures of {v} vertices, {len(self.faces)} triangles>"


def moving_surface(
    model: TrainedModel, positions: ArrayLike, layout: Layout, mode: Mode
) -> MovingSurface:
    """As `Model.surface` says."""
    if of_kind(mode, "mode", str, LiveError) not in MODES:
        raise LiveError(f"mode {mode!r}: is unknown; there are {', '.join(MODES)}")
    points = _checked(positions, len(model.ids))
    live = fitting_device(model, of_kind(layout, "layout", Layout, LiveError))
    surface = device_surface(live, mode, frame=np.inf)
    assert live.rest is not None
    vertices = np.full((len(points), len(live.rest.vertices), 3), np.nan)
    for k, markers in enumerate(points):
        if np.isfinite(markers).all(axis=1).any():
            vertices[k] = surface(markers)
    return MovingSurface(vertices, np.asarray(live.rest.faces, np.int64), live.rest.vertices)


def _checked(positions: ArrayLike, count: int) -> Float:
    points = array(positions, "positions", LiveError)
    if points.ndim != 3 or points.shape[1:] != (count, 3):
        raise LiveError(
            f"positions: must have shape (t, {count}, 3), pictures of the model's {count} markers,"
            f" not {points.shape}"
        )
    if np.isinf(points).any():
        raise LiveError("positions: must not be infinite; NaN is where there is none")
    return points
