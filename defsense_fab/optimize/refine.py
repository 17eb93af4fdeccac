"""From the paths as drawn to the best layout found: seeds, then constrained descent (SLSQP)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

from ..core.arrays import Float
from ..core.device import Sensor
from ..core.errors import LayoutError
from ..geometry import facets
from ..geometry.division import channel_line, divide
from .candidates import Pool, build_pool, join, propose, vary
from .constraints import Constraints
from .freedom import CordFreedom, sample_path
from .objective import Objective
from .problem import Problem
from .select import select
from .verify import LONGEST_INLET, verify

Report = Callable[[float, str], None]
Layout = tuple[Sensor, ...]


@dataclass(frozen=True)
class Optimised:
    """The best layout that keeps every limit, its expected RMSE, and those of all descents (mm)."""

    sensors: tuple[Sensor, ...]
    rmse: float
    starts: tuple[float, ...]


def layout_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Expected RMSE (mm) of the best decoder for these cords."""
    columns = [problem.signals(sample_path(s)) for s in sensors]
    return float(problem.expected_error(np.stack(columns, axis=1)))


def optimise(
    problem: Problem,
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    report: Report,
    *,
    starts: int | None = None,
    finalists: int = 4,
    candidates: int = 12000,
    iterations: int = 60,
) -> Optimised:
    """Improve the cords that are free, from selected variations and the drawing itself.

    Every start takes a short descent; the best `finalists` go on until they converge. Only
    layouts that pass an independent check compete, and one whose planes leave slivers of parts
    loses to any that leave none. The drawing, which must pass itself, is the result where
    nothing better was found. `starts` is 48 over the number of free cords unless given.
    """
    drawn = tuple(sensors)
    slivers = Slivers(problem)

    def ranked(layouts: Sequence[Layout]) -> Iterator[Layout]:
        """By error, those that leave slivers last; lazy, since slivers take time to find."""
        late = []
        for layout in sorted(layouts, key=lambda x: layout_error(problem, x)):
            if slivers(layout):
                late.append(layout)
            else:
                yield layout
        yield from late

    if not any(s.free for s in drawn):
        return Optimised(drawn, layout_error(problem, drawn), ())
    size = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[1])
    free = sum(bool(s.free) for s in drawn)
    each, starts = max(candidates // free, 1), starts or max(48 // free, 8)
    pools = []
    for i, s in enumerate(drawn):
        report(0.25 * i / len(drawn), f"candidates for cord {s.name!r}")
        pools.append(build_pool(problem, vary(s, each, size / 2, rng)))
    seeds: list[Layout] = [tuple(_jitter(s, rng) for s in drawn)]
    for _ in range(starts):
        picked = _pick(problem, [p.some(0.1, rng) for p in pools])  # small shares differ
        seeds += [picked] if picked else []
    short: list[Layout] = []
    for i, seed in enumerate(seeds):
        at = 0.25 + 0.35 * i / len(seeds)
        show = partial(_show, report, at, f"descent {i + 1} of {len(seeds)}")
        short.append(_descend(problem, seed, iterations, show))
    long: list[Layout] = []
    for n, layout in enumerate(itertools.islice(ranked(short), finalists)):
        at = 0.6 + 0.4 * n / finalists
        show = partial(_show, report, at, f"finishing {n + 1} of {finalists}")
        long.append(_finish(problem, layout, show))
    best = next(
        layout
        for layout in ranked([drawn, *seeds[1:], *short, *long])
        if layout is drawn or not verify(layout, problem.surface, problem.limits).problems
    )
    reached = [layout_error(problem, layout) for layout in (*short, *long)]
    report(1.0, f"best {layout_error(problem, best):.3g} mm")
    return Optimised(best, layout_error(problem, best), tuple(reached))


def _show(report: Report, at: float, what: str, error: float) -> None:
    report(at, f"{what}, {error:.3g} mm")


class Slivers:
    """Whether a layout cuts off parts that are too small or too thin to print."""

    def __init__(self, problem: Problem) -> None:
        self._body = facets.to_manifold(problem.surface, "the body")
        self._limits = problem.limits

    def __call__(self, sensors: Sequence[Sensor]) -> bool:
        ends = (LONGEST_INLET, LONGEST_INLET)  # surely out of the body
        cords = [(s.plane, channel_line(s, ends)) for s in sensors]
        division = divide(self._body, cords, self._limits.channel_diameter)
        least = self._limits.smallest_part * self._body.volume()
        return any(
            p.volume() < least or facets.thickness(p) < self._limits.wall for p in division.parts
        )


def first_layout(
    problem: Problem, count: int, rng: np.random.Generator, lines: int = 400, variations: int = 5
) -> tuple[Sensor, ...]:
    """A proposal of `count` cords where the user has drawn none, all free in path and plane.

    Raises LayoutError where the body has no room for them.
    """
    width = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[0])
    for _ in range(5):  # candidates are checked coarsely: a pick can still fail the fine check
        many = [
            vary(replace(s, free=frozenset({"path"})), variations, width / 2, rng)
            for s in propose(problem.surface, lines, rng)
        ]
        pool = build_pool(problem, join(many), keep_first=False) if many else None
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


def _pick(problem: Problem, pools: Sequence[Pool]) -> Layout | None:
    clearance = problem.limits.clearance + 0.1
    chosen = select(pools, problem.expected_error, clearance)
    if chosen is None:
        return None
    return tuple(p.sensors[i] for p, i in zip(pools, chosen, strict=True))


def _jitter(sensor: Sensor, rng: np.random.Generator) -> Sensor:
    """A slight push off the drawing: symmetric drawings are saddle points."""
    freedom = CordFreedom(sensor)
    return freedom.apply(rng.normal(0, 1.5, freedom.size))


def _finish(
    problem: Problem, layout: Layout, show: Callable[[float], None], rounds: int = 6
) -> Layout:
    """Descents in a row until the error stands still and the check passes.

    Inlets shift as planes tilt, and only a new start measures them anew.
    """
    error = layout_error(problem, layout)
    for _ in range(rounds):
        layout = _descend(problem, layout, 150, show)
        before, error = error, layout_error(problem, layout)
        good = not verify(layout, problem.surface, problem.limits).problems
        if good and abs(before - error) < 2e-3 * error:
            break
    return layout


def _descend(
    problem: Problem, sensors: Layout, iterations: int, show: Callable[[float], None]
) -> Layout:
    cords = [CordFreedom(s) for s in sensors]
    objective = Objective(problem, cords)
    constraints = Constraints(problem.surface, problem.limits, cords)
    scale = objective(np.zeros(sum(c.size for c in cords)))[0]
    last: dict[bytes, tuple[Float, Float]] = {}
    value = np.inf

    def constrained(x: Float, which: int) -> Float:
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = constraints(x)
        return last[key][which]

    def scaled(x: Float) -> tuple[float, Float]:
        nonlocal value
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
        callback=lambda _: show(float(np.sqrt(value))),
        options={"maxiter": iterations, "ftol": 1e-6},
    )
    return tuple(c.apply(x) for c, x in zip(cords, objective.split(result.x), strict=True))
