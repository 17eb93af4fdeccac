"""The distance of cords from where they were, under their limits, for a repair."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import catmull_rom
from ...core.device.device import Sensor
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import SignedDistance
from ..limits.constraints import Constraints
from ..problem.cord_parameters import CordParameters
from ..problem.objective import QuadraticModel
from ..problem.problem import Limits
from ..search.starting_layouts import Layout
from .descent import apply_parameters

_PATH, _PATH_AND_PLANE = frozenset({"path", "ends"}), frozenset({"path", "ends", "plane"})
_DIFFERENCE_MM = 1e-5  # for the derivatives of tangents by points
_TANGENT_WEIGHT = 1e-3  # of changes of the stack that do not move the path
_SMOOTH_TOLERANCE_MM = 2e-3  # within which tangents follow from the points


class RepairProgram:
    """The mean squared movement of cords, and the limits, as functions of what may change.

    Tangents that follow from the points keep following from them.

    Args:
        surface: The body's surface.
        depth: Depth below it.
        limits: The limits.
        layout: All cords.
        target: The cords as they should be as far as possible, with as many points.
        names: Names of the cords that move.
        has_plane: Whether their planes move, too.
    """

    def __init__(
        self,
        surface: Surface,
        depth: SignedDistance,
        limits: Limits,
        layout: Layout,
        target: Layout,
        names: Collection[str],
        has_plane: bool,
    ) -> None:
        self._layout = layout
        self._cords = [
            CordParameters(replace(s, free=_freedom(s, names, has_plane))) for s in layout
        ]
        self._free = [
            _FreeCord(cord, aim) for cord, aim in zip(self._cords, target, strict=True) if cord.size
        ]
        self._constraints = Constraints(surface, depth, limits, self._cords)
        self.size = sum(cord.size for cord in self._free)

    def model(self, y: Float) -> QuadraticModel:
        """Return the quadratic model of one plus the mean squared movement, mm^2."""
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
        """Return the limits, and their derivatives."""
        room, rows = self._constraints(self._spread(y))
        out, at, done = np.zeros((len(rows), self.size)), 0, 0
        for cord, part in zip(self._free, self._parts(y), strict=True):
            out[:, done : done + cord.size] = (
                rows[:, at : at + cord.parameters.size] @ cord.spread(part)[1]
            )
            at, done = at + cord.parameters.size, done + cord.size
        return room, out

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
    """One cord that moves: its control points, its tangents unless they follow, its plane."""

    def __init__(self, parameters: CordParameters, target: Sensor) -> None:
        self.parameters = parameters
        curve = parameters.sensor.curve
        self._points, self._tangents = curve.points, curve.tangents
        self._is_smooth = np.allclose(
            self._tangents, catmull_rom(self._points), atol=_SMOOTH_TOLERANCE_MM
        )
        inside = parameters.stack.size
        self.size = parameters.size - (inside // 2 if self._is_smooth else 0)
        ahead = np.concatenate([target.curve.points, target.curve.tangents])
        self._offset = (parameters.stack - ahead).ravel()
        basis, weight = parameters.basis, np.full(parameters.size, 1.0)
        weight[:inside] = _TANGENT_WEIGHT
        self._metric = np.diag(weight)
        self._metric[:inside, :inside] += np.kron(
            basis.T @ basis / len(basis), np.eye(curve.points.shape[1])
        )

    def spread(self, y: Float) -> tuple[Float, Float]:
        """Return all parameters at what may change, y (size,), and their derivatives."""
        if not self._is_smooth:
            return y, np.eye(self.size)
        count = self._points.size
        moved = self._points + y[:count].reshape(self._points.shape)
        tangents = catmull_rom(moved)
        steps = _DIFFERENCE_MM * np.eye(count).reshape(count, *self._points.shape)
        by = (catmull_rom(moved + steps) - tangents).reshape(count, -1).T / _DIFFERENCE_MM
        x = np.concatenate([y[:count], (tangents - self._tangents).ravel(), y[count:]])
        rows = np.zeros((len(x), self.size))
        rows[:count, :count] = np.eye(count)
        rows[count : 2 * count, :count] = by
        rows[2 * count :, count:] = np.eye(self.size - count)
        return x, rows

    def movement(self, y: Float) -> tuple[float, Float, Float]:
        """Return the mean squared movement at y (size,), its gradient and Gauss-Newton matrix."""
        x, rows = self.spread(y)
        x = x.copy()
        x[: len(self._offset)] += self._offset
        pull = self._metric @ x
        return float(x @ pull), 2 * rows.T @ pull, 2 * rows.T @ self._metric @ rows


def _freedom(sensor: Sensor, names: Collection[str], has_plane: bool) -> frozenset[str]:
    if sensor.name not in names:
        return frozenset()
    return _PATH_AND_PLANE if has_plane and sensor.curve.is_planar else _PATH
