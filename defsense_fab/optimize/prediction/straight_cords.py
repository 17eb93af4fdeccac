"""Straight cords by the thousand in one plane: where they find room, and what they would read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import Hermite, Plane, catmull_rom, per_span_for_signal, sample_path
from ...core.device.device import Sensor
from ...sensing.built_cord import held_response
from ...sensing.response import Response
from ..problem.cord_signals import CordCarrier, SignalModel
from ..search.candidates import CandidateBatch, find_feasible
from .as_built import assumed_ends, prestretch_for
from .design_task import DesignTask

_KNOTS = 4  # control points of a straight cord, for a hand to drag
_SAMPLES = 24  # of a path, for its depth
_INSIDE = 2.0  # mm that a path's ends lie below the skin; its channel runs on straight


class StraightCords:
    """Cords of a device in one `plane`, beside the `sensors` that there are."""

    def __init__(self, task: DesignTask, plane: Plane, sensors: Sequence[Sensor]) -> None:
        self._task, self.plane = task, plane
        self._others = [sample_path(sensor) for sensor in sensors]
        problem = task.everything
        # Held cords answer to their mean strain, bonded ones with the mean of their answers.
        bonded = task.fabrication.assembly == "bonded"
        response = task.reading.response if bonded else Response.line(1.0)
        self._bonded = bonded
        self._carrier = CordCarrier(problem.locator, problem.fields, SignalModel(response, bonded))

    def directions(self, count: int) -> Float:
        """Unit directions (count, 3) evenly over half a turn, the plane's x first."""
        angle = np.pi * np.arange(count) / count
        return np.stack([np.cos(angle), np.sin(angle)], axis=1) @ self.plane.axes[:, :2].T

    def short(self, points: Float, directions: Float, length: float) -> tuple[Float, Bool]:
        """Ends (k, 2, 3) mm of cords of a `length` mm through points (k, 3) along unit directions
        (k, 3), and which of them (k,) keep their wall and distances: the point is in the middle, or
        as near to it as the skin allows. Their ends lie inside the body."""
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
        """Ends (k, 2, 3) mm of cords from skin to skin, and which of them (k,) can be made: they
        keep wall, length, and distance from the others."""
        problem = self._task.everything
        longest = float(np.linalg.norm(np.ptp(problem.surface.bounds, axis=0)))
        back, ahead = (problem.grid.exits(points, s * directions, longest) for s in (-1.0, 1.0))
        good = np.isfinite(back + ahead) & (back + ahead > 4 * _INSIDE)
        along = np.stack([_INSIDE - back, ahead - _INSIDE], axis=1)
        along[~good] = [0.0, 1.0]
        ends = points[:, None] + along[..., None] * directions[:, None]
        limits = self._task.design.limits
        some = np.flatnonzero(good)
        kept = some[find_feasible(self._batch(ends[some]), problem.depth, problem.grid, limits)]
        good = np.zeros(len(points), bool)
        good[kept] = self._clear(ends[kept])
        return ends, good

    def read(self, ends: Float) -> tuple[Float, Float]:
        """Signals (n, k) in all states, rest first, and noise (k,), of cords with ends (k, 2, 3):
        those that `assumed_cords` gives for each of them."""
        task = self._task
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        hidden, series = np.array([assumed_ends(task, x) for x in length]).reshape(-1, 2).T
        share = (hidden / length)[:, None, None]
        stretched = ends * (1 - share) + ends[:, ::-1] * share
        count = (_KNOTS - 1) * per_span_for_signal(self._curve(ends[0])) + 1 if len(ends) else 2
        answers = self._carrier.signals(_lines(stretched, count))
        length = length - 2 * hidden
        conducting = np.empty(len(ends))
        for prestretch, own in self._by_prestretch(answers):
            if prestretch is not None:
                answers[:, own] = held_response(task.reading.response, prestretch)(answers[:, own])
            conducting[own] = task.reading.conducting_length(1.0, prestretch) * length[own]
        signals = answers * conducting / (conducting + series)
        noise = task.reading.noise_at(task.reading.ohm_per_mm * (conducting + series))
        return np.concatenate([np.zeros((1, len(ends))), signals]), noise

    def sensor(self, name: str, ends: Float) -> Sensor:
        """The cord between ends (2, 3)."""
        return Sensor(name, self.plane, self._curve(ends), frozenset({"path"}))

    def _by_prestretch(self, strain: Float) -> list[tuple[float | None, Int]]:
        """Cords by how far they are stretched as they are laid, None for bonded ones."""
        everyone = np.arange(strain.shape[1])
        if self._bonded:
            return [(None, everyone)]
        given = self._task.fabrication.prestretch
        if given is not None:
            return [(given, everyone)]
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
        """Which (k,) keep their distance from the cords that there are."""
        need = self._task.design.limits.clearance
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
    """Points (k, count, d), evenly from end to end (k, 2, d)."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.asarray(ends[:, :1] * (1 - share) + ends[:, 1:] * share)
