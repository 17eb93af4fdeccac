"""The distance of cords from where they were, under their limits, for a repair."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import catmull_rom, is_smooth
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import SignedDistance
from ..limits.constraints import Constraints
from ..problem.cord_parameters import CordParameters, independent_parameters
from ..problem.objective import QuadraticModel
from ..problem.problem import Limits
from ..search.starting_layouts import Layout
from .descent import apply_parameters

_DIFFERENCE_MM = 1e-5  # for the derivatives of tangents by points
_TANGENT_WEIGHT = 1e-3  # of changes of the stack that do not move the path


class RepairProgram:
    """The mean squared movement of cords, and the limits, as functions of what may change.

    Tangents that follow from the points keep following from them.

    Args:
        surface: The body's surface.
        depth: Depth below it.
        limits: The limits.
        layout: All cords.
        target: The cords as they should be as far as possible, with as many points.
        freedoms: What moves of the cords, as in `FREEDOMS`, by name; the other cords stay.
        check_wanted: Called before each model; what it raises ends the descent.
    """

    def __init__(
        self,
        surface: Surface,
        depth: SignedDistance,
        limits: Limits,
        layout: Layout,
        target: Layout,
        freedoms: Mapping[str, frozenset[str]],
        check_wanted: Callable[[], None],
    ) -> None:
        self._layout, self._check_wanted = layout, check_wanted
        self._cords = [
            CordParameters(replace(s, free=freedoms.get(s.name, frozenset()))) for s in layout
        ]
        self._free = [
            _FreeCord(cord, aim) for cord, aim in zip(self._cords, target, strict=True) if cord.size
        ]
        self._constraints = Constraints(surface, depth, limits, self._cords)
        self.size = sum(cord.size for cord in self._free)

    def model(self, y: Float) -> QuadraticModel:
        """Return the quadratic model of one plus the mean squared movement, mm^2."""
        self._check_wanted()
        value, gradient, hessian = 1.0, np.zeros(self.size), np.zeros((self.size, self.size))
        done = 0
        for cord, part in zip(self._free, self._parts(y), strict=True):
            columns = slice(done, done + cord.size)
            done = columns.stop
            movement, gradient[columns], hessian[columns, columns] = cord.movement(part)
            value += movement
        return QuadraticModel(value, gradient, hessian)

    def value(self, y: Float) -> float:
        """Return one plus the mean squared movement, mm^2."""
        return 1.0 + sum(
            cord.movement(part)[0] for cord, part in zip(self._free, self._parts(y), strict=True)
        )

    def inequalities(self, y: Float) -> tuple[Float, Float]:
        """Return the limits that depend on what moves, and their derivatives."""
        room, rows = self._constraints(self._spread(y))
        out, at, done = np.zeros((len(rows), self.size)), 0, 0
        for cord, part in zip(self._free, self._parts(y), strict=True):
            out[:, done : done + cord.size] = (
                rows[:, at : at + cord.parameters.size] @ cord.spread(part)[1]
            )
            at, done = at + cord.parameters.size, done + cord.size
        can_change = out.any(axis=1)  # not between cords that stay
        return room[can_change], out[can_change]

    def guard(self, y: Float, trial: Float) -> None:  # noqa: ARG002 - the limits are all there is
        """Rule nothing out."""
        return None

    def layout(self, y: Float) -> Layout:
        """Return the layout at parameters y (size,)."""
        return apply_parameters(self._cords, self._spread(y), self._layout)

    def _spread(self, y: Float) -> Float:
        parts = zip(self._free, self._parts(y), strict=True)
        return np.concatenate([np.zeros(0), *(cord.spread(part)[0] for cord, part in parts)])

    def _parts(self, y: Float) -> list[Float]:
        return np.split(y, np.cumsum([cord.size for cord in self._free])[:-1])


class _FreeCord:
    """What moves of one cord: control points, tangents unless they follow, and its plane."""

    def __init__(self, parameters: CordParameters, target: Sensor) -> None:
        self.parameters = parameters
        curve, self._rows = parameters.sensor.curve, parameters.rows
        self._points, self._tangents = curve.points, curve.tangents
        count, dimensions = curve.points.shape
        self._moved = self._rows[self._rows < count]
        self._following = self._rows[self._rows >= count] - count
        self._is_smooth = is_smooth(curve)
        inside = dimensions * len(self._rows)
        # A plane that keeps its direction has fewer parameters than a frame.
        self._by_free = independent_parameters([parameters.sensor])[1]
        self._frame = self._by_free[inside:, inside:]
        followers = dimensions * len(self._following) if self._is_smooth else 0
        self.size = self._by_free.shape[1] - followers
        ahead = np.concatenate([target.curve.points, target.curve.tangents])
        self._offset = (parameters.stack - ahead)[self._rows].ravel()
        basis, weight = parameters.basis_of_rows, np.full(parameters.size, 1.0)
        weight[:inside] = _TANGENT_WEIGHT
        self._metric = np.diag(weight)
        self._metric[:inside, :inside] += np.kron(basis.T @ basis / len(basis), np.eye(dimensions))

    def spread(self, y: Float) -> tuple[Float, Float]:
        """Return all parameters at what may change, y (size,), and their derivatives."""
        if not self._is_smooth:
            return self._by_free @ y, self._by_free
        count = self._points[self._moved].size
        steps = _DIFFERENCE_MM * np.eye(count).reshape(count, *self._points[self._moved].shape)
        points = np.tile(self._points, (1 + count, 1, 1))
        points[:, self._moved] += y[:count].reshape(-1, self._points.shape[1])
        points[1:, self._moved] += steps
        tangents = catmull_rom(points)[:, self._following]
        by = (tangents[1:] - tangents[0]).reshape(count, -1).T / _DIFFERENCE_MM
        following = (tangents[0] - self._tangents[self._following]).ravel()
        x = np.concatenate([y[:count], following, self._frame @ y[count:]])
        rows = np.zeros((len(x), self.size))
        rows[:count, :count] = np.eye(count)
        rows[count : count + len(by), :count] = by
        rows[count + len(by) :, count:] = self._frame
        return x, rows

    def movement(self, y: Float) -> tuple[float, Float, Float]:
        """Return the mean squared movement at y (size,), its gradient and Gauss-Newton matrix."""
        x, rows = self.spread(y)
        x = x.copy()
        x[: len(self._offset)] += self._offset
        pull = self._metric @ x
        return float(x @ pull), 2 * rows.T @ pull, 2 * rows.T @ self._metric @ rows
