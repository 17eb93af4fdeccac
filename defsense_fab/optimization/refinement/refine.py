"""Find the best layout, starting from drawn cords or none: selection, then descents."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.curve import distinct_planes, sample_path
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...core.progress import Report, subrange
from ..limits.constraints import FLAT_REACH_MM
from ..limits.thin_parts import ThinParts
from ..limits.verification import verify
from ..problem.cord_parameters import round_layout
from ..problem.problem import Problem
from ..search.candidates import Pool
from ..search.exchange import exchanged_layouts
from ..search.starting_layouts import (
    Layout,
    LayoutSearch,
    candidate_choices,
    family_pool,
    no_room_error,
    select_starts,
)
from .descent import MAX_MARGIN_USE_MM, descend, jitter

#: Called with a layout and its expected RMSE, mm.
LayoutCallback = Callable[[Layout, float], None]

_SHORT_ITERATIONS, _LONG_ITERATIONS = 15, 40  # of the first descents, and of the final ones
_MOVED_LIFTS = 2  # copies of a planar layout that start in space from other places
_EXCHANGES = 2  # pools of candidates that replace a cord of the best layout in space
_EXCHANGE_TRIES = 2  # exchanges tried from each pool
_FINISH_ROUNDS = 3  # descents in a row that finish a layout, at most
_MORE_ROUNDS = 3  # for one in space that breaks a limit; its ends move less and less
_SHORT_TOLERANCE, _FINISH_TOLERANCE = 1e-3, 2e-4  # smallest relative gain per iteration
_CONVERGENCE_RTOL = 2e-3  # relative gain of a descent below which a layout is finished


class Cancelled(Exception):
    """Raised by a callback to stop the search; the result is then the best layout so far."""


@dataclass(frozen=True)
class OptimizedLayout:
    """The result of a search.

    Attributes:
        sensors: The best layout that keeps every limit.
        rmse: Its expected RMSE, mm.
        slivers: Whether its planes leave slivers.
        starts: Expected RMSE (mm) after each descent.
        initial: The layout that the search started from: the drawing, or the first selection if
            cords were added.
    """

    sensors: Layout
    rmse: float
    slivers: bool
    starts: tuple[float, ...]
    initial: Layout


def layout_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Return the expected RMSE (mm) of the best decoder for a layout."""
    columns = [problem.signals(sample_path(s)) for s in sensors]
    return float(problem.expected_error(np.stack(columns, axis=1)))


def evaluate_unchanged(problem: Problem, sensors: Layout) -> OptimizedLayout | None:
    """Return the layout as it is with its error, or None if it breaks a limit."""
    if verify(sensors, problem.surface, problem.limits).violations:
        return None
    slivers = ThinParts(problem)(sensors)
    return OptimizedLayout(sensors, layout_error(problem, sensors), slivers, (), sensors)


def require_drawing(problem: Problem, drawn: Layout) -> None:
    """Raise LayoutError if drawn cords break a limit."""
    check = verify(drawn, problem.surface, problem.limits)
    if check.violations:
        broken = check.violations[0]
        cord = next(s for s in drawn if s.name == broken.cords[0])
        repairable = ("path", "plane" if cord.curve.is_planar else "ends")
        action = "Move its control_points or plane"
        if not cord.free.issuperset(repairable):
            action += f", or let a search repair it: free = {list(repairable)}"
        raise LayoutError(
            broken.message,
            code=broken.code,
            where="device.toml: sensors",
            action=action,
            cord=broken.cords[0],
            cords=broken.cords,
            value=broken.value,
        )


def optimize_layout(
    problem: Problem,
    drawn: Sequence[Sensor],
    rng: np.random.Generator,
    report: Report,
    search: LayoutSearch | None = None,
    *,
    watch: LayoutCallback | None = None,
    follow: LayoutCallback | None = None,
) -> OptimizedLayout:
    """Improve the free quantities of drawn cords and add further cords.

    Thousands of candidates for each cord are screened, and several layouts are selected from random
    shares of them. With a limit on planes and no extra cords, randomly moved copies of the drawing
    take their place. All of them and the drawing take a short descent, and the best continue until
    they converge. A search in space continues from the best planar layout and from candidates in
    space. Only layouts that pass
    an independent check compete, and one whose planes leave slivers loses to any that leaves none.
    Cords that are selected in one plane stay in it.

    Args:
        problem: The problem.
        drawn: Cords of the drawing, which must keep the limits. The drawing is the result if
            nothing better is found, except in a search with given normals.
        rng: Random generator.
        report: Called with the share of the work done and a description; may raise Cancelled.
        search: What to look for; by default improvements of the drawing alone.
        watch: Called with each new best layout; may raise Cancelled.
        follow: Called with the layout after each step of a descent, whatever limits it breaks; may
            raise Cancelled.

    Raises:
        LayoutError: If the drawing breaks a limit, or the body has no room for the extra cords.
    """
    drawn, search = tuple(drawn), search or LayoutSearch()
    require_drawing(problem, drawn)
    max_planes = search.planes
    if max_planes is not None:
        max_planes = max(max_planes, len(distinct_planes([s.plane for s in drawn])))
    best = _Best(problem, watch, max_planes)
    initial: Layout = ()
    if not search.extra:
        initial = drawn
        is_fixed = not any(s.free for s in drawn)
        if search.normals is None or is_fixed:
            best.offer(drawn, trusted=True)
        if is_fixed:
            return OptimizedLayout(drawn, *best.rank[::-1], (), drawn)
    errors: list[float] = []
    try:
        show = subrange(report, 0.0, 0.25)
        layouts = _start_layouts(problem, drawn, replace(search, in_space=False), rng, show, best)
        initial = initial or (round_layout(layouts[0]) if layouts else ())
        show = subrange(report, 0.25, 0.5 if search.in_space else 1.0)
        errors.extend(_improve(problem, layouts, search.finalists, best, show, follow))
        if search.in_space and best.layout:
            show = subrange(report, 0.5, 0.6)
            layouts = _start_layouts(problem, drawn, search, rng, show, best)
            layouts = [*_lift(best.layout, rng), *(_in_space(layout) for layout in layouts)]
            show = subrange(report, 0.6, 0.8)
            errors.extend(_improve(problem, layouts, search.finalists, best, show, follow))
            pools = (
                family_pool(problem, search.candidates, rng, search.normals, in_space=True)
                for _ in range(_EXCHANGES)
            )
            show = subrange(report, 0.8, 1.0)
            errors.extend(_exchange(problem, pools, best, show, follow))
        report(1.0, f"best {best.rank[1]:.3g} mm")
    except Cancelled:
        if not best.layout:
            raise
    if not best.layout:
        raise no_room_error(problem, len(drawn) + search.extra, max_planes)
    return OptimizedLayout(best.layout, *best.rank[::-1], tuple(errors), initial or best.layout)


def improve_layout(
    problem: Problem,
    sensors: Layout,
    report: Report,
    *,
    planes: int | None = None,
    watch: LayoutCallback | None = None,
    follow: LayoutCallback | None = None,
) -> OptimizedLayout:
    """Improve a layout from where it is, without candidates.

    Args:
        problem: The problem.
        sensors: The layout, which may break limits.
        report: Called with the share of the work done and a description; may raise Cancelled.
        planes: Largest number of distinct planes; None for no limit.
        watch: Called with each new best layout; may raise Cancelled.
        follow: Called with the layout after each step, whatever limits it breaks; may raise
            Cancelled.

    Returns:
        The layout; its starts are the error of the descent.

    Raises:
        LayoutError: The layout and those near it break a limit.
    """
    best, error = _Best(problem, watch, planes), float("nan")
    unchanged = evaluate_unchanged(problem, sensors)
    if unchanged is not None:
        best.offer(sensors, trusted=True)
    try:
        show = partial(_report_value, report, "descent")
        error = _finish(problem, sensors, best, show, follow)
        report(1.0, f"best {best.rank[1]:.3g} mm")
    except Cancelled:
        if not best.layout:
            raise
    if not best.layout:
        raise no_room_error(problem, len(sensors), planes)
    return OptimizedLayout(best.layout, *best.rank[::-1], (error,), sensors)


def _start_layouts(
    problem: Problem,
    drawn: Layout,
    search: LayoutSearch,
    rng: np.random.Generator,
    report: Report,
    best: _Best,
) -> list[Layout]:
    """Return the layouts that descents start from."""
    if search.planes is not None and not search.extra:  # candidates would lie in other planes
        return [drawn, *(jitter(drawn, rng, tied=True) for _ in range(search.starts - 1))]
    report(0.0, "candidates")
    cords = candidate_choices(problem, drawn, search, rng)
    layouts = select_starts(problem, cords, search, best.slivers, rng, subrange(report, 0.4, 1))
    for layout in layouts:
        best.offer(layout)
    if not search.extra and search.normals is None:
        layouts.append(jitter(drawn, rng, tied=False))
    return layouts


def _lift(layout: Layout, rng: np.random.Generator) -> list[Layout]:
    """Return copies of a layout in space, some moved, as symmetry gives saddle points."""
    lifted = _in_space(layout)
    return [lifted, *(jitter(lifted, rng, tied=False) for _ in range(_MOVED_LIFTS))]


def _in_space(layout: Layout) -> Layout:
    return tuple(s.in_space() for s in layout)


def _improve(
    problem: Problem,
    layouts: Sequence[Layout],
    finalists: int,
    best: _Best,
    report: Report,
    follow: LayoutCallback | None,
) -> Iterator[float]:
    """Descend briefly from all layouts and finish the best; yield the error (mm) of each."""
    short, errors = [], []
    for i, layout in enumerate(layouts):
        low, high = (0.5 * (i + k) / len(layouts) for k in (0, 1))
        description = f"descent {i + 1} of {len(layouts)}"
        show = partial(_report_value, subrange(report, low, high), description)
        short.append(
            descend(
                problem,
                layout,
                _SHORT_ITERATIONS,
                _SHORT_TOLERANCE,
                best.slivers,
                show,
                follow=follow,
            )
        )
        errors.append(layout_error(problem, short[-1]))
        best.offer(short[-1])
        yield errors[-1]
    ranked = sorted(range(len(short)), key=lambda i: (best.slivers(short[i]), errors[i]))
    for n, i in enumerate(_drop_duplicates(ranked, errors)[:finalists]):
        low, high = (0.5 + 0.5 * (n + k) / finalists for k in (0, 1))
        description = f"finishing {n + 1} of {finalists}"
        show = partial(_report_value, subrange(report, low, high), description)
        yield _finish(problem, short[i], best, show, follow)


def _exchange(
    problem: Problem,
    pools: Iterable[Pool],
    best: _Best,
    report: Report,
    follow: LayoutCallback | None,
) -> Iterator[float]:
    """Descend from the best layout with one cord replaced; yield the error (mm) of each.

    A pool is left with the first layout that is better, as the others are next to cords that are
    no longer there.
    """
    for n, pool in enumerate(pools):
        show = partial(
            _report_value, subrange(report, n / _EXCHANGES, (n + 1) / _EXCHANGES), "exchange of one"
        )
        before = best.rank
        trials = exchanged_layouts(problem, best.layout, pool)
        for layout in itertools.islice(trials, _EXCHANGE_TRIES):
            yield _finish(problem, layout, best, show, follow)
            if best.rank < before:
                break


def _drop_duplicates(ranked: Sequence[int], errors: Sequence[float]) -> list[int]:
    """Drop layouts as good as the previous one, since they have converged to the same layout."""
    out = list(ranked[:1])
    for a, b in itertools.pairwise(ranked):
        if abs(errors[b] - errors[a]) > 1e-5 * errors[a]:
            out.append(b)
    return out


def _report_value(report: Report, what: str, done: float, value: float) -> None:
    report(done, f"{what}, {np.sqrt(value):.3g} mm")


class _Best:
    """Keeps the best layout that passes the check; one with slivers only if there is no other."""

    def __init__(self, problem: Problem, watch: LayoutCallback | None, planes: int | None) -> None:
        self._problem, self._watch, self._planes = problem, watch, planes
        self.slivers = ThinParts(problem)
        self.layout: Layout = ()
        self.rank: tuple[bool, float] = (True, np.inf)

    def offer(self, layout: Layout, trusted: bool = False) -> bool:
        """Take a layout if it is the best so far and passes the check.

        Returns whether it would be the best but breaks a limit. A `trusted` layout has passed the
        check and is neither rounded nor checked.
        """
        layout = layout if trusted else round_layout(layout)
        rank = (self.slivers(layout), layout_error(self._problem, layout))
        if rank >= self.rank:
            return False
        if not (trusted or self._passes(layout)):
            return True
        self.layout, self.rank = layout, rank
        if self._watch is not None:
            self._watch(layout, rank[1])
        return False

    def _passes(self, layout: Layout) -> bool:
        if (
            self._planes is not None
            and len(distinct_planes([s.plane for s in layout])) > self._planes
        ):
            return False
        return not verify(layout, self._problem.surface, self._problem.limits).violations


def _finish(
    problem: Problem,
    layout: Layout,
    best: _Best,
    show: Callable[[float, float], None],
    follow: LayoutCallback | None,
) -> float:
    """Repeat descents until the error converges and the check passes; return the error (mm).

    Inlets shift as planes tilt, and only a new descent measures them again.
    """
    error, margin_use = layout_error(problem, layout), MAX_MARGIN_USE_MM
    is_spatial = not all(s.curve.is_planar for s in layout)
    for n in range(_FINISH_ROUNDS + _MORE_ROUNDS * is_spatial):
        layout = descend(
            problem,
            layout,
            _LONG_ITERATIONS,
            _FINISH_TOLERANCE,
            best.slivers,
            show,
            margin_use,
            follow,
            FLAT_REACH_MM / 2 ** max(n - _FINISH_ROUNDS + 1, 0),
        )
        before, error = error, layout_error(problem, layout)
        is_refused = best.offer(layout)
        is_last = n >= _FINISH_ROUNDS - 1 or abs(before - error) < _CONVERGENCE_RTOL * error
        if is_last and not is_refused:
            break
        if is_refused:  # perhaps because of the margin that was used up
            margin_use = 0.0
    return error
