"""From the paths as drawn to the best layout found: seeds, then constrained descent (SLSQP)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ..core.arrays import Float
from ..core.curve import distinct
from ..core.device import Sensor
from ..core.errors import LayoutError
from ..geometry import facets
from .candidates import Pool, build_pool, propose, vary
from .constraints import Constraints
from .freedom import CordFreedom, per_span
from .objective import Objective
from .problem import Problem, expected_error
from .select import select
from .verify import verify

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Optimised:
    """The best layout that keeps every limit, its expected RMSE, and those of all starts (mm)."""

    sensors: tuple[Sensor, ...]
    rmse: float
    starts: tuple[float, ...]


def layout_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Expected RMSE (mm) of the best affine map for these cords."""
    columns = [problem.signals(sample_path(s)) for s in sensors]
    return expected_error(np.stack(columns, axis=1), problem.outputs(), problem.ridge)


def sample_path(sensor: Sensor) -> Float:
    """The path's points (p, 3) in the rest frame, p > 100."""
    return sensor.plane.to_world(sensor.curve.sample(per_span(sensor)))


def optimise(
    problem: Problem,
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    report: Report,
    *,
    starts: int = 4,
    candidates: int = 4000,
    iterations: int = 60,
) -> Optimised:
    """Improve the cords that are free, from selected variations and the drawing itself.

    Every start ends in an independent check; only layouts that pass compete, and one whose
    planes leave slivers of parts loses to any that leave none. The drawing, which must pass
    itself, is the result where nothing better was found.
    """
    drawn = tuple(sensors)
    best, best_error = drawn, layout_error(problem, drawn)
    reached: list[float] = []
    slivers = Slivers(problem)
    rank = (slivers(drawn), best_error)
    if not any(s.free for s in drawn):
        return Optimised(best, best_error, ())
    size = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[1])
    each = max(candidates // sum(bool(s.free) for s in drawn), 1)
    for start in range(starts):
        report(start / starts, f"start {start + 1} of {starts}, best {best_error:.3g} mm")
        pools = [build_pool(problem, vary(s, each, size / 2, rng)) for s in drawn]
        picked = _pick(problem, pools)
        seeds = [picked] if picked else []
        if start == 0:
            seeds.append([_jitter(s, rng) for s in drawn])
        for seed in seeds:

            def show(value: float, at: int = start) -> None:
                report(at / starts, f"start {at + 1} of {starts}, {np.sqrt(value):.3g} mm")

            for layout in (_polish(problem, seed, iterations, show), tuple(seed)):
                if verify(layout, problem.surface, problem.limits).problems:
                    continue
                error = layout_error(problem, layout)
                reached.append(error)
                if error >= best_error and not rank[0]:
                    break
                new = (slivers(layout), error)
                if new < rank:
                    best, best_error, rank = tuple(layout), error, new
                if not new[0]:
                    break
    report(1.0, f"best {best_error:.3g} mm")
    return Optimised(best, best_error, tuple(reached))


class Slivers:
    """Whether the planes of a layout cut off parts too small to print."""

    def __init__(self, problem: Problem) -> None:
        self._body = facets.to_manifold(problem.surface, "the body")
        self._least = problem.limits.smallest_part * self._body.volume()

    def __call__(self, sensors: Sequence[Sensor]) -> bool:
        parts, _ = facets.carve_and_split(self._body, [], distinct([s.plane for s in sensors]))
        return any(p.volume() < self._least for p in parts)


def first_layout(
    problem: Problem, count: int, rng: np.random.Generator, lines: int = 400, variations: int = 5
) -> tuple[Sensor, ...]:
    """A proposal of `count` cords where the user has drawn none, all free in path and plane.

    Raises LayoutError where the body has no room for them.
    """
    width = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[0])
    for _ in range(5):  # candidates are checked coarsely: a pick can still fail the fine check
        many = [
            v
            for s in propose(problem.surface, lines, rng)
            for v in vary(replace(s, free=frozenset({"path"})), variations, width / 3, rng)
        ]
        pool = build_pool(problem, many, keep_first=False) if many else None
        picked = _pick(problem, [pool] * count) if pool and pool.sensors else None
        if picked and not verify(picked, problem.surface, problem.limits).problems:
            return tuple(
                replace(s, name=f"cord-{i + 1}", free=frozenset({"path", "plane"}))
                for i, s in enumerate(picked)
            )
    raise LayoutError(
        f"[design] sensors = {count}: no room was found for {count} cords; ask for fewer, or draw"
        " them as [[sensors]]"
    )


def _pick(problem: Problem, pools: Sequence[Pool]) -> list[Sensor] | None:
    clearance = problem.limits.clearance + 0.1
    chosen = select(pools, problem.outputs(), problem.ridge, clearance)
    if chosen is None:
        return None
    return [p.sensors[i] for p, i in zip(pools, chosen, strict=True)]


def _jitter(sensor: Sensor, rng: np.random.Generator) -> Sensor:
    """A slight push off the drawing: symmetric drawings are saddle points."""
    freedom = CordFreedom(sensor)
    return freedom.apply(rng.normal(0, 1.5, freedom.size))


def _polish(
    problem: Problem,
    sensors: Sequence[Sensor],
    iterations: int,
    show: Callable[[float], None],
    rounds: int = 3,
) -> tuple[Sensor, ...]:
    """Descents in a row: inlets shift as planes tilt, and only a new start measures them anew."""
    layout, error = tuple(sensors), np.inf
    for _ in range(rounds):
        layout = _descend(problem, layout, iterations, show)
        before, error = error, layout_error(problem, layout)
        good = not verify(layout, problem.surface, problem.limits).problems
        if good and error > 0.97 * before:
            break
    return layout


def _descend(
    problem: Problem,
    sensors: Sequence[Sensor],
    iterations: int,
    show: Callable[[float], None],
) -> tuple[Sensor, ...]:
    cords = [CordFreedom(s) for s in sensors]
    objective = Objective(problem, cords)
    constraints = Constraints(problem.surface, problem.limits, cords)
    scale = objective(np.zeros(sum(c.size for c in cords)))[0]
    last: dict[bytes, tuple[Float, Float]] = {}

    def constrained(x: Float, which: int) -> Float:
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = constraints(x)
        return last[key][which]

    def scaled(x: Float) -> tuple[float, Float]:
        value, gradient = objective(x)
        return value / scale, gradient / scale

    result = minimize(
        scaled,
        np.zeros(sum(c.size for c in cords)),
        jac=True,
        method="SLSQP",
        constraints={
            "type": "ineq",
            "fun": lambda x: constrained(x, 0),
            "jac": lambda x: constrained(x, 1),
        },
        callback=lambda x: show(objective(x)[0]),
        options={"maxiter": iterations, "ftol": 1e-6},
    )
    return tuple(c.apply(x) for c, x in zip(cords, objective.split(result.x), strict=True))
