"""Find layouts of increasing numbers of cords, and the number beyond which more pay little."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import distinct_planes
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...core.progress import Report, subrange
from ..limits.thin_parts import ThinParts
from ..problem.problem import Problem
from ..refinement.refine import OptimizedLayout, layout_error, optimize_layout
from ..search.starting_layouts import FREE, Layout, LayoutSearch, no_room_error

_STARTS = 6  # for one cord; fewer for more cords, which take longer


def add_cord(
    problem: Problem,
    layout: Sequence[Sensor],
    rng: np.random.Generator,
    report: Report,
    planes: int | None = None,
) -> Layout:
    """Add the cord that helps most to a layout whose other cords stay.

    Args:
        problem: The problem.
        layout: The cords that stay.
        rng: Random generator.
        report: Called with the share of the work done and a description.
        planes: Largest number of distinct planes; unlimited by default.

    Raises:
        LayoutError: If the body has no room for another cord.
    """
    locked = [replace(s, free=frozenset()) for s in layout]
    layouts: list[OptimizedLayout] = []
    # In one of the present planes, and in a new one if that is allowed.
    may_add_plane = planes is None or planes > len(distinct_planes([s.plane for s in locked]))
    plane_limits = (0, planes) if may_add_plane else (0,)
    for n, limit in enumerate(plane_limits):
        show = subrange(report, n / len(plane_limits), (n + 1) / len(plane_limits))
        with suppress(LayoutError):
            layouts.append(
                optimize_layout(
                    problem,
                    locked,
                    rng,
                    show,
                    LayoutSearch(extra=1, planes=limit, starts=3, finalists=1),
                )
            )
    if not layouts:
        raise no_room_error(problem, len(layout) + 1)
    best = min(layouts, key=lambda f: (f.slivers, f.rmse))
    return (*layout, *best.sensors[len(locked) :])


def layouts_by_count(
    problem: Problem,
    counts: Sequence[int],
    seed: int,
    report: Report,
    *,
    previous: Layout = (),
    planes: int | None = None,
) -> Iterator[tuple[int, Layout]]:
    """Find the best layouts for increasing numbers of cords; the error never increases.

    For each number the search starts from nothing, and from the previous layout with one cord more.
    If neither result is better, or only with slivers, the previous layout is returned again.

    Args:
        problem: The problem.
        counts: Increasing numbers of cords.
        seed: Seed of the random draws.
        report: Called with the share of the work done and a description.
        previous: Layout of the number before the first, if it is known.
        planes: Largest number of distinct planes; unlimited by default.

    Yields:
        Each number with its layout.

    Raises:
        LayoutError: If the body has no room for more cords.
    """
    before, slivers = previous, ThinParts(problem)
    for n, count in enumerate(counts):
        rng = np.random.default_rng(
            (seed, count)
        )  # the same whichever number the study starts with
        low, high = n / len(counts), (n + 1) / len(counts)
        middle = (low + high) / 2
        report_new, report_grown = (
            subrange(report, low, middle),
            subrange(report, middle, high),
        )
        starts = max(_STARTS - count // 2, 2)
        layouts: list[OptimizedLayout] = []
        with suppress(LayoutError):
            layouts.append(
                optimize_layout(
                    problem,
                    (),
                    rng,
                    report_new,
                    LayoutSearch(extra=count, planes=planes, starts=starts),
                )
            )
        if before:
            with suppress(LayoutError):
                layouts.append(_grow(problem, before, rng, report_grown, planes, starts // 2))
        if not layouts:
            raise no_room_error(problem, count)
        best = min(layouts, key=lambda f: (f.slivers, f.rmse))
        is_clean = not best.slivers or (bool(before) and slivers(before))
        if not before or (is_clean and best.rmse < layout_error(problem, before)):
            before = best.sensors
        yield count, before


def _grow(
    problem: Problem,
    before: Layout,
    rng: np.random.Generator,
    report: Report,
    planes: int | None,
    starts: int,
) -> OptimizedLayout:
    layout = add_cord(problem, before, rng, subrange(report, 0.0, 0.5), planes)
    free = [replace(s, free=FREE) for s in layout]
    show = subrange(report, 0.5, 1.0)
    return optimize_layout(problem, free, rng, show, LayoutSearch(planes=planes, starts=starts))


def find_knee(counts: Sequence[int], errors: Float) -> int:
    """Return the number of cords beyond which more pay least.

    It is where the logarithm of the error is furthest below the line between the curve's ends.

    Args:
        counts: Numbers of cords, increasing.
        errors: Error of each number.

    References:
        Satopaa et al. 2011, "Finding a Kneedle in a Haystack".
    """
    if len(counts) < 3:
        return int(counts[int(np.argmin(errors))])
    x = np.asarray(counts, float)
    y = np.log(np.asarray(errors, float))
    line = y[0] + (y[-1] - y[0]) * (x - x[0]) / (x[-1] - x[0])
    return int(counts[int((line - y).argmax())])
