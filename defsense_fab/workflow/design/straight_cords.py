"""Place thousands of straight cords in one plane, and compute their signals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import Hermite, Plane, catmull_rom, per_span_for_signal, sample_path
from ...core.device.device import Sensor
from ...optimization.prediction.as_built import assumed_ends, prestretch_for
from ...optimization.prediction.design_task import DesignTask
from ...optimization.problem.cord_signals import CordCarrier, SignalModel
from ...optimization.search.candidates import CandidateBatch, find_feasible
from ...sensing.built_cord import held_response
from ...sensing.response import Response

_KNOTS = 4  # control points of a straight cord, which the user can drag
_SAMPLES = 24  # of a path, for its depth
_END_DEPTH_MM = 2.0  # of a path's ends below the skin; its channel continues straight


class StraightCords:
    """Straight cords of a device in one plane, next to its present cords.

    Args:
        task: Design task of the device.
        plane: The plane.
        sensors: The present cords.

    Attributes:
        plane: The same plane.
    """

    def __init__(self, task: DesignTask, plane: Plane, sensors: Sequence[Sensor]) -> None:
        self._task, self.plane = task, plane
        self._others = [sample_path(sensor) for sensor in sensors]
        problem = task.everything
        # Held cords respond to their mean strain, bonded ones with the mean of local responses.
        bonded = task.fabrication.assembly == "bonded"
        response = task.reading.response if bonded else Response.line(1.0)
        self._bonded = bonded
        self._carrier = CordCarrier(problem.locator, problem.fields, SignalModel(response, bonded))

    def directions(self, count: int) -> Float:
        """Return unit directions (count, 3) evenly over half a turn, the plane's x axis first."""
        angle = np.pi * np.arange(count) / count
        return np.stack([np.cos(angle), np.sin(angle)], axis=1) @ self.plane.axes[:, :2].T

    def short(self, points: Float, directions: Float, length: float) -> tuple[Float, Bool]:
        """Place cords of a given length whose ends lie inside the body.

        The point is in the middle of the cord, or as close to it as the skin allows.

        Args:
            points: Points (k, 3) mm.
            directions: Unit directions (k, 3).
            length: Length of the cords, mm.

        Returns:
            Ends (k, 2, 3) mm, and which cords (k,) keep their wall and distances.
        """
        problem, depth = self._task.everything, self._task.design.limits.depth
        back, ahead = (
            np.minimum(problem.grid.exits(points, s * directions, length + depth), length + depth)
            - depth
            for s in (-1.0, 1.0)
        )
        start = np.minimum(np.maximum(-length / 2, -back), ahead - length)
        good = (start >= -back) & (start <= 0) & (start + length >= 0)
        ends = points[:, None] + (start[:, None] + [0.0, length])[..., None] * directions[:, None]
        lines = _lines(ends[good], _SAMPLES)
        good[good] = problem.grid(lines).min(axis=1) >= depth
        good[good] = self._clear(ends[good])
        return ends, good

    def through(self, points: Float, directions: Float) -> tuple[Float, Bool]:
        """Place cords from skin to skin.

        Args:
            points: Points (k, 3) mm.
            directions: Unit directions (k, 3).

        Returns:
            Ends (k, 2, 3) mm, and which cords (k,) keep their wall, length and distances.
        """
        problem = self._task.everything
        longest = float(np.linalg.norm(np.ptp(problem.surface.bounds, axis=0)))
        back, ahead = (problem.grid.exits(points, s * directions, longest) for s in (-1.0, 1.0))
        good = np.isfinite(back + ahead) & (back + ahead > 4 * _END_DEPTH_MM)
        along = np.stack([_END_DEPTH_MM - back, ahead - _END_DEPTH_MM], axis=1)
        along[~good] = [0.0, 1.0]
        ends = points[:, None] + along[..., None] * directions[:, None]
        limits = self._task.design.limits
        some = np.flatnonzero(good)
        kept = some[find_feasible(self._batch(ends[some]), problem.depth, problem.grid, limits)]
        good = np.zeros(len(points), bool)
        good[kept] = self._clear(ends[kept])
        return ends, good

    def read(self, ends: Float) -> tuple[Float, Float]:
        """Compute the signals of cords, equal to those of `assumed_cords`.

        Args:
            ends: Ends (k, 2, 3) mm.

        Returns:
            Signals (n, k) in all states, rest first, and noise (k,).
        """
        task = self._task
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        hidden, series = np.array([assumed_ends(task, x) for x in length]).reshape(-1, 2).T
        share = (hidden / length)[:, None, None]
        stretched = ends * (1 - share) + ends[:, ::-1] * share
        count = (_KNOTS - 1) * per_span_for_signal(self._curve(ends[0])) + 1 if len(ends) else 2
        responses = self._carrier.signals(_lines(stretched, count))
        length = length - 2 * hidden
        conducting = np.empty(len(ends))
        for prestretch, members in self._by_prestretch(responses):
            if prestretch is not None:
                responses[:, members] = held_response(task.reading.response, prestretch)(
                    responses[:, members]
                )
            conducting[members] = task.reading.conducting_length(1.0, prestretch) * length[members]
        section = task.reading.section
        if section is not None:
            conducting *= [float(section.relative_resistance(pair)[0]) for pair in ends]
        signals = responses * conducting / (conducting + series)
        noise = task.reading.noise_at(task.reading.ohm_per_mm * (conducting + series))
        return np.concatenate([np.zeros((1, len(ends))), signals]), noise

    def sensor(self, name: str, ends: Float) -> Sensor:
        """Return the cord between two ends (2, 3) mm."""
        return Sensor(name, self.plane, self._curve(ends), frozenset({"path"}))

    def _by_prestretch(self, strain: Float) -> list[tuple[float | None, Int]]:
        """Group cords by their pre-stretch, None for bonded cords."""
        everyone = np.arange(strain.shape[1])
        if self._bonded:
            return [(None, everyone)]
        prestretch = self._task.fabrication.prestretch
        if prestretch is not None:
            return [(prestretch, everyone)]
        each = np.array([prestretch_for(column) for column in strain.T])
        return [(float(p), np.flatnonzero(each == p)) for p in np.unique(each)]

    def _curve(self, ends: Float) -> Hermite:
        local = (ends - self.plane.origin) @ self.plane.axes[:, :2]
        points = _lines(local[None], _KNOTS)[0]
        return Hermite(points, catmull_rom(points))

    def _batch(self, ends: Float) -> CandidateBatch:
        count = len(ends)
        local = (ends - self.plane.origin) @ self.plane.axes[:, :2]
        points = _lines(local, _KNOTS)
        like = self.sensor("proposed", self.plane.to_world(np.eye(2)))
        origins = np.broadcast_to(self.plane.origin, (count, 3))
        axes = np.broadcast_to(self.plane.axes, (count, 3, 3))
        return CandidateBatch(like, origins, axes, points, catmull_rom(points))

    def _clear(self, ends: Float) -> Bool:
        """Return which cords (k,) keep their distance from the present cords."""
        limits = self._task.design.limits
        need = limits.pad_to_pad if limits.pad[0] else limits.clearance
        way = ends[:, 1] - ends[:, 0]
        square = (way**2).sum(axis=1)[:, None]
        good = np.ones(len(ends), bool)
        for other in self._others:
            share = np.einsum("kqj,kj->kq", other - ends[:, :1], way) / square
            nearest = ends[:, :1] + np.clip(share, 0.0, 1.0)[..., None] * way[:, None]
            gap = np.linalg.norm(other - nearest, axis=2).min(axis=1)
            slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
            good &= gap >= need + slack
        return good


def _lines(ends: Float, count: int) -> Float:
    """Return points (k, count, d), evenly spaced from end to end (k, 2, d)."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.asarray(ends[:, :1] * (1 - share) + ends[:, 1:] * share)
