"""Hold candidate cords in arrays, screen them by the limits, and compute their signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import Hermite, Plane, arc_lengths, catmull_rom, curvature, hermite_basis
from ...core.device.device import Sensor
from ...core.device.regions import hull_points
from ...geometry.kernels.surface_queries import SignedDistance
from ...mechanics.elements.threads import count_cores, run_in_chunks
from ..limits.constraints import required_depth, strand_separation
from ..limits.inlets import MARGIN_MM, MAX_INLET_MM, RUN_SAMPLES, run_lengths
from ..limits.polyline_distance import self_gaps
from ..problem.depth_grid import DepthGrid
from ..problem.problem import Limits, Problem

COARSE_SAMPLES = 40  #: Points of a candidate's path.


@dataclass(frozen=True)
class CandidateBatch:
    """Candidate cords as arrays.

    Attributes:
        like: Sensor whose name and freedom the candidates have.
        origins: (c, 3) mm, origins of the planes.
        axes: (c, 3, 3), axes of the planes in columns.
        points: (c, k, 2) mm, control points; (c, k, 3) for paths in space.
        tangents: Tangents of the same shape, mm.
    """

    like: Sensor
    origins: Float
    axes: Float
    points: Float
    tangents: Float

    def __len__(self) -> int:
        return len(self.points)

    def paths(self, count: int) -> Float:
        """Return `count` points of each path, evenly spaced in the parameter, (c, count, 3) mm."""
        few = hermite_basis(self.points.shape[1], 24)[0][self.at(count)]
        local = few @ np.concatenate([self.points, self.tangents], axis=1)
        return np.asarray(self.origins[:, None] + self._turn(local))

    def _turn(self, local: Float) -> Float:
        """Return directions (c, n, 2 or 3) in the candidates' frames in the rest frame."""
        return np.asarray(local @ self.axes[:, :, : local.shape[2]].swapaxes(1, 2))

    def at(self, count: int) -> Int:
        """Return the numbers of the samples, 24 a span, that `paths` takes."""
        last = 24 * (self.points.shape[1] - 1)
        return np.asarray(np.round(np.linspace(0, last, count)).astype(int))

    def out(self) -> Float:
        """Return the unit directions (c, 2, 3) of the straight runs from the paths' ends."""
        ends = self._turn(self.tangents[:, [0, -1]])
        size = np.maximum(np.linalg.norm(ends, axis=2, keepdims=True), 1e-12)
        return np.asarray(ends / size * np.array([[-1.0], [1.0]]))

    def waved(self, waves: Float, size: Float) -> CandidateBatch:
        """Add waves across the chords of planar paths.

        The first and last two control points and the end tangents stay, and so do paths with waves
        of size 0.

        Args:
            waves: Waves (c, k) at the control points.
            size: Their sizes (c,) mm.
        """
        chord = self.points[:, -1] - self.points[:, 0]
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        side = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.maximum(length, 1e-6)
        side = np.where(length > 1e-6, side, [0.0, 1.0])
        points, tangents = self.points.copy(), self.tangents.copy()
        points[:, 2:-2] += (waves * size[:, None])[:, 2:-2, None] * side[:, None]
        moved = size > 0
        tangents[moved, 1:-1] = catmull_rom(points[moved])[:, 1:-1]
        return replace(self, points=points, tangents=tangents)

    def lifted(self, waves: Float, size: Float) -> CandidateBatch:
        """Add waves along the normals of planar paths, which gives paths in space.

        The first and last two control points and the end tangents stay.

        Args:
            waves: Waves (c, k) at the control points.
            size: Their sizes (c,) mm.
        """
        height = np.zeros((*self.points.shape[:2], 1))
        height[:, 2:-2, 0] = (waves * size[:, None])[:, 2:-2]
        slope = catmull_rom(height)
        slope[:, [0, -1]] = 0
        return replace(
            self,
            points=np.concatenate([self.points, height], axis=2),
            tangents=np.concatenate([self.tangents, slope], axis=2),
        )

    def take(self, which: Int) -> CandidateBatch:
        """Return the candidates of the given numbers."""
        arrays = (self.origins, self.axes, self.points, self.tangents)
        return CandidateBatch(self.like, *(a[which] for a in arrays))

    def sensor(self, i: int) -> Sensor:
        """Return candidate `i` as a sensor."""
        return replace(
            self.like,
            plane=Plane(self.origins[i], self.axes[i]),
            curve=Hermite(self.points[i], self.tangents[i]),
        )


def find_feasible(
    batch: CandidateBatch, depth: SignedDistance, grid: DepthGrid, limits: Limits
) -> Int:
    """Return the numbers of the candidates that keep the limits on coarse samples.

    Args:
        batch: The candidates.
        depth: Exact depth below the surface.
        grid: Depth on a grid, for the first tests.
        limits: The limits.
    """
    kept = np.arange(len(batch))

    def narrow(good: Bool) -> None:
        nonlocal batch, kept
        batch, kept = batch.take(np.flatnonzero(good)), kept[good]

    bend = np.abs(curvature(batch.points, batch.tangents, 6)).max(axis=1)
    narrow(np.asarray(bend * limits.min_radius < 0.98))
    for count in (8, COARSE_SAMPLES):  # most candidates fail at a few points already
        narrow(np.asarray(grid(batch.paths(count)).min(axis=1) > 0))
    if limits.kept_whole:
        narrow(_spares_kept(batch, limits))
    paths, out = batch.paths(COARSE_SAMPLES), batch.out()
    ends = np.stack(
        [
            grid.exits(paths[:, 0], out[:, 0], MAX_INLET_MM - 1),
            grid.exits(paths[:, -1], out[:, 1], MAX_INLET_MM - 1),
        ],
        axis=1,
    )
    leaves = np.asarray(np.isfinite(ends).all(axis=1))
    narrow(leaves)
    if not len(kept):
        return kept
    ends = ends[leaves]
    mouths = paths[leaves][:, [0, -1]] + ends[:, :, None] * out[leaves]
    rooms = [room.reshape(-1, 2) for room, _ in limits.mouth_rooms(mouths.reshape(-1, 3))]
    if limits.pad[0]:
        between = np.linalg.norm(mouths[:, 1] - mouths[:, 0], axis=1)
        rooms.append(between[:, None] - limits.pad_to_pad)
    if rooms:
        inside = np.all([(room > MARGIN_MM).all(axis=1) for room in rooms], axis=0)
        narrow(inside)
        leaves[leaves] = inside
        ends = ends[inside]
        if not len(kept):
            return kept
    whole = _with_runs(paths[leaves], out[leaves], run_lengths(ends))
    along = arc_lengths(whole)
    rest = ends - run_lengths(ends)
    to_exit = np.minimum(along + rest[:, :1], along[:, -1:] - along + rest[:, 1:])
    need, _ = required_depth(to_exit, limits)
    depths = grid(whole)
    good = np.asarray((depths - need).min(axis=1) >= -grid.error)
    length = along[:, -1] + rest.sum(axis=1)
    good &= (length > limits.shortest + MARGIN_MM) & (length < limits.longest - MARGIN_MM)
    close = good[:, None] & (depths - need < grid.error)
    depths[close] = depth(whole[close])
    good &= (depths >= need).all(axis=1)
    good[good] = self_gaps(whole[good], strand_separation(limits)) >= (
        limits.clearance + np.diff(along[good]).max(axis=1) / 4
    )
    return np.asarray(kept[good])


def _spares_kept(batch: CandidateBatch, limits: Limits) -> Bool:
    """Return which candidates (c,) cross no region that is kept whole, and do not cut one."""
    paths = batch.paths(COARSE_SAMPLES)
    room = limits.room_to_kept(paths.reshape(-1, 3))[0].reshape(paths.shape[:2])
    good = (room > MARGIN_MM).all(axis=1)
    if limits.is_cut and batch.points.shape[2] == 2:
        for shape in limits.kept_whole:
            heights = (hull_points(shape) - batch.origins[:, None]) @ batch.axes[:, :, 2, None]
            low, high = heights[..., 0].min(axis=1), heights[..., 0].max(axis=1)
            good &= (low > MARGIN_MM) | (high < -MARGIN_MM)
    return np.asarray(good)


def _with_runs(paths: Float, out: Float, runs: Float) -> Float:
    """Return paths (c, p, 3) with samples of their runs (c, 2) mm along `out` (c, 2, 3)."""
    s = (np.arange(RUN_SAMPLES) + 1)[:, None] / RUN_SAMPLES
    start = paths[:, :1] + (runs[:, 0, None, None] * s) * out[:, None, 0]
    end = paths[:, -1:] + (runs[:, 1, None, None] * s) * out[:, None, 1]
    return np.concatenate([start[:, ::-1], paths, end], axis=1)


@dataclass(frozen=True)
class Pool:
    """Feasible candidates for one cord.

    Attributes:
        batches: The candidates, in order.
        paths: (c, p, 3) mm, coarse paths of all candidates.
        signals: (n, c), their signals in all states, rest first.
    """

    batches: tuple[CandidateBatch, ...]
    paths: Float
    signals: Float

    def __len__(self) -> int:
        return len(self.paths)

    @classmethod
    def of(cls, problem: Problem, sensor: Sensor) -> Pool:
        """Create a pool of a single cord."""
        plane, curve = sensor.plane, sensor.curve
        arrays = (plane.origin, plane.axes, curve.points, curve.tangents)
        batch = CandidateBatch(sensor, *(a[None] for a in arrays))
        paths = batch.paths(COARSE_SAMPLES)
        return cls((batch,), paths, problem.signals(paths))

    @classmethod
    def empty(cls, problem: Problem) -> Pool:
        """Create a pool without candidates."""
        return cls((), np.zeros((0, COARSE_SAMPLES, 3)), np.zeros((len(problem.markers), 0)))

    def sensor(self, i: int, name: str, free: frozenset[str]) -> Sensor:
        """Return candidate `i` with the given name and freedom."""
        for batch in self.batches:
            if i < len(batch):
                found = replace(batch.sensor(i), name=name, free=free)
                return found if found.curve.is_planar else found.in_space()
            i -= len(batch)
        raise IndexError(i)

    def plus(self, other: Pool) -> Pool:
        """Return the candidates of this pool and another."""
        return Pool(
            self.batches + other.batches,
            np.concatenate([self.paths, other.paths]),
            np.concatenate([self.signals, other.signals], axis=1),
        )


def build_pool(
    problem: Problem, makers: Sequence[Callable[[], CandidateBatch]], keep_first: bool = False
) -> Pool:
    """Collect the candidates that keep the limits, and compute their signals.

    Args:
        problem: The problem.
        makers: Functions that make candidates; they run on all cores.
        keep_first: Keep the very first candidate even if it breaks a limit.
    """
    kept: list[CandidateBatch] = [None] * len(makers)  # type: ignore[list-item]
    problem.grid, problem.depth, problem.carrier  # noqa: B018 - computed once for all threads

    def work(start: int, stop: int) -> None:
        for n in range(start, stop):
            batch = makers[n]()
            which = find_feasible(batch, problem.depth, problem.grid, problem.limits)
            if keep_first and n == 0:
                which = np.union1d([0], which)
            kept[n] = batch.take(which)

    run_in_chunks(work, len(makers), count_cores(), 1)
    paths = np.concatenate(
        [np.zeros((0, COARSE_SAMPLES, 3)), *(b.paths(COARSE_SAMPLES) for b in kept)]
    )
    return Pool(tuple(kept), paths, problem.signals(paths))
