"""A live device and its frames as messages and arrays for the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import msgspec
import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ..frames.live_frame import MEASURING_REST, LiveFrame, Quality
from .live_messages import DEVICE_ARRAYS, FRAME_ARRAYS, FrameFacts, LiveDevice
from .messages import Arrays
from .panel_actions import PanelActions
from .surface_arrays import surface_arrays
from .viewed_device import ViewedDevice, carried_cords

NO_DEVICE = LiveDevice(
    name="",
    channels=[],
    low=[],
    high=[],
    marker_radius=0.0,
    cord_radius=0.0,
    has_surface=False,
    can_take_rest=False,
    can_record=False,
    poses=[],
)
_QUALITY_TEXTS = {
    Quality.TRUSTED: "The readings are within the range of the training",
    Quality.UNTRAINED: "The readings are outside the range of the training",
    Quality.FALLBACK: "Decoded without {}, which has failed",
    Quality.LOST: "No usable reading: the last good shape is shown",
}
_STARTING = "Leave the device at rest: its resistances at rest are measured"


def live_device(device: ViewedDevice, actions: PanelActions) -> LiveDevice:
    """Return the message that introduces a device."""
    return LiveDevice(
        name=device.name,
        channels=list(device.channels),
        low=device.low.tolist(),
        high=device.high.tolist(),
        marker_radius=device.radius,
        cord_radius=device.cord_radius,
        has_surface=device.vertices is not None and device.faces is not None,
        can_take_rest=actions.rest is not None,
        can_record=actions.record is not None,
        poses=list(actions.poses),
    )


class FrameArrays:
    """Describes the frames of a device as arrays; cords follow its surface.

    Args:
        device: The device.
        shape: Returns the true surface (v, 3) of a simulated device, mm; None for a real device.
    """

    def __init__(self, device: ViewedDevice, shape: Callable[[], Float] | None = None) -> None:
        self._device, self._cords, self._shape = device, carried_cords(device), shape

    @property
    def rest(self) -> Arrays:
        """The surface at rest, and the cords: their points (p, 3), and how many of each (c,)."""
        device, arrays = self._device, dict[str, object]()
        if device.vertices is not None and device.faces is not None:
            arrays |= surface_arrays(Surface(device.vertices, device.faces))
        arrays["cords"] = self._paths(None)
        arrays["cordCounts"] = np.array([len(p) for p, _ in self._cords], np.uint32)
        return Arrays(name=DEVICE_ARRAYS, arrays=arrays)

    def of(self, frame: LiveFrame) -> Arrays:
        """Return a frame: signals (c,), markers (m, 3) and their radii (m,), cords and surfaces."""
        arrays: dict[str, object] = {
            "signals": np.asarray(frame.signals, float),
            "markers": np.asarray(frame.markers, float),
            "radius": np.asarray(frame.radius, float),
        }
        rest = self._device.vertices
        if frame.vertices is not None and rest is not None:
            arrays["vertices"] = frame.vertices
            arrays["cords"] = self._paths(frame.vertices - rest)
            if self._shape is not None:
                arrays["trueVertices"] = self._shape()
        if frame.tracks is not None:
            arrays["tracks"] = frame.tracks[np.isfinite(frame.tracks).all(axis=1)]
        facts = msgspec.to_builtins(frame_facts(frame))
        return Arrays(name=FRAME_ARRAYS, arrays=arrays, facts=facts)

    def _paths(self, displacements: Float | None) -> Float:
        paths = [
            rest if displacements is None else rest + weights @ displacements
            for rest, weights in self._cords
        ]
        return np.concatenate(paths) if paths else np.zeros((0, 3))


def frame_facts(frame: LiveFrame) -> FrameFacts:
    """Return what is sent along with the arrays of a frame."""
    is_starting = any(note.code == MEASURING_REST for note in frame.notes)
    text = _QUALITY_TEXTS[frame.quality].format(frame.lost_channel)
    has_radius = bool(np.isfinite(frame.radius).any())
    return FrameFacts(
        number=frame.number,
        time=frame.time,
        quality="starting" if is_starting else frame.quality.value,
        quality_text=_STARTING if is_starting else text,
        marker_radius=float(np.nanmean(frame.radius)) if has_radius else None,
        tracking_error=frame.tracking_error,
        controls=_finite(frame.controls),
        confidence=_finite(frame.confidence),
    )


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(v) for name, v in values.items() if math.isfinite(v)}
