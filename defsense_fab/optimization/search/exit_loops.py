"""Generate cords that go out and come back, with both ends in the regions where cords may leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.curve import Plane, catmull_rom
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ..problem.problem import Problem, sample_by_strain, sample_interior
from .candidate_families import (
    LEAD_MM,
    START_DEPTH_MM,
    random_frames,
    template_sensor,
)
from .candidates import CandidateBatch

_SKIN_SAMPLES = 40_000  # of the body, of which those in exits become mouths
_PROBE_MM = 6.0  # inside the body, from where rays back to the skin find the mouths
_MIN_ASIDE_SINE = 0.1  # of the angle of a direction with a given normal
_MIN_STEEPNESS = MAX_INLET_SLOPE * 1.1  # sine of the angle between a leg and the skin
_BEND_SHARE = 0.7  # of the sideways move that a leg's length allows without too tight a bend
_MAX_MOUTHS = 3000  # points of the skin whose normals are found
_DRAWS = 4  # lines drawn for each that is needed, as many are too slanted


def loops_from_exits(
    problem: Problem,
    count: int,
    rng: np.random.Generator,
    normals: Float | None = None,
    plane: Plane | None = None,
) -> CandidateBatch:
    """Generate cords of two legs joined by a half circle, with both mouths in the exits.

    A leg may widen or narrow on its way from the mouth to the half circle, because exits are often
    narrower than the bend of a cord.

    Args:
        problem: The problem, whose limits have exits.
        count: Number of loops; those that fit become candidates.
        rng: Random generator.
        normals: Unit normals (k, 3) of the planes; any direction by default.
        plane: Plane of all loops; any by default.
    """
    lines = _sample_lines(problem, count, rng, normals, plane)
    limits, grid = problem.limits, problem.grid
    longest = 2 * float(np.linalg.norm(np.ptp(problem.surface.bounds, axis=0)))
    start = lines.mouth + _PROBE_MM * lines.direction
    ahead = _PROBE_MM + grid.exits(start, lines.direction, longest)
    lines, ahead = lines.take(np.isfinite(ahead)), ahead[np.isfinite(ahead)]
    # The half circle is placed in the section of the body across the line.
    min_radius = 1.1 * limits.min_radius
    tip = rng.uniform(0.3, 1.0, len(ahead)) * (ahead - limits.depth)
    middle = lines.mouth + (tip - min_radius)[:, None] * lines.direction
    up, down = (grid.exits(middle, s * lines.across, longest) for s in (1, -1))
    widest = (up + down) / 2 - limits.depth
    good = np.isfinite(widest) & (widest >= min_radius) & (tip > min_radius + 2 * LEAD_MM)
    lines, tip, up, down, widest = lines.take(good), *(v[good] for v in (tip, up, down, widest))
    n = len(tip)
    radius = min_radius + rng.uniform(0, 1, n) ** 2 * (widest - min_radius)
    center = tip - radius
    aside = np.clip(
        rng.normal(0, 0.3, n) * widest + rng.choice(2, n) * (up - down) / 2,
        radius + limits.depth - down,
        up - radius - limits.depth,
    )
    narrowest = 0.55 * max(limits.clearance, limits.pocket[1] + limits.wall)
    mouths = np.where(
        rng.random(n) < 0.4, radius, rng.uniform(narrowest, np.maximum(1.5 * radius, narrowest))
    )
    shift = np.where(rng.random(n) < 0.4, aside, rng.normal(0, 0.2, n) * radius)
    # A leg that changes sides by more would bend too tightly.
    largest = _BEND_SHARE * np.maximum(center - LEAD_MM, 0.0) ** 2 / (6 * limits.min_radius)
    mouths = np.clip(mouths, np.maximum(radius - largest / 2, narrowest), radius + largest / 2)
    shift = np.clip(shift, aside - largest / 2, aside + largest / 2)
    starts = []
    for side in (1, -1):
        offset = (shift + side * mouths)[:, None] * lines.across
        probe = lines.mouth + _PROBE_MM * lines.direction + offset
        inside = grid(probe) > limits.depth / 2
        depth = np.full(n, np.inf)
        depth[inside] = grid.exits(probe[inside], -lines.direction[inside], longest)
        starts.append(_PROBE_MM - depth + START_DEPTH_MM)
    good = np.isfinite(starts[0] + starts[1]) & (center > np.maximum(*starts) + 2 * LEAD_MM)
    return _make_loops(
        lines.take(good),
        [s[good] for s in starts],
        [(shift + side * mouths)[good] for side in (1, -1)],
        (center[good], aside[good], radius[good]),
        rng,
    )


@dataclass(frozen=True)
class _Lines:
    """Lines from the skin into the body.

    Attributes:
        mouth: (c, 3) mm, points of the skin in the exits.
        direction: (c, 3), unit directions into the body.
        axes: (c, 3, 3), axes of the planes, whose x is the direction.
    """

    mouth: Float
    direction: Float
    axes: Float

    @property
    def across(self) -> Float:
        return self.axes[:, :, 1]

    def take(self, which: Bool) -> _Lines:
        return _Lines(self.mouth[which], self.direction[which], self.axes[which])


def _sample_lines(
    problem: Problem,
    count: int,
    rng: np.random.Generator,
    normals: Float | None,
    plane: Plane | None,
) -> _Lines:
    """Draw lines from points of the exits to points inside, half of them where strain varies."""
    skin = problem.surface.scatter(_SKIN_SAMPLES, rng)
    skin = skin[np.any([shape.contains(skin) for shape in problem.limits.exits], axis=0)]
    inside = sample_interior(problem, 4000, rng)
    inside = inside[problem.grid(inside) > problem.limits.depth]
    if plane is not None:
        inside = inside - _height(inside, plane)[:, None] * plane.normal
        inside = inside[problem.grid(inside) > problem.limits.depth]
        near = np.abs(_height(skin, plane)) < problem.limits.clearance
        skin = skin[near] - _height(skin[near], plane)[:, None] * plane.normal
    if not (len(skin) and len(inside)):
        return _Lines(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    skin = skin[:_MAX_MOUTHS]
    inward = -problem.surface.normals[problem.depth.closest(skin)[1]]
    draws = _DRAWS * count
    target = np.concatenate(
        [
            inside[rng.integers(len(inside), size=draws // 2)],
            sample_by_strain(problem, inside[:2000], draws - draws // 2, rng),
        ]
    )[rng.permutation(draws)]
    which = rng.integers(len(skin), size=draws)
    mouth, direction = skin[which], target - skin[which]
    if normals is not None:
        normal = normals[rng.integers(len(normals), size=draws)]
        direction -= np.einsum("ci,ci->c", direction, normal)[:, None] * normal
    length = np.linalg.norm(direction, axis=1)
    steep = np.einsum("ci,ci->c", direction, inward[which]) > _MIN_STEEPNESS * length
    good = np.flatnonzero(steep & (length > max(LEAD_MM, _MIN_ASIDE_SINE * float(length.max()))))[
        :count
    ]
    mouth, direction = mouth[good], direction[good] / length[good, None]
    if plane is None:
        return _Lines(mouth, direction, random_frames(direction, rng, normals))
    normal = np.broadcast_to(plane.normal, direction.shape)
    return _Lines(
        mouth, direction, np.stack([direction, np.cross(normal, direction), normal], axis=2)
    )


def _height(points: Float, plane: Plane) -> Float:
    return np.asarray((points - plane.origin) @ plane.normal)


def _make_loops(
    lines: _Lines,
    starts: list[Float],
    sides: list[Float],
    arc: tuple[Float, Float, Float],
    rng: np.random.Generator,
) -> CandidateBatch:
    """Return loops in frames at the mouths, whose x axes lead into the body.

    Args:
        lines: The lines.
        starts: Starts (c,) of both legs along x, mm.
        sides: Their places (c,) across, mm.
        arc: Center (c,) of the half circles along x and across, and their radii (c,), mm.
        rng: Random generator.
    """
    center, aside, radius = arc
    x, y = [], []
    for start, side, sign in zip(starts, sides, (1, -1), strict=True):
        lead, end = start + LEAD_MM, aside + sign * radius
        x.append([start, lead, (lead + center) / 2, center])
        size = np.minimum(0.2 * radius, _BEND_SHARE * (center - lead) ** 2 / (24 * radius))
        bulge = rng.normal(0, 1, len(center)) * size
        y.append([side, side, (side + end) / 2 + bulge, end])
    points = np.stack(
        [
            np.stack([*x[0], center + radius, *x[1][::-1]], axis=1),
            np.stack([*y[0], aside, *y[1][::-1]], axis=1),
        ],
        axis=2,
    )
    tangents = catmull_rom(points)
    straight = np.stack([np.full(len(center), LEAD_MM), np.zeros(len(center))], axis=1)
    tangents[:, 0], tangents[:, -1] = straight, -straight
    size = 4 * (np.sqrt(2) - 1) * radius  # of a cubic that follows a quarter circle
    half, zero = len(x[0]), np.zeros(len(center))
    for at, along in ((half - 1, [size, zero]), (half, [zero, -size]), (half + 1, [-size, zero])):
        tangents[:, at] = np.stack(along, axis=1)
    return CandidateBatch(
        template_sensor(points.shape[1]), lines.mouth, lines.axes, points, tangents
    )
