"""How the error falls with the number of cords, and where more of them stop paying."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from ...core.arrays import Float
from ...core.curve import distinct_planes
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ..limits.thin_parts import ThinParts
from ..problem.problem import Problem
from ..refinement.refine import OptimizedLayout, layout_error, optimize_layout, report_part
from ..search.starting_layouts import FREE, Layout, no_room_error

_STARTS = 6  # of one cord; fewer the more cords there are, which take longer


def add_cord(
    problem: Problem,
    layout: Sequence[Sensor],
    rng: np.random.Generator,
    report: Callable[[float, str], None],
    planes: int | None = None,
) -> Layout:
    """The layout with one cord more where it helps most; the others stay. At most `planes` planes.

    Raises LayoutError where there is no room for it.
    """
    locked = [replace(s, free=frozenset()) for s in layout]
    found: list[OptimizedLayout] = []
    # In one of the planes that are there, and in one of its own where that is allowed.
    room = planes is None or planes > len(distinct_planes([s.plane for s in locked]))
    kinds = (0, planes) if room else (0,)
    for n, most in enumerate(kinds):
        show = partial(report_part, report, n / len(kinds), (n + 1) / len(kinds))
        with suppress(LayoutError):
            found.append(
                optimize_layout(
                    problem, locked, rng, show, extra=1, planes=most, starts=3, finalists=1
                )
            )
    if not found:
        raise no_room_error(problem, len(layout) + 1)
    best = min(found, key=lambda f: (f.slivers, f.rmse))
    return (*layout, *best.sensors[len(locked) :])


def layouts_by_count(
    problem: Problem,
    counts: Sequence[int],
    seed: int,
    report: Callable[[float, str], None],
    *,
    begin: Layout = (),
    planes: int | None = None,
) -> Iterator[tuple[int, Layout]]:
    """The best layouts of up to so many cords, for rising numbers: the error never rises.

    Every number is searched for afresh and from the layout before with one cord more; where
    neither is better, or better only with slivers, that layout stands again. `begin` is the layout
    of the number before the first, where it is known; `planes` is the most planes.

    Raises LayoutError where the body has no room for more.
    """
    before, slivers = begin, ThinParts(problem)
    for n, count in enumerate(counts):
        rng = np.random.default_rng((seed, count))  # the same wherever the study began
        low, high = n / len(counts), (n + 1) / len(counts)
        middle = (low + high) / 2
        fresh, grown = (
            partial(report_part, report, low, middle),
            partial(report_part, report, middle, high),
        )
        starts = max(_STARTS - count // 2, 2)
        found: list[OptimizedLayout] = []
        with suppress(LayoutError):
            found.append(
                optimize_layout(problem, (), rng, fresh, extra=count, planes=planes, starts=starts)
            )
        if before:
            with suppress(LayoutError):
                found.append(_grow(problem, before, rng, grown, planes, starts // 2))
        if not found:
            raise no_room_error(problem, count)
        best = min(found, key=lambda f: (f.slivers, f.rmse))
        clean = not best.slivers or (bool(before) and slivers(before))
        if not before or (clean and best.rmse < layout_error(problem, before)):
            before = best.sensors
        yield count, before


def _grow(
    problem: Problem,
    before: Layout,
    rng: np.random.Generator,
    report: Callable[[float, str], None],
    planes: int | None,
    starts: int,
) -> OptimizedLayout:
    layout = add_cord(problem, before, rng, partial(report_part, report, 0.0, 0.5), planes)
    free = [replace(s, free=FREE) for s in layout]
    show = partial(report_part, report, 0.5, 1.0)
    return optimize_layout(problem, free, rng, show, planes=planes, starts=starts)


def find_knee(counts: Sequence[int], errors: Float) -> int:
    """The number of cords beyond which more pay least: where the curve of the errors' logarithms
    lies deepest below the line between its ends (Satopaa et al. 2011)."""
    if len(counts) < 3:
        return int(counts[int(np.argmin(errors))])
    x = np.asarray(counts, float)
    y = np.log(np.asarray(errors, float))
    line = y[0] + (y[-1] - y[0]) * (x - x[0]) / (x[-1] - x[0])
    return int(counts[int((line - y).argmax())])
