"""The free parameters of a cord."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Int
from ...core.curve import Hermite, Plane, hermite_basis
from ...core.device import Sensor
from ...core.path_sampling import per_span_for_signal

FRAME = 5  #: Parameters of a free plane: two moves, three turns.


class CordParameters:
    """Parameters of one sensor, all in mm: interior control points, tangents, and the plane.

    The first and last two control points and the end tangents stay where they are in the plane's
    frame. The frame moves along its normal and, in the plane, across the path's chord, and turns
    about the path's middle; a turn counts as the movement it causes at half the path's extent.
    """

    def __init__(self, sensor: Sensor, lead: CordParameters | None = None) -> None:
        """With `lead`, a cord in the same frame, the frame's parameters mean what they mean there:
        equal ones keep both cords in one plane."""
        curve, self.sensor = sensor.curve, sensor
        k = len(curve.points)
        #: Control points over tangents (2 k, 2), and which of these rows (r,) are free.
        self.stack = np.concatenate([curve.points, curve.tangents])
        rows = [*range(2, k - 2), *range(k + 1, 2 * k - 1)] if "path" in sensor.free else []
        self.rows = np.array(rows, int)
        self.has_plane = "plane" in sensor.free
        self.size = 2 * len(rows) + FRAME * self.has_plane
        if lead is None:
            chord = curve.points[-1] - curve.points[0]
            side = np.array([-chord[1], chord[0]]) if np.linalg.norm(chord) > 1e-6 else np.eye(2)[1]
            side = sensor.plane.axes[:, :2] @ side / np.linalg.norm(side)
            #: The directions (2, 3) of the frame's moves, the middle (2,) that it turns about, the
            #: same point (3,) at rest, and half the path's extent.
            self.moves = np.stack([sensor.plane.normal, side])
            self.center = (curve.points.min(0) + curve.points.max(0)) / 2
            self.pivot = sensor.plane.to_world(self.center)
            self.reach = float(np.linalg.norm(np.ptp(curve.points, axis=0))) / 2
        else:
            self.moves, self.center = lead.moves, lead.center
            self.pivot, self.reach = lead.pivot, lead.reach
        #: From stacked rows to the samples (p, 2 k), and from the free ones alone (p, r).
        self.basis = hermite_basis(k, per_span_for_signal(curve))[0]
        self.basis_of_rows = np.ascontiguousarray(self.basis[:, self.rows])
        #: To first and second derivatives (q, 2 k) where the curvature is looked at.
        _, self.first, self.second = hermite_basis(k, 8)
        speed = np.linalg.norm(self.first @ self.stack, axis=1)
        self.drawn_speed = np.maximum(speed, 1e-3 * speed.max())


def apart(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Int]:
    """Like `together`, for cords that go their own ways."""
    cords = [CordParameters(s) for s in sensors]
    return cords, np.arange(sum(c.size for c in cords))


def together(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Int]:
    """Freedoms of a layout whose coplanar cords stay coplanar where their plane is free, and for
    each of their parameters (size,) which of the layout's own it is."""
    cords: list[CordParameters] = []
    which: list[Int] = []
    count = 0
    for sensor in sensors:
        if "plane" in sensor.free and any(
            "plane" not in s.free and s.plane.coincides(sensor.plane) for s in sensors
        ):  # a plane that another cord holds
            sensor = replace(sensor, free=sensor.free - {"plane"})
        lead = next((i for i, c in enumerate(cords) if _joined(c.sensor, sensor)), None)
        if lead is None:
            cord = CordParameters(sensor)
            own = count + np.arange(cord.size)
            count += cord.size
        else:
            leader = cords[lead]
            cord = CordParameters(_in_frame(sensor, leader.sensor.plane), leader)
            own = np.concatenate([count + np.arange(cord.size - FRAME), which[lead][-FRAME:]])
            count += cord.size - FRAME
        cords.append(cord)
        which.append(own)
    return cords, np.concatenate(which)


def _joined(a: Sensor, b: Sensor) -> bool:
    return "plane" in a.free and "plane" in b.free and a.plane.coincides(b.plane)


def _in_frame(sensor: Sensor, plane: Plane) -> Sensor:
    """The same cord in another frame of its plane."""
    turn = plane.axes[:, :2].T @ sensor.plane.axes[:, :2]
    shift = (sensor.plane.origin - plane.origin) @ plane.axes[:, :2]
    curve = sensor.curve
    return replace(
        sensor,
        plane=plane,
        curve=Hermite(curve.points @ turn.T + shift, curve.tangents @ turn.T),
    )
