"""Define the free parameters of cords, alone or shared by cords in one plane, and round them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import Hermite, Plane, hermite_basis, per_span_for_signal
from ...core.device.device import PLANE_FREEDOMS, Sensor

FRAME_SIZE = 5  #: Parameters of a free plane: two moves and three turns, the last in the plane.
#: Samples of a span at which its curvature is limited; between 8 samples it can be 10 % larger.
CURVATURE_SAMPLES_PER_SPAN = 24
_MIN_SPEED_FRACTION = 0.2  # of the span's chord
_TILT_PARAMETERS = slice(-3, -1)  # the two parameters that change the plane's direction
#: Decimals of lengths (mm) and of directions to which layouts are rounded: much finer than any
#: printer, and much coarser than differences between processors that find the same layout.
_LENGTH_DECIMALS, _DIRECTION_DECIMALS = 4, 6


class CordParameters:
    """The free parameters of one sensor, all in mm: control points, tangents and plane.

    The first and last two control points and the end tangents stay fixed in the plane's frame,
    unless the ends of a path in space are free: then all points and tangents are parameters. The
    frame moves along its normal and, in the plane, across the path's chord, and turns about the
    path's middle; a turn counts as the movement it causes at half the path's extent. If the plane
    is free but keeps its direction, the turns that change the direction must stay zero.

    Args:
        sensor: The sensor.
        lead: Parameters of a cord in the same frame. The frame's parameters then mean the same for
            both cords: equal values keep them in one plane.

    Attributes:
        sensor: The sensor.
        stack: (2 k, d) mm, control points above tangents; d is 2 in a plane and 3 in space.
        rows: (r,) numbers of the free rows of `stack`.
        has_plane: Whether the plane is free.
        tilts: Whether the plane's direction is free.
        size: Number of parameters.
        moves: (2, 3) unit directions of the frame's moves.
        center: (d,) mm, the point of the plane that the frame turns about.
        pivot: (3,) mm, the same point in the rest frame.
        reach: Half the path's extent, mm.
        basis: (p, 2 k), maps `stack` to the samples of the path.
        basis_of_rows: (p, r), the columns of the free rows.
        first: (q, 2 k), maps `stack` to first derivatives where curvature is limited.
        second: (q, 2 k), the same for second derivatives.
        least_speed: (q,) smallest speed there: a share of the span's chord or the speed as drawn.
    """

    def __init__(self, sensor: Sensor, lead: CordParameters | None = None) -> None:
        curve, self.sensor = sensor.curve, sensor
        k, dimensions = curve.points.shape
        self.stack = np.concatenate([curve.points, curve.tangents])
        rows = [*range(2, k - 2), *range(k + 1, 2 * k - 1)] if "path" in sensor.free else []
        if "ends" in sensor.free:
            rows = [*range(2 * k)]
        self.rows = np.array(rows, int)
        self.has_plane = not sensor.free.isdisjoint(PLANE_FREEDOMS)
        self.tilts = "plane" in sensor.free
        self.size = dimensions * len(rows) + FRAME_SIZE * self.has_plane
        if not curve.is_planar:
            self.moves, self.reach = np.zeros((2, 3)), 1.0  # the frame does not move
            self.center = (curve.points.min(0) + curve.points.max(0)) / 2
            self.pivot = sensor.plane.to_world(self.center)
        elif lead is None:
            chord = curve.points[-1] - curve.points[0]
            side = np.array([-chord[1], chord[0]]) if np.linalg.norm(chord) > 1e-6 else np.eye(2)[1]
            side = sensor.plane.axes[:, :2] @ side / np.linalg.norm(side)
            self.moves = np.stack([sensor.plane.normal, side])
            self.center = (curve.points.min(0) + curve.points.max(0)) / 2
            self.pivot = sensor.plane.to_world(self.center)
            self.reach = float(np.linalg.norm(np.ptp(curve.points, axis=0))) / 2
        else:
            self.moves, self.center = lead.moves, lead.center
            self.pivot, self.reach = lead.pivot, lead.reach
        self.basis = hermite_basis(k, per_span_for_signal(curve))[0]
        self.basis_of_rows = np.ascontiguousarray(self.basis[:, self.rows])
        _, self.first, self.second = hermite_basis(k, CURVATURE_SAMPLES_PER_SPAN)
        speed = np.linalg.norm(self.first @ self.stack, axis=1)
        chord = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
        slowest = np.minimum(
            _MIN_SPEED_FRACTION * np.repeat(chord, CURVATURE_SAMPLES_PER_SPAN + 1), speed
        )
        self.least_speed = np.maximum(slowest, 1e-3 * speed.max())


def independent_parameters(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Float]:
    """Return the parameters of cords that move independently; see `shared_parameters`."""
    cords = [CordParameters(s) for s in sensors]
    starts = np.cumsum([0, *(c.size for c in cords)])
    return cords, _spread_matrix(
        [_parameter_numbers(c, k) for c, k in zip(cords, starts[:-1].tolist(), strict=True)]
    )


def shared_parameters(sensors: Sequence[Sensor]) -> tuple[list[CordParameters], Float]:
    """Return the parameters of a layout whose coplanar cords stay coplanar.

    Args:
        sensors: The cords. Those in one free plane share its parameters.

    Returns:
        The cords' parameters, and the matrix (sum of the cords' sizes, size) from the layout's
        parameters to those of the cords.
    """
    cords: list[CordParameters] = []
    numbers: list[Int] = []
    count = 0
    for sensor in sensors:
        sensor = replace(sensor, free=effective_freedom(sensor, sensors))
        lead = next((i for i, c in enumerate(cords) if _shares_free_plane(c, sensor)), None)
        if lead is None:
            cord = CordParameters(sensor)
            numbers.append(_parameter_numbers(cord, count))
            count += cord.size
        else:
            leader = cords[lead]
            cord = CordParameters(change_frame(sensor, leader.sensor.plane), leader)
            numbers.append(
                np.concatenate(
                    [_parameter_numbers(cord, count)[:-FRAME_SIZE], numbers[lead][-FRAME_SIZE:]]
                )
            )
            count += cord.size - FRAME_SIZE
        cords.append(cord)
    return cords, _spread_matrix(numbers)


def effective_freedom(sensor: Sensor, sensors: Sequence[Sensor]) -> frozenset[str]:
    """Return a cord's freedom without the plane freedoms that other cords in its plane lack.

    Args:
        sensor: The cord.
        sensors: All cords of the layout, the cord included.
    """
    if not sensor.curve.is_planar:
        return sensor.free
    freedoms = [s.free for s in _in_plane_of(sensor, sensors)]
    if not all(free & PLANE_FREEDOMS for free in freedoms):
        return sensor.free - PLANE_FREEDOMS
    if not all("plane" in free for free in freedoms):
        return sensor.free - {"plane"} | {"offset"}
    return sensor.free


def _parameter_numbers(cord: CordParameters, start: int) -> Int:
    """Number (size,) a cord's parameters from `start`; -1 marks those that stay zero."""
    numbers = start + np.arange(cord.size)
    if cord.has_plane and not cord.tilts:
        numbers[_TILT_PARAMETERS] = -1
    return numbers


def _spread_matrix(cords: Sequence[Int]) -> Float:
    """Return the matrix from the distinct numbered parameters to all cords' parameters."""
    numbers = np.concatenate([np.zeros(0, int), *cords])
    is_free = numbers >= 0
    columns, column = np.unique(numbers[is_free], return_inverse=True)
    out = np.zeros((len(numbers), len(columns)))
    out[np.flatnonzero(is_free), column] = 1.0
    return out


def _shares_free_plane(cord: CordParameters, sensor: Sensor) -> bool:
    return (
        cord.has_plane  # so it is planar
        and not sensor.free.isdisjoint(PLANE_FREEDOMS)
        and cord.sensor.plane.coincides(sensor.plane)
    )


def change_frame(sensor: Sensor, plane: Plane) -> Sensor:
    """Express a cord in another frame of its plane."""
    turn = plane.axes[:, :2].T @ sensor.plane.axes[:, :2]
    shift = (sensor.plane.origin - plane.origin) @ plane.axes[:, :2]
    curve = sensor.curve
    return replace(
        sensor,
        plane=plane,
        curve=Hermite(curve.points @ turn.T + shift, curve.tangents @ turn.T),
    )


def round_layout(layout: tuple[Sensor, ...]) -> tuple[Sensor, ...]:
    """Round the free quantities of a layout; fixed ones stay as they are.

    Cords in one free plane stay in it, in the frame of the first of them.
    """
    out: list[Sensor] = []
    for sensor, lead in zip(layout, _first_in_planes(layout), strict=True):
        free = effective_freedom(sensor, layout)
        if free & PLANE_FREEDOMS and not _is_same_frame(sensor.plane, lead.plane):
            sensor = change_frame(sensor, lead.plane)
        out.append(_round_sensor(sensor, free))
    return tuple(out)


def _first_in_planes(layout: Sequence[Sensor]) -> list[Sensor]:
    """Return for each cord the first cord in its plane."""
    return [_in_plane_of(s, layout)[0] if s.curve.is_planar else s for s in layout]


def _in_plane_of(sensor: Sensor, sensors: Sequence[Sensor]) -> list[Sensor]:
    """Return the planar cords in the plane of one of them."""
    return [s for s in sensors if s.curve.is_planar and s.plane.coincides(sensor.plane)]


def _is_same_frame(a: Plane, b: Plane) -> bool:
    return np.array_equal(a.origin, b.origin) and np.array_equal(a.axes, b.axes)


def _round_sensor(sensor: Sensor, free: frozenset[str]) -> Sensor:
    curve, plane = sensor.curve, sensor.plane
    if "path" in free:
        curve = Hermite(
            _round_values(curve.points, _LENGTH_DECIMALS),
            _round_values(curve.tangents, _LENGTH_DECIMALS),
        )
    origin = _round_values(plane.origin, _LENGTH_DECIMALS)
    if "plane" in free:
        normal, x_axis = (
            _round_values(v, _DIRECTION_DECIMALS) for v in (plane.normal, plane.axes[:, 0])
        )
        plane = Plane.from_normal(origin, normal, x_axis)
    elif "offset" in free:
        plane = Plane(origin, plane.axes)
    return replace(sensor, curve=curve, plane=plane)


def _round_values(values: Float, decimals: int) -> Float:
    return np.round(values, decimals) + 0.0  # no negative zeros
