"""Find the best layout, starting from drawn cords or none: selection, then descents."""

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
from ..problem.cord_parameters import change_frame, effective_freedom
from ..problem.problem import Problem
from ..search.starting_layouts import Layout, candidate_choices, no_room_error, select_starts
from .descent import MAX_MARGIN_USE_MM, descend, jitter

#: Decimals of lengths (mm) and of directions to which layouts are rounded: much finer than any
#: printer, and much coarser than differences between processors that find the same layout.
_LENGTH_DECIMALS, _DIRECTION_DECIMALS = 4, 6


def round_layout(layout: Layout) -> Layout:
    """Round the free quantities of a layout; fixed ones stay as they are.

    Cords in one free plane stay in it, in the frame of the first of them.
    """
    out: list[Sensor] = []
    for sensor, lead in zip(layout, _first_in_planes(layout), strict=True):
        free = effective_freedom(sensor, layout)
        if free & PLANE_FREEDOMS and not _is_same_frame(sensor.plane, lead.plane):
            sensor = change_frame(sensor, lead.plane)
        out.append(_round_sensor(sensor, free))
    return tuple(out)


def _first_in_planes(layout: Layout) -> list[Sensor]:
    """Return for each cord the first cord in its plane."""
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
#: Called with a layout and its expected RMSE, mm.
LayoutCallback = Callable[[Layout, float], None]

_SHORT_ITERATIONS, _LONG_ITERATIONS = 15, 40  # of the first descents, and of the final ones
_FINISH_ROUNDS = 3  # descents in a row that finish a layout, at most
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
    """Improve the free quantities of drawn cords and add further cords.

    Thousands of candidates for each cord are screened, and several layouts are selected from random
    shares of them. With a limit on planes and no extra cords, randomly moved copies of the drawing
    take their place. All of them and the drawing take a short descent, and the best continue until
    they converge. Only layouts that pass an independent check compete, and one whose planes leave
    slivers loses to any that leaves none. Cords that are selected in one plane stay in it.

    Args:
        problem: The problem.
        drawn: Cords of the drawing, which must keep the limits. Without `normals`, the drawing is
            the result if nothing better is found.
        rng: Random generator.
        report: Called with the share of the work done and a description; may raise Cancelled.
        extra: Number of cords to add.
        planes: Largest number of distinct planes, or of those drawn if these are more; unlimited by
            default.
        normals: Unit normals (k, 3) of the planes that cords free in path and plane may take.
        starts: Number of layouts to descend from.
        finalists: Number of descents that continue.
        candidates: Number of candidates per cord.
        watch: Called with each new best layout; may raise Cancelled.
        follow: Called with the layout after each step of a descent, whatever limits it breaks; may
            raise Cancelled.

    Raises:
        LayoutError: If the drawing breaks a limit, or the body has no room for the extra cords.
    """
    drawn = tuple(drawn)
    check = verify(drawn, problem.surface, problem.limits)
    if check.violations:
        broken = check.violations[0]
        raise LayoutError(
            broken.message,
            code=broken.code,
            where="device.toml: sensors",
            action="Move its control_points or plane",
            cords=broken.cords,
            value=broken.value,
        )
    max_planes = (
        None if planes is None else max(planes, len(distinct_planes([s.plane for s in drawn])))
    )
    best = _Best(problem, watch, max_planes)
    initial: Layout = ()
    if not extra:
        initial = drawn
        is_fixed = not any(s.free for s in drawn)
        if normals is None or is_fixed:
            best.offer(drawn, trusted=True)
        if is_fixed:
            return OptimizedLayout(drawn, *best.rank[::-1], (), drawn)
    errors: list[float] = []
    try:
        show = partial(report_part, report, 0.0, 0.25)
        layouts = _start_layouts(
            problem, drawn, rng, show, extra, planes, normals, starts, candidates, best
        )
        initial = initial or (round_layout(layouts[0]) if layouts else ())
        show = partial(report_part, report, 0.25, 1.0)
        errors.extend(_improve(problem, layouts, finalists, best, show, follow))
        report(1.0, f"best {best.rank[1]:.3g} mm")
    except Cancelled:
        if not best.layout:
            raise
    if not best.layout:
        raise no_room_error(problem, len(drawn) + extra)
    return OptimizedLayout(best.layout, *best.rank[::-1], tuple(errors), initial or best.layout)


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
    """Return the layouts that descents start from."""
    if planes is not None and not extra:  # candidates would lie in other planes
        return [drawn, *(jitter(drawn, rng, tied=True) for _ in range(starts - 1))]
    report(0.0, "candidates")
    cords = candidate_choices(problem, drawn, extra, candidates, rng, planes, normals)
    layouts = select_starts(
        problem, cords, starts, planes, best.slivers, rng, partial(report_part, report, 0.4, 1)
    )
    for layout in layouts:
        best.offer(layout)
    if not extra and normals is None:
        layouts.append(jitter(drawn, rng, tied=False))
    return layouts


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
        show = partial(_report_value, partial(report_part, report, low, high), description)
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
        show = partial(_report_value, partial(report_part, report, low, high), description)
        yield _finish(problem, short[i], best, show, follow)


def _drop_duplicates(ranked: Sequence[int], errors: Sequence[float]) -> list[int]:
    """Drop layouts as good as the previous one, since they have converged to the same layout."""
    out = list(ranked[:1])
    for a, b in itertools.pairwise(ranked):
        if abs(errors[b] - errors[a]) > 1e-5 * errors[a]:
            out.append(b)
    return out


def report_part(report: Report, low: float, high: float, fraction: float, what: str) -> None:
    """Report the progress of one part of the work.

    Args:
        report: Called with the share of the whole work and the description.
        low: Share of the whole at which the part starts.
        high: Share at which it ends.
        fraction: Share of the part that is done.
        what: Description.
    """
    report(low + (high - low) * fraction, what)


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
    for _ in range(_FINISH_ROUNDS):
        layout = descend(
            problem,
            layout,
            _LONG_ITERATIONS,
            _FINISH_TOLERANCE,
            best.slivers,
            show,
            margin_use,
            follow,
        )
        before, error = error, layout_error(problem, layout)
        is_refused = best.offer(layout)
        if abs(before - error) < _CONVERGENCE_RTOL * error and not is_refused:
            break
        if is_refused:  # perhaps because of the margin that was used up
            margin_use = 0.0
    return error
