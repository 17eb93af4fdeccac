"""The free parameters of a cord."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import Hermite, Plane, hermite_basis, per_span_for_signal
from ...core.device.device import PLANE_FREEDOMS, Sensor

FRAME_SIZE = 5  #: Parameters of a free plane: two moves, three turns, the last within itself.
#: Samples of a span at which its curvature is limited: between 8 it can be a tenth larger.
CURVATURE_SAMPLES_PER_SPAN = 24
_MIN_SPEED_FRACTION = 0.2  # speed of a path, of its span's chord
_TILT_PARAMETERS = slice(-3, -1)  # of these, the two that change the plane's direction


class CordParameters:
    """Parameters of one sensor, all in mm: interior control points, tangents, and the plane.

    The first and last two control points and the end tangents stay where they are in the plane's
    frame. The frame moves along its normal and, in the plane, across the path's chord, and turns
    about the path's middle; a turn counts as the movement it causes at half the path's extent. Of a
    plane that is free but for its direction, the turns that change it are to stay zero.
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
        self.has_plane = not sensor.free.isdisjoint(PLANE_FREEDOMS)
        self.tilts = "plane" in sensor.free
        self.size = 2 * len(rows) + FRAME_SIZE * self.has_plane
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
        _, self.first, self.second = hermite_basis(k, CURVATURE_SAMPLES_PER_SPAN)
        #: The least speed (q,) that a path may have there: a share of its span's chord, or what it
        #: is drawn with.
        speed = np.linalg.norm(self.first @ self.stack, axis=1)
        chord = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
        slowest = np.minimum(
            _MIN_SPEED_FRACTION * np.repeat(chord, CURVATURE_SAMPLES_PER_SPAN + 1), speed
        )
        self.least_speed = np.maximum(slowest, 1e-3 * speed.max())


def independent_parameters(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Float]:
    """Like `together`, for cords that go their own ways."""
    cords = [CordParameters(s) for s in sensors]
    starts = np.cumsum([0, *(c.size for c in cords)])
    return cords, _spread_matrix(
        [_parameter_numbers(c, k) for c, k in zip(cords, starts[:-1].tolist(), strict=True)]
    )


def shared_parameters(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Float]:
    """Freedoms of a layout whose coplanar cords stay coplanar where their plane is free, and the
    matrix (sum of the cords' sizes, size) from the layout's parameters to theirs."""
    cords: list[CordParameters] = []
    own: list[Int] = []
    count = 0
    for sensor in sensors:
        sensor = replace(sensor, free=effective_freedom(sensor, sensors))
        lead = next((i for i, c in enumerate(cords) if _shares_free_plane(c, sensor)), None)
        if lead is None:
            cord = CordParameters(sensor)
            own.append(_parameter_numbers(cord, count))
            count += cord.size
        else:
            leader = cords[lead]
            cord = CordParameters(change_frame(sensor, leader.sensor.plane), leader)
            own.append(
                np.concatenate(
                    [_parameter_numbers(cord, count)[:-FRAME_SIZE], own[lead][-FRAME_SIZE:]]
                )
            )
            count += cord.size - FRAME_SIZE
        cords.append(cord)
    return cords, _spread_matrix(own)


def effective_freedom(sensor: Sensor, sensors: Sequence[Sensor]) -> frozenset[str]:
    """A cord's freedom less what others in its plane have not: a plane is as free as the least free
    of its cords."""
    same = [s.free for s in sensors if s.plane.coincides(sensor.plane)]
    if not all(free & PLANE_FREEDOMS for free in same):
        return sensor.free - PLANE_FREEDOMS
    if not all("plane" in free for free in same):
        return sensor.free - {"plane"} | {"offset"}
    return sensor.free


def _parameter_numbers(cord: CordParameters, start: int) -> Int:
    """Numbers (size,) of a cord's parameters from `start`, below zero for those that stay zero."""
    own = start + np.arange(cord.size)
    if cord.has_plane and not cord.tilts:
        own[_TILT_PARAMETERS] = -1
    return own


def _spread_matrix(own: Sequence[Int]) -> Float:
    numbers = np.concatenate([np.zeros(0, int), *own])
    moves = numbers >= 0
    known, which = np.unique(numbers[moves], return_inverse=True)
    out = np.zeros((len(numbers), len(known)))
    out[np.flatnonzero(moves), which] = 1.0
    return out


def _shares_free_plane(cord: CordParameters, sensor: Sensor) -> bool:
    return (
        cord.has_plane
        and not sensor.free.isdisjoint(PLANE_FREEDOMS)
        and cord.sensor.plane.coincides(sensor.plane)
    )


def change_frame(sensor: Sensor, plane: Plane) -> Sensor:
    """The same cord in another frame of its plane."""
    turn = plane.axes[:, :2].T @ sensor.plane.axes[:, :2]
    shift = (sensor.plane.origin - plane.origin) @ plane.axes[:, :2]
    curve = sensor.curve
    return replace(
        sensor,
        plane=plane,
        curve=Hermite(curve.points @ turn.T + shift, curve.tangents @ turn.T),
    )
