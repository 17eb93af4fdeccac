"""Whether a model fits a device as it is built."""

from __future__ import annotations

from enum import Enum

import numpy as np

from ...core.device.device import Device, Sensor
from ...decoding.trained_model import TrainedModel
from ...store.layout import layout_hash, LayoutRecord

_MOVED = 0.01  # mm


class Misfit(Enum):
    """Why a model is of no use for a device."""

    DEVICE = "another device"
    CORDS = "other cords"
    CHANNELS = "other channels"


def misfit(model: TrainedModel, device: Device, layout: LayoutRecord | None) -> Misfit | None:
    """None where the model fits, as far as is known: without a `layout` the device is not built."""
    if device.name != model.device:
        return Misfit.DEVICE
    if layout is None:
        return None
    if model.layout and model.layout != layout_hash(layout):
        return Misfit.CORDS
    if {cord.name for cord in layout.by_channel()} != set(model.channels):
        return Misfit.CHANNELS
    return None


def changed_since(device: Device, layout: LayoutRecord) -> list[str]:
    """In which respects the cords are no longer those that were built, in sentences: names, and
    cords that a build may not move. What it may move, or proposes, is not compared."""
    if not device.sensors:  # all are proposed by the build
        return []
    built = {cord.name: cord for cord in layout.by_channel()}
    drawn = {cord.name for cord in device.sensors}
    out = []
    gone = sorted(set(built) - drawn)
    if gone and not device.propose:
        out.append(f"{', '.join(gone)}: built, and no longer a cord of device.toml")
    if new := sorted(drawn - set(built)):
        out.append(f"{', '.join(new)}: a cord of device.toml, and not built")
    moved = [s.name for s in device.sensors if s.name in built and not s.free
             and _differs(s, built[s.name].sensor())]  # fmt: skip
    if moved:
        out.append(f"{', '.join(sorted(moved))}: moved since the build")
    return out


def _differs(one: Sensor, other: Sensor) -> bool:
    a, b = (s.plane.to_world(s.curve.points) for s in (one, other))
    return len(a) != len(b) or not np.allclose(a, b, atol=_MOVED)
