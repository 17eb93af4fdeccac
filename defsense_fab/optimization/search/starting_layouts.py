"""Select the layouts that descents start from among thousands of candidates."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import distinct_planes
from ...core.device.device import Sensor
from ...core.device.sensor_tables import new_sensor_names
from ...core.errors import LayoutError
from ...core.progress import Report
from ..limits.polyline_distance import path_gaps
from ..limits.thin_parts import ThinParts
from ..problem.problem import Limits, Problem
from .candidate_families import (
    lift_into_space,
    there_and_back,
    vary_sensor,
    waves_in_plane,
    waves_through_body,
)
from .candidates import CandidateBatch, Pool, build_pool
from .exit_loops import loops_from_exits

_MAX_EXCHANGE_TRIES = 400  # best candidates tried in place of a chosen cord; a new cord tries all


def select_candidates(
    pools: Sequence[Pool],
    error: Callable[[Float], Float],
    limits: Limits,
    *,
    rounds: int = 3,
    some: Sequence[Bool] | None = None,
    settled: Sequence[bool] | None = None,
    allowed: Callable[[dict[int, int]], bool] | None = None,
) -> Int:
    """Choose one candidate from each cord's pool, greedily and then by exchanges.

    Args:
        pools: The candidates of each cord.
        error: Function of sets of signals (k, n, m) of m cords that returns the error (k,) of each.
        limits: The limits, with the distances of two cords.
        rounds: Largest number of rounds in which each cord is exchanged if that helps.
        some: Restricts each pool to a part (c,) bool.
        settled: Marks pools of one cord that was verified next to the other settled ones. Coarse
            samples need a larger clearance, which is not demanded between two of them.
        allowed: May refuse a choice, given as numbers of candidates by number of the pool.

    Returns:
        Number (m,) of the candidate in each pool; -1 for the pools that remain when no candidate
        keeps the clearance.
    """
    is_settled = settled or [False] * len(pools)
    chosen = np.full(len(pools), -1)
    order = sorted(range(len(pools)), key=lambda i: len(pools[i]))
    for round_number in range(rounds + 1):
        before = chosen.copy()
        for slot in order:
            pool = pools[slot]
            others = [i for i in range(len(pools)) if i != slot and chosen[i] >= 0]
            numbers = np.arange(len(pool)) if some is None else np.flatnonzero(some[slot])
            signals = pool.signals.T[numbers]
            rest = [np.broadcast_to(pools[i].signals[:, chosen[i]], signals.shape) for i in others]
            errors = error(np.stack([signals, *rest], axis=-1))
            lines = [
                pools[i].paths[chosen[i]]
                for i in others
                if not (is_settled[slot] and is_settled[i])
            ]
            best = np.argsort(errors, kind="stable")[
                : _MAX_EXCHANGE_TRIES if chosen[slot] >= 0 else None
            ]
            for k in numbers[best].tolist():
                if k == chosen[slot]:
                    break  # better candidates do not keep the clearance
                if all(keeps_clearance(pool.paths[k], line, limits) for line in lines) and (
                    allowed is None or allowed({**{i: int(chosen[i]) for i in others}, slot: k})
                ):
                    chosen[slot] = k
                    break
            else:
                if chosen[slot] < 0:
                    return chosen
        if round_number and (before == chosen).all():
            break
    return chosen


def keeps_clearance(path: Float, other: Float, limits: Limits) -> bool:
    """Return whether two coarse paths (p, 3), (q, 3) mm and their pads keep their distance."""
    clearance = limits.clearance + _SAMPLING_MARGIN_MM
    slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
    far = max(clearance, limits.pad_to_pad if limits.pad[0] else 0.0) + slack
    if (path.max(0) < other.min(0) - far).any() or (path.min(0) > other.max(0) + far).any():
        return True
    if limits.pad[0]:
        ends, others = path[[0, -1]], other[[0, -1]]
        between = np.linalg.norm(ends[:, None] - others, axis=2).min()
        to_path = min(path_gaps(ends[None], other)[0], path_gaps(others[None], path)[0])
        if min(between - limits.pad_to_pad, to_path - limits.pad_to_path) < _SAMPLING_MARGIN_MM:
            return False
    return bool(path_gaps(path[None], other)[0] >= clearance + slack)


Layout = tuple[Sensor, ...]
#: Makes a number of planar candidates, whose planes have given normals or any.
Family = Callable[[Problem, int, np.random.Generator, Float | None], CandidateBatch]
FREE = frozenset({"path", "plane"})
_ALIGNED = frozenset({"path", "offset"})
_START_SHARE = 0.3  # of the candidates, so that starts differ
_SMALL_SHARE_TRIES = 50  # selections from small shares, if larger ones have no room
_MAX_PLANE_TRIES = 5  # sets of planes tried for a start
_PLANE_CANDIDATES = 3000  # per plane
_ROOM_CANDIDATES = 2000  # to find how many cords the body has room for
_SAMPLING_MARGIN_MM = 0.1  # added to distances for what coarse samples miss


@dataclass(frozen=True)
class LayoutSearch:
    """What a search looks for, and its effort.

    Attributes:
        extra: Number of cords to add to the drawn ones.
        planes: Largest number of distinct planes, or of those drawn if these are more; None for no
            limit.
        normals: Unit normals (k, 3) of the planes that cords free in path and plane take, and
            whose directions they keep; None for any.
        starts: Number of layouts to descend from.
        finalists: Number of descents that continue until they converge.
        candidates: Number of candidates per cord.
        in_space: Whether paths may leave planes.
    """

    extra: int = 0
    planes: int | None = None
    normals: Float | None = None
    starts: int = 6
    finalists: int = 1
    candidates: int = 3000
    in_space: bool = False


@dataclass(frozen=True)
class CordChoices:
    """The candidates of one cord.

    Attributes:
        name: Name of the cord.
        free: Freedom of the chosen candidate.
        pool: The candidates.
        settled: Whether the only candidate is the cord itself.
    """

    name: str
    free: frozenset[str]
    pool: Pool
    settled: bool = False

    @classmethod
    def of(cls, problem: Problem, sensor: Sensor) -> CordChoices:
        """Create the choices of a cord that stays as it is."""
        return cls(sensor.name, sensor.free, Pool.of(problem, sensor), settled=True)


def candidate_choices(
    problem: Problem, drawn: Sequence[Sensor], search: LayoutSearch, rng: np.random.Generator
) -> list[CordChoices]:
    """Collect the candidates of all cords of a layout.

    Drawn cords get variations and, if path and plane are free, paths of all families; extra cords
    get only the latter. With a limit on planes drawn cords stay as they are: their planes are few
    already, and descents improve them later.

    Args:
        problem: The problem.
        drawn: The drawn cords.
        search: What to look for.
        rng: Random generator.

    Raises:
        LayoutError: If extra cords are requested and no candidate fits.
    """
    extra, planes, normals = search.extra, search.planes, search.normals
    size = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[1])
    drawn_planes = len(distinct_planes([s.plane for s in drawn]))
    needs_families = (extra and (planes is None or planes > drawn_planes)) or (
        planes is None and FREE in {s.free for s in drawn}
    )
    families = (
        family_pool(problem, search.candidates, rng, normals, search.in_space)
        if needs_families
        else Pool.empty(problem)
    )
    free = FREE if normals is None else _ALIGNED
    out = []
    for s in drawn:
        if planes is not None or not s.free:
            out.append(CordChoices.of(problem, s))
            continue
        if normals is not None and s.free == FREE:
            out.append(CordChoices(s.name, free, families))
            continue
        count = search.candidates // (8 if s.free == FREE else 2)
        variations = build_pool(
            problem, [partial(vary_sensor, s, count, size / 2, rng)], keep_first=True
        )
        out.append(
            CordChoices(s.name, s.free, variations.plus(families) if s.free == FREE else variations)
        )
    if extra:
        if needs_families and not len(families):
            allowed = None if planes is None else max(planes, drawn_planes)
            raise no_room_error(problem, len(drawn) + extra, allowed)
        names = itertools.islice(new_sensor_names(s.name for s in drawn), extra)
        out += [CordChoices(name, free, families) for name in names]
    return out


def family_pool(
    problem: Problem,
    count: int,
    rng: np.random.Generator,
    normals: Float | None = None,
    in_space: bool = False,
) -> Pool:
    """Build candidates of all families; several makers of one family use several cores.

    Most cords that keep to given exits go out and come back.
    """
    families: list[Family] = [*4 * [waves_through_body], there_and_back]
    share = count // 4
    if problem.limits.exits:
        families, share = [*8 * [loops_from_exits], waves_through_body], count // 2

    def make(family: Family, r: np.random.Generator) -> CandidateBatch:
        batch = family(problem, share, r, normals)
        return lift_into_space(problem, batch, r) if in_space else batch

    rngs = rng.spawn(len(families))
    return build_pool(problem, [partial(make, f, r) for f, r in zip(families, rngs, strict=True)])


def no_room_error(problem: Problem, count: int, planes: int | None = None) -> LayoutError:
    """Return the error for a body in which so many cords do not fit.

    Args:
        problem: The problem.
        count: Number of cords that were requested.
        planes: Largest number of their planes; None for no limit.
    """
    limits, lengths = problem.limits, ""
    noun, ends = ("cord", ", with pockets or free ends") if limits.is_cut else ("trace", "")
    if limits.shortest > 0 or limits.longest < np.inf:
        lengths = (
            f", with channels of which {limits.lengths} by [cord] length and min_stretch{ends}"
        )
    if limits.exits:
        lengths += ", with both ends of each in the regions of [wires] exit"
    if limits.kept_whole:
        lengths += ", and whose planes and channels avoid those of [fabrication] keep_whole"
    count_found = _count_that_fits(problem, count)
    is_fewer = 0 < count_found < count
    if planes is None:
        advice = f"Ask for {count_found}, for which room was found" if is_fewer else "Ask for fewer"
    else:
        lengths += f", in at most {planes} plane{'s' * (planes > 1)}"
        advice = f"Ask for at most {count_found}" if is_fewer else "Ask for fewer"
        advice += ", allow more planes in [design] planes"
    return LayoutError(
        f"no layout of {count} {noun}s was found that keeps their walls and clearances{lengths}",
        code="no-room-for-cords",
        where=f"[design] sensors = {count}",
        action=f"{advice}, or draw them as [[sensors]]",
        key="design.sensors",
        count=count,
        planes=planes,
        found=count_found,
        suggested=count_found if is_fewer and planes is None else None,
        shortest=limits.shortest,
        longest=limits.longest,
    )


def _count_that_fits(problem: Problem, count: int) -> int:
    """Return for how many of `count` cords greedy selection finds room, in any planes."""
    pool = family_pool(problem, _ROOM_CANDIDATES, np.random.default_rng(0))
    chosen = select_candidates([pool] * count, problem.expected_error, problem.limits, rounds=0)
    return int((chosen >= 0).sum())


def select_starts(
    problem: Problem,
    cords: Sequence[CordChoices],
    search: LayoutSearch,
    slivers: ThinParts,
    rng: np.random.Generator,
    report: Report,
) -> list[Layout]:
    """Select layouts greedily, the first from all candidates and the others from random shares.

    Args:
        problem: The problem.
        cords: The candidates of each cord.
        search: What to look for. With a limit on planes, further cords are chosen from paths in
            the planes of the first ones.
        slivers: Detector of slivers.
        rng: Random generator.
        report: Called with the share of the work done and a description.
    """
    out: list[Layout] = []
    for n in range(search.starts):
        report(n / search.starts, f"selection {n + 1} of {search.starts}")
        share = _START_SHARE if n else 1.0
        if search.planes is None:
            layout = _select(problem, cords, share, slivers, rng)
        else:
            # The best plane for one cord may be too narrow for all, so others are tried.
            layouts = (
                _in_planes(problem, cords, search.planes, share * _START_SHARE**k, slivers, rng)
                for k in range(_MAX_PLANE_TRIES)
            )
            layout = next((t for t in layouts if t is not None), None)
        if layout is not None:
            out.append(layout)
    if not out and search.planes is None:
        # The best candidates leave no room for the last cord; those of small shares may.
        tries = (
            _select(problem, cords, _START_SHARE**2, slivers, rng)
            for _ in range(_SMALL_SHARE_TRIES)
        )
        out += itertools.islice(filter(None, tries), search.starts)
    return out


def _in_planes(
    problem: Problem,
    cords: Sequence[CordChoices],
    planes: int,
    share: float,
    slivers: ThinParts,
    rng: np.random.Generator,
) -> Layout | None:
    """Select a layout in at most `planes` planes, or in those of drawn cords if they have more."""
    drawn = [c for c in cords if c.settled]
    new = [c for c in cords if not c.settled]
    room = planes - len(distinct_planes([c.pool.sensor(0, c.name, c.free).plane for c in drawn]))
    plane_cords = [*drawn, *new[: max(room, 0)]]
    chosen = _select(problem, plane_cords, share, slivers, rng) if plane_cords else ()
    if chosen is None or len(plane_cords) == len(cords):
        return chosen
    makers: list[Callable[[], CandidateBatch]] = []
    for plane in distinct_planes([s.plane for s in chosen]):
        makers.append(partial(waves_in_plane, problem, plane, _PLANE_CANDIDATES, rng.spawn(1)[0]))
        if problem.limits.exits:
            loops, in_plane = partial(loops_from_exits, problem, plane=plane), _PLANE_CANDIDATES
            makers += [partial(loops, 2 * in_plane, r) for r in rng.spawn(2)]
    pool = build_pool(problem, makers)
    if not len(pool):
        return None
    rest = [replace(c, pool=pool) for c in new[max(room, 0) :]]
    settled = [CordChoices.of(problem, s) for s in chosen]
    layout = _select(problem, [*settled, *rest], 1.0, slivers, rng)
    if layout is None:
        return None
    by_name = {s.name: s for s in layout}
    return tuple(by_name[c.name] for c in cords)


def _select(
    problem: Problem,
    cords: Sequence[CordChoices],
    share: float,
    slivers: ThinParts,
    rng: np.random.Generator,
) -> Layout | None:
    """Select a layout from a share of the candidates, without slivers if possible."""

    def layout(chosen: dict[int, int]) -> Layout:
        return tuple(
            cords[i].pool.sensor(k, cords[i].name, cords[i].free) for i, k in sorted(chosen.items())
        )

    some = [rng.random(len(c.pool)) < share for c in cords]
    for keep in some:
        keep[:1] = True  # the drawing, and one candidate of a small pool
    for allowed in (lambda c: not slivers(layout(c)), None):
        chosen = select_candidates(
            [c.pool for c in cords],
            problem.expected_error,
            problem.limits,
            some=some,
            settled=[c.settled for c in cords],
            allowed=allowed,
        )
        if (chosen >= 0).all():
            return layout(dict(enumerate(chosen.tolist())))
    return None
