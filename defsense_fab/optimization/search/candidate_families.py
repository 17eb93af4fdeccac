"""Generate families of smooth candidate cords.

The families are variations of a drawing, paths through the body from one side to another, and paths
there and back with both ends at the body's base.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, catmull_rom, curvature
from ...core.device.device import PLANE_FREEDOMS, Sensor
from ..problem.cord_parameters import CordParameters
from ..problem.problem import Problem, sample_by_strain, sample_interior
from .candidates import CandidateBatch

_WAVES = 4  # sine waves over a path
START_DEPTH_MM = 2.0  # of a path's start below the surface; its channel continues straight
LEAD_MM = 8.0  # straight start of a path
_PROBE_SAMPLES = 16  # of a path, to keep waves away from the surface
_SPREADS = (0.05, 0.15, 0.5)  # standard deviations of directions about an axis
_KNOTS = 8  # control points of a path through the body
_PLANAR_SHARE = 0.2  # of the candidates in space


def vary_sensor(
    sensor: Sensor, count: int, spread: float, rng: np.random.Generator
) -> CandidateBatch:
    """Generate the sensor itself and random variations of it.

    Planes are moved and, unless they keep their direction, rolled about the path's chord by up to
    90 degrees either way, and tilted. Paths get a sum of sine waves across their chord. The first
    and last control points and the end tangents stay in the plane. Paths in space get waves in all
    directions.

    Args:
        sensor: The sensor.
        count: Number of variations.
        spread: Size of the largest variations, mm.
        rng: Random generator.
    """
    k = len(sensor.curve.points)
    count = count if sensor.free else 0
    n = count + 1
    size = rng.uniform(0, 1, n) * spread  # a tight body takes only small variations
    size[0] = 0
    points = np.repeat(sensor.curve.points[None], n, axis=0)
    tangents = np.repeat(sensor.curve.tangents[None], n, axis=0)
    origins = np.repeat(sensor.plane.origin[None], n, axis=0)
    axes = np.repeat(sensor.plane.axes[None], n, axis=0)
    if not sensor.free.isdisjoint(PLANE_FREEDOMS):
        parameters = CordParameters(sensor)
        angles = np.stack([rng.uniform(-np.pi / 2, np.pi / 2, n), rng.normal(0, 0.5, n)], axis=1)
        angles[0] = 0
        angles[:, 1] *= size / parameters.reach
        if "plane" not in sensor.free:
            angles[:] = 0
        chord = sensor.curve.points[-1] - sensor.curve.points[0]
        turn = Rotation.from_euler("Z", np.arctan2(chord[1], chord[0]))
        roll = (turn * Rotation.from_euler("XY", angles) * turn.inv()).as_matrix()
        axes = sensor.plane.axes @ roll
        offset = rng.uniform(-1, 1, n) * size
        pivot = sensor.plane.to_world(parameters.center) + offset[:, None] * sensor.plane.normal
        origins = pivot - axes[:, :, :2] @ parameters.center
    batch = CandidateBatch(sensor, origins, axes, points, tangents)
    if "path" not in sensor.free or k <= 4:
        return batch
    if sensor.curve.is_planar:
        return batch.waved(_waves(n, k, rng), size)
    waves = np.stack([_waves(n, k, rng) for _ in range(3)], axis=2)
    points[:, 2:-2] += (waves * size[:, None, None])[:, 2:-2]
    tangents[1:, 1:-1] = catmull_rom(points[1:])[:, 1:-1]
    return batch


def waves_through_body(
    problem: Problem, count: int, rng: np.random.Generator, normals: Float | None = None
) -> CandidateBatch:
    """Generate waves about straight lines from surface to surface.

    The lines run mostly along the body, half of them through points where the strain varies most.

    Args:
        problem: The problem.
        count: Number of lines; those that fit become candidates.
        rng: Random generator.
        normals: Unit normals (k, 3) of the planes; any direction by default.
    """
    middle, direction = _sample_lines(problem, count, rng, normals)
    return _add_waves(problem, middle, direction, random_frames(direction, rng, normals), rng)


def waves_in_plane(
    problem: Problem, plane: Plane, count: int, rng: np.random.Generator
) -> CandidateBatch:
    """Generate waves about straight lines from surface to surface in one plane.

    Args:
        problem: The problem.
        plane: The plane.
        count: Number of lines.
        rng: Random generator.
    """
    points = sample_interior(problem, 4000, rng)
    points -= ((points - plane.origin) @ plane.normal)[:, None] * plane.normal
    points = points[problem.grid(points) > problem.limits.depth]
    if len(points) < 2:
        points = np.stack([plane.origin, plane.origin + plane.axes[:, 0]])
    local = (points - plane.origin) @ plane.axes[:, :2]
    longest = np.linalg.eigh(np.cov(local.T))[1][:, 1]
    angle = np.arctan2(longest[1], longest[0]) + rng.normal(0, 1, count) * rng.choice(
        _SPREADS, count
    )
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ plane.axes[:, :2].T
    middle = points[rng.integers(len(points), size=count)]
    normal = np.broadcast_to(plane.normal, direction.shape)
    axes = np.stack([direction, np.cross(normal, direction), normal], axis=2)
    return _add_waves(problem, middle, direction, axes, rng)


def lift_into_space(
    problem: Problem, batch: CandidateBatch, rng: np.random.Generator
) -> CandidateBatch:
    """Give planar candidates waves along the normals of their planes, some of them helices.

    Waves are up to half the body's width high, and reduced where they would turn too tightly or
    come too close to the surface. A fifth of the candidates stays planar.

    Args:
        problem: The problem.
        batch: The candidates.
        rng: Random generator.
    """
    count, knots = batch.points.shape[:2]
    size = np.where(rng.random(count) < _PLANAR_SHARE, 0.0, rng.uniform(0, 1, count))
    size *= _body_width(problem) / 2
    waves = _waves(count, knots, rng)
    for _ in range(2):
        size *= _room_for_waves(problem, batch.lifted(waves, size))
    return batch.lifted(waves, size)


def straight_batch(
    problem: Problem, middle: Float, direction: Float, axes: Float
) -> CandidateBatch:
    """Return the straight cords from surface to surface that are long enough.

    Args:
        problem: The problem.
        middle: Points (c, 3) mm inside the body.
        direction: Unit directions (c, 3) of the cords.
        axes: Axes (c, 3, 3) of the planes, whose x is the direction.
    """
    back, ahead = _surface_distances(problem, middle, direction)
    length = back + ahead - 2 * START_DEPTH_MM
    good = np.isfinite(length) & (length > 3 * START_DEPTH_MM)
    back, length = back[good], length[good, None]
    lead = np.minimum(LEAD_MM, length / 6)
    along = np.linspace(0, 1, _KNOTS - 2)
    x = np.concatenate([0 * lead, lead + (length - 2 * lead) * along, length], axis=1)
    points = np.stack([x, np.zeros_like(x)], axis=2)
    origins = middle[good] - (back - START_DEPTH_MM)[:, None] * direction[good]
    return CandidateBatch(template_sensor(_KNOTS), origins, axes[good], points, catmull_rom(points))


def there_and_back(
    problem: Problem, count: int, rng: np.random.Generator, normals: Float | None = None
) -> CandidateBatch:
    """Generate cords of two parallel legs joined by a half circle.

    Both ends are at the end of the body that moves least.

    Args:
        problem: The problem.
        count: Number of lines; those that fit become candidates.
        rng: Random generator.
        normals: Unit normals (k, 3) of the planes; any direction by default.
    """
    middle, direction = _sample_lines(problem, count, rng, normals)
    back, ahead = _surface_distances(problem, middle, direction)
    inside = np.isfinite(back + ahead)
    middle, direction, back, ahead = (a[inside] for a in (middle, direction, back, ahead))
    ends = [middle - back[:, None] * direction, middle + ahead[:, None] * direction]
    moved = [np.linalg.norm(problem.deform(p) - p, axis=-1).mean(0) for p in ends]
    direction = np.where((moved[1] < moved[0])[:, None], -direction, direction)
    is_reversed = moved[1] < moved[0]
    back, ahead = np.where(is_reversed, ahead, back), np.where(is_reversed, back, ahead)
    axes = random_frames(direction, rng, normals)
    across = axes[:, :, 1]
    up, down = (problem.grid.exits(middle, s * across, 4 * _body_width(problem)) for s in (1, -1))
    widest = (up + down) / 2 - problem.limits.depth
    min_radius = problem.limits.min_radius * 1.1
    is_wide = (widest >= min_radius) & np.isfinite(widest)
    middle, direction, back, ahead, axes, across, up, down, widest = (
        a[is_wide] for a in (middle, direction, back, ahead, axes, across, up, down, widest)
    )
    radius = min_radius + rng.uniform(0, 1, len(middle)) * (widest - min_radius)
    middle = middle + ((up - down) / 2)[:, None] * across
    top = rng.uniform(-0.5, 1, len(middle)) * (ahead - problem.limits.depth)
    legs = [  # from the start of the half circle to the surface
        problem.grid.exits(
            middle + (top - radius)[:, None] * direction + (s * radius)[:, None] * across,
            -direction,
            float(back.max(initial=0) + ahead.max(initial=0)),
        )
        - START_DEPTH_MM
        for s in (1, -1)
    ]
    good = np.isfinite(legs[0] + legs[1])
    good &= np.minimum(*legs) > 3 * LEAD_MM
    n = int(good.sum())
    origins = (middle + (top - radius)[:, None] * direction)[good]
    a, zero = radius[good], np.zeros(n)
    wave = rng.normal(0, 0.3, (2, n)) * a
    x, y = [], []
    for leg, side, bulge in zip((legs[0][good], legs[1][good]), (a, -a), wave, strict=True):
        x.append([-leg, LEAD_MM - leg, (LEAD_MM - leg) / 2, zero])
        y.append([side, side, side + bulge, side])
    points = np.stack(
        [
            np.stack([*x[0], a, *x[1][::-1]], axis=1),
            np.stack([*y[0], zero, *y[1][::-1]], axis=1),
        ],
        axis=2,
    )
    tangents = catmull_rom(points)
    arc = 4 * (np.sqrt(2) - 1) * a  # of a cubic that follows a quarter circle
    half = len(x[0])
    for at, along in ((half - 1, [arc, zero]), (half, [zero, -arc]), (half + 1, [-arc, zero])):
        tangents[:, at] = np.stack(along, axis=1)
    return CandidateBatch(template_sensor(points.shape[1]), origins, axes[good], points, tangents)


def _waves(count: int, knots: int, rng: np.random.Generator) -> Float:
    """Return random sums of sine waves (count, knots), about 1 mm high; short waves are lower."""
    k = np.arange(1, _WAVES + 1)[:, None]
    shape = np.sin(k * np.pi * np.linspace(0, 1, knots)) / k
    return np.asarray(rng.normal(0, 0.5, (count, _WAVES)) @ shape)


def _add_waves(
    problem: Problem, middle: Float, direction: Float, axes: Float, rng: np.random.Generator
) -> CandidateBatch:
    """Return straight paths with waves of up to half the body's width.

    Waves are reduced where they would turn too tightly or come too close to the surface.
    """
    paths = straight_batch(problem, middle, direction, axes)
    size = rng.uniform(0, 1, len(paths)) * _body_width(problem) / 2
    waves = _waves(len(paths), _KNOTS, rng)
    for _ in range(2):
        size *= _room_for_waves(problem, paths.waved(waves, size))
    return paths.waved(waves, size)


def _room_for_waves(problem: Problem, batch: CandidateBatch) -> Float:
    """Return by which factors (c,) to reduce waves that turn too tightly or leave the body."""
    bend = np.abs(curvature(batch.points, batch.tangents, 6)).max(axis=1)
    near = problem.grid(batch.paths(_PROBE_SAMPLES)[:, 2:-2]).min(axis=1) < problem.limits.depth
    return np.asarray(
        np.where(near, 0.5, 1.0) * 0.9 / np.maximum(bend * problem.limits.min_radius, 0.9)
    )


def _sample_lines(
    problem: Problem, count: int, rng: np.random.Generator, normals: Float | None
) -> tuple[Float, Float]:
    """Draw points inside (c, 3) and unit directions (c, 3), perpendicular to one of the normals."""
    points = sample_interior(problem, 4000, rng)
    values, vectors = np.linalg.eigh(np.cov(points.T))
    deep = points[problem.grid(points) > problem.limits.depth]
    if not len(deep):
        return np.zeros((0, 3)), np.zeros((0, 3))
    half = count // 2
    some = deep[rng.integers(len(deep), size=half)]
    middle = np.concatenate([some, sample_by_strain(problem, deep[:2000], count - half, rng)])
    # Mostly along the longest axis; a stout body takes other directions, too.
    choice = rng.choice(3, count, p=values / values.sum())
    deviation = rng.normal(0, 1, (count, 3)) * rng.choice(_SPREADS, (count, 1))
    direction = vectors[:, choice].T + deviation
    if normals is not None:
        n = normals[rng.integers(len(normals), size=count)]
        direction -= np.einsum("ci,ci->c", direction, n)[:, None] * n
        some = np.linalg.norm(direction, axis=1) > 0.1
        middle, direction = middle[some], direction[some]
    return middle, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _surface_distances(problem: Problem, middle: Float, direction: Float) -> tuple[Float, Float]:
    """Return the distances (c,) mm to the surface backward and forward."""
    longest = float(np.linalg.norm(np.ptp(problem.surface.bounds, axis=0)))
    back, ahead = (problem.grid.exits(middle, s * direction, longest) for s in (-1, 1))
    return back, ahead


def random_frames(direction: Float, rng: np.random.Generator, normals: Float | None) -> Float:
    """Return axes (c, 3, 3) of planes with x along the directions (c, 3).

    The normal is one of the `normals` perpendicular to x. By default it is random, and for half of
    the planes near a coordinate axis, because symmetric bodies follow these.
    """
    if normals is not None:
        square = np.abs(direction @ normals.T) < 1e-9
        which = (square * rng.random(square.shape)).argmax(axis=1)
        normal = normals[which]
        return np.stack([direction, np.cross(normal, direction), normal], axis=2)
    normal = rng.normal(size=direction.shape)
    square = rng.random(len(direction)) < 0.5
    normal[square] = np.eye(3)[rng.integers(3, size=int(square.sum()))]
    normal += 1e-3 * rng.normal(size=normal.shape)  # never along the direction itself
    normal -= np.einsum("ci,ci->c", normal, direction)[:, None] * direction
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([direction, np.cross(normal, direction), normal], axis=2)


def _body_width(problem: Problem) -> float:
    """Return the middle one of the body's three sizes, mm, which paths may swing across."""
    return float(np.sort(np.ptp(problem.surface.bounds, axis=0))[1])


def template_sensor(knots: int) -> Sensor:
    """Return the sensor whose name and freedom proposed cords have."""
    plane, points = Plane(np.zeros(3), np.eye(3)), np.zeros((knots, 2))
    return Sensor("proposed", plane, Hermite(points, points), frozenset({"path", "plane"}))
