"""Moments of a test in which the surface is shown: as it truly was, and as it is read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float, Int
from ....core.device.device import Device
from ....runtime.controls.pose_amplitudes import RADIUS_90
from ....runtime.live.live_device import LiveDevice, live_device
from ....runtime.surface.live_surface import LiveSurface, make_surface
from ....runtime.surface.surface_mesh import SurfaceBasis
from ....twin.devices.device_fields import MechanicsTraits, solve_fields
from .sessions import unit_model, unit_session
from .unit_session import recording_of, true_weights

_UNKNOWN = 1.0  # mm, standard deviation of a marker of which no interval is known


@dataclass(frozen=True)
class ShownFrame:
    """A moment in a `pose`, its `weight` (1: its full amplitude): the skin's vertices as they
    `truly` were and as they are `read` (v, 3) mm, and by how much the latter miss, `error` (v,)
    mm."""

    pose: str
    weight: float
    truly: Float
    read: Float
    error: Float


def shown_frames(
    device: Device, unit: int, mechanics: MechanicsTraits, share: float
) -> tuple[Float, Int, list[ShownFrame]]:
    """Vertices at rest (v, 3) mm and triangles (f, 3) of the device's skin, and for each pose the
    moment in the last `share` of a unit's session in which it was furthest, and others least."""
    session, live = unit_session(device, unit), live_device(unit_model(device, unit), device.source)
    assert live.rest is not None
    fields = solve_fields(device, mechanics)
    r = recording_of(device, session)
    tested = r.time[round((1 - share) * len(r.time)) :]
    decoded = live.model.decode(r.sample_time, r.signals, tested)
    weights = true_weights(session, tested)
    skin, reader = fields.displacements(live.rest.vertices), _reader(live)
    known = np.isfinite(decoded.points).all(axis=(1, 2))
    out = []
    for k, name in enumerate(fields.poses):
        clear = np.abs(weights[:, k]) - np.abs(np.delete(weights, k, 1)).sum(1)
        at = int(np.where(known, clear, -np.inf).argmax())
        moved = np.tensordot(fields.space(weights[at : at + 1])[0], skin, axes=1)
        truly = live.rest.vertices + moved
        reader.reset()
        deviation = np.nan_to_num(decoded.radius[at], nan=_UNKNOWN * RADIUS_90) / RADIUS_90
        read = reader(decoded.points[at], deviation)
        error = np.linalg.norm(read - truly, axis=1)
        out.append(ShownFrame(name, float(weights[at, k]), truly, read, error))
    return live.rest.vertices, np.asarray(live.rest.faces, np.int64), out


def _reader(live: LiveDevice) -> LiveSurface:
    """From markers to the surface, as `defsense run` shows it."""
    assert live.rest is not None
    assert live.states is not None
    fixed = np.abs(live.states).max(axis=(0, 2)) < 1e-9
    basis = SurfaceBasis(
        live.rest.vertices, np.asarray(live.rest.faces, np.int64), live.states, fixed
    )
    sd = np.full(len(live.model.ids), _UNKNOWN)
    return make_surface(basis, live.model.rest_points, sd, frame=np.inf)
