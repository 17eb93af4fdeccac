"""From the paths as drawn, or none, to the best layout found: selection, then descents."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, distinct_planes, sample_path
from ...core.device.device import PLANE_FREEDOMS, Sensor
from ...core.errors import LayoutError
from ..limits.thin_parts import ThinParts
from ..limits.verification import verify
from ..problem.cord_parameters import effective_freedom, change_frame
from ..problem.problem import Problem
from ..search.starting_layouts import Layout, candidate_choices, no_room_error, select_starts
from .descent import MAX_MARGIN_USE_MM, descend, jitter

# Layouts to the digits that they are told to: processors differ in those behind them.

#: Decimals of lengths in mm, and of directions: far finer than any printer, far coarser than what
#: is left of rounding where a search has come to the same layout.
_LENGTH_DECIMALS, _DIRECTION_DECIMALS = 4, 6


def round_layout(layout: Layout) -> Layout:
    """The layout with what is free of each cord rounded; what was given stays where it is, and
    cords in one plane that is free stay in it, in the frame of the first of them."""
    out: list[Sensor] = []
    for sensor, lead in zip(layout, _first_in_planes(layout), strict=True):
        free = effective_freedom(sensor, layout)
        if free & PLANE_FREEDOMS and not _is_same_frame(sensor.plane, lead.plane):
            sensor = change_frame(sensor, lead.plane)
        out.append(_round_sensor(sensor, free))
    return tuple(out)


def _first_in_planes(layout: Layout) -> list[Sensor]:
    """Of each cord the first one in its plane."""
    return [next(s for s in layout if s.plane.coincides(sensor.plane)) for sensor in layout]


def _is_same_frame(a: Plane, b: Plane) -> bool:
    return np.array_equal(a.origin, b.origin) and np.array_equal(a.axes, b.axes)


def _round_sensor(sensor: Sensor, free: frozenset[str]) -> Sensor:
    curve, plane = sensor.curve, sensor.plane
    if "path" in free:
        curve = Hermite(
            _round_values(curve.points, _LENGTH_DECIMALS),
            _round_values(curve.tangents, _LENGTH_DECIMALS),
        )
    origin = _round_values(plane.origin, _LENGTH_DECIMALS)
    if "plane" in free:
        normal, x_axis = (
            _round_values(v, _DIRECTION_DECIMALS) for v in (plane.normal, plane.axes[:, 0])
        )
        plane = Plane.from_normal(origin, normal, x_axis)
    elif "offset" in free:
        plane = Plane(origin, plane.axes)
    return replace(sensor, curve=curve, plane=plane)


def _round_values(values: Float, decimals: int) -> Float:
    return np.round(values, decimals) + 0.0  # no negative zeros


Report = Callable[[float, str], None]
#: Gets a layout and its expected RMSE, mm: the best so far, or what a descent has come to.
LayoutCallback = Callable[[Layout, float], None]

_SHORT_ITERATIONS, _LONG_ITERATIONS, _FINISH_ROUNDS = (
    15,
    40,
    3,
)  # iterations of a descent; descents of a finish
_SHORT_TOLERANCE, _FINISH_TOLERANCE = 1e-3, 2e-4  # relative gain that a descent still goes on for
_CONVERGENCE_RTOL = 2e-3  # relative gain of a descent that ends a finish


class Cancelled(Exception):
    """Raised by a callback to stop the search: the best layout so far is the result."""


@dataclass(frozen=True)
class OptimizedLayout:
    """The best layout that keeps every limit, its expected RMSE (mm), whether its planes leave
    slivers, the RMSE of all descents, and what the search set out from: the drawing, or the first
    selection where cords were added."""

    sensors: Layout
    rmse: float
    slivers: bool
    starts: tuple[float, ...]
    initial: Layout


def layout_error(problem: Problem, sensors: Sequence[Sensor]) -> float:
    """Expected RMSE (mm) of the best decoder for these cords."""
    columns = [problem.signals(sample_path(s)) for s in sensors]
    return float(problem.expected_error(np.stack(columns, axis=1)))


def evaluate_unchanged(problem: Problem, sensors: Layout) -> OptimizedLayout | None:
    """The layout as it is, or None where it breaks a limit."""
    if verify(sensors, problem.surface, problem.limits).problems:
        return None
    slivers = ThinParts(problem)(sensors)
    return OptimizedLayout(sensors, layout_error(problem, sensors), slivers, (), sensors)


def optimize_layout(
    problem: Problem,
    drawn: Sequence[Sensor],
    rng: np.random.Generator,
    report: Report,
    *,
    extra: int = 0,
    planes: int | None = None,
    normals: Float | None = None,
    starts: int = 6,
    finalists: int = 2,
    candidates: int = 12000,
    watch: LayoutCallback | None = None,
    follow: LayoutCallback | None = None,
) -> OptimizedLayout:
    """Improve the drawn cords that are free, and add `extra` ones, in at most `planes` planes if
    given (or as many as are drawn), and those free in path and plane in planes square to one of the
    unit `normals` (k, 3) if given. Cords that are selected in one plane stay in it.

    Thousands of candidates for each cord are screened, and `starts` layouts selected from shares
    of them; with a limit on planes and no extra cords, pushed copies of the drawing take their
    place. All these and the drawing itself take a short descent, and the best `finalists` go on
    until they stand still. Only layouts that pass an independent check compete, and one
    whose planes leave slivers loses to any that leave none. A drawing, which must pass itself, is
    the result where nothing better was found, unless there are `normals`. `watch` gets each layout
    that is the best so far, and `follow` where each step of a descent has come to, whatever limits
    that breaks. `report`, `watch` and `follow` may raise Cancelled.

    Raises LayoutError where the drawing breaks a limit, and where there is no room for more cords.
    """
    drawn = tuple(drawn)
    check = verify(drawn, problem.surface, problem.limits)
    if check.problems:
        broken = check.problems[0]
        raise LayoutError(
            broken.message,
            code=broken.code,
            where="device.toml: sensors",
            action="Move its control_points or plane",
            cords=broken.cords,
            value=broken.value,
        )
    most = None if planes is None else max(planes, len(distinct_planes([s.plane for s in drawn])))
    best = _Best(problem, watch, most)
    initial: Layout = ()
    if not extra:
        initial = drawn
        settled = not any(s.free for s in drawn)
        if normals is None or settled:
            best.offer(drawn, trusted=True)
        if settled:
            return OptimizedLayout(drawn, *best.rank[::-1], (), drawn)
    reached: list[float] = []
    try:
        show = partial(report_part, report, 0.0, 0.25)
        begun = _start_layouts(
            problem, drawn, rng, show, extra, planes, normals, starts, candidates, best
        )
        initial = initial or (round_layout(begun[0]) if begun else ())
        show = partial(report_part, report, 0.25, 1.0)
        reached.extend(_improve(problem, begun, finalists, best, show, follow))
        report(1.0, f"best {best.rank[1]:.3g} mm")
    except Cancelled:
        if not best.layout:
            raise
    if not best.layout:
        raise no_room_error(problem, len(drawn) + extra)
    return OptimizedLayout(best.layout, *best.rank[::-1], tuple(reached), initial or best.layout)


def _start_layouts(
    problem: Problem,
    drawn: Layout,
    rng: np.random.Generator,
    report: Report,
    extra: int,
    planes: int | None,
    normals: Float | None,
    starts: int,
    candidates: int,
    best: _Best,
) -> list[Layout]:
    """The layouts that descents set out from."""
    if planes is not None and not extra:  # the planes are few already; candidates lie in others
        return [drawn, *(jitter(drawn, rng, tied=True) for _ in range(starts - 1))]
    report(0.0, "candidates")
    cords = candidate_choices(problem, drawn, extra, candidates, rng, planes, normals)
    begun = select_starts(
        problem, cords, starts, planes, best.slivers, rng, partial(report_part, report, 0.4, 1)
    )
    for layout in begun:
        best.offer(layout)
    if not extra and normals is None:
        begun.append(jitter(drawn, rng, tied=False))
    return begun


def _improve(
    problem: Problem,
    begun: Sequence[Layout],
    finalists: int,
    best: _Best,
    report: Report,
    follow: LayoutCallback | None,
) -> Iterator[float]:
    """Short descents of all and finishes of the best, and the error (mm) that each comes to."""
    short, reached = [], []
    for i, layout in enumerate(begun):
        low, high = (0.5 * (i + k) / len(begun) for k in (0, 1))
        what = f"descent {i + 1} of {len(begun)}"
        show = partial(_report_value, partial(report_part, report, low, high), what)
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
        reached.append(layout_error(problem, short[-1]))
        best.offer(short[-1])
        yield reached[-1]
    ranked = sorted(range(len(short)), key=lambda i: (best.slivers(short[i]), reached[i]))
    for n, i in enumerate(_drop_duplicates(ranked, reached)[:finalists]):
        low, high = (0.5 + 0.5 * (n + k) / finalists for k in (0, 1))
        what = f"finishing {n + 1} of {finalists}"
        show = partial(_report_value, partial(report_part, report, low, high), what)
        yield _finish(problem, short[i], best, show, follow)


def _drop_duplicates(ranked: Sequence[int], errors: Sequence[float]) -> list[int]:
    """Without those that are as good as the one before: they have come to the same layout."""
    out = list(ranked[:1])
    for a, b in itertools.pairwise(ranked):
        if abs(errors[b] - errors[a]) > 1e-5 * errors[a]:
            out.append(b)
    return out


def report_part(report: Report, low: float, high: float, fraction: float, what: str) -> None:
    """Report a fraction of a part of the whole."""
    report(low + (high - low) * fraction, what)


def _report_value(report: Report, what: str, done: float, value: float) -> None:
    report(done, f"{what}, {np.sqrt(value):.3g} mm")


class _Best:
    """The best layout offered that passes; one with slivers only for want of others."""

    def __init__(self, problem: Problem, watch: LayoutCallback | None, planes: int | None) -> None:
        self._problem, self._watch, self._planes = problem, watch, planes
        self.slivers = ThinParts(problem)
        self.layout: Layout = ()
        self.rank: tuple[bool, float] = (True, np.inf)

    def offer(self, layout: Layout, trusted: bool = False) -> bool:
        """Take the layout if it is the best now, and tell whether it would be but for a limit that
        it breaks; `trusted` ones are known to pass the check, and stay as they are."""
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
        if self._planes is not None and len(distinct_planes([s.plane for s in layout])) > self._planes:
            return False
        return not verify(layout, self._problem.surface, self._problem.limits).problems


def _finish(
    problem: Problem,
    layout: Layout,
    best: _Best,
    show: Callable[[float, float], None],
    follow: LayoutCallback | None,
) -> float:
    """Error (mm) after descents in a row, until it stands still and the check passes.

    Inlets shift as planes tilt, and only a new descent measures them anew.
    """
    error, forgiven = layout_error(problem, layout), MAX_MARGIN_USE_MM
    for _ in range(_FINISH_ROUNDS):
        layout = descend(
            problem,
            layout,
            _LONG_ITERATIONS,
            _FINISH_TOLERANCE,
            best.slivers,
            show,
            forgiven,
            follow,
        )
        before, error = error, layout_error(problem, layout)
        refused = best.offer(layout)
        if abs(before - error) < _CONVERGENCE_RTOL * error and not refused:
            break
        if refused:  # by what was forgiven, perhaps
            forgiven = 0.0
    return error
