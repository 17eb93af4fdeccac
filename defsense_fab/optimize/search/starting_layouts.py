"""Where descents set out from: layouts selected from thousands of candidates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import distinct_planes
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ..limits.polyline_distance import path_gaps
from ..limits.thin_parts import ThinParts
from ..problem.problem import Problem
from .candidate_families import there_and_back, waves_through_body, vary_sensor, waves_in_plane
from .candidates import Pool, build_pool

# Greedy selection with swaps: one candidate from each cord's pool.

#: So many of the best are tried in place of a cord that there is; for a new one all are.
_MAX_EXCHANGE_TRIES = 400


def select_candidates(
    pools: Sequence[Pool],
    error: Callable[[Float], Float],
    clearance: float,
    *,
    rounds: int = 3,
    some: Sequence[Bool] | None = None,
    settled: Sequence[bool] | None = None,
    allowed: Callable[[dict[int, int]], bool] | None = None,
) -> Int:
    """Index into each pool (m,), -1 for those left when no clear candidate was found for one.

    `error` takes sets of signals (k, n, m) to the error of each (k,), for any number m of cords.
    Cords are added one by one, then exchanged one by one while that helps. `some` restricts each
    pool to a part; `allowed` may refuse what is chosen so far, pool by pool. `settled`
    pools have one candidate, a cord that was verified beside the others of these: what is asked
    here is more, for the sake of coarse samples, and is not asked of two of them.
    """
    stays = settled or [False] * len(pools)
    chosen = np.full(len(pools), -1)
    order = sorted(range(len(pools)), key=lambda i: len(pools[i]))
    for turn in range(rounds + 1):
        before = chosen.copy()
        for slot in order:
            pool = pools[slot]
            others = [i for i in range(len(pools)) if i != slot and chosen[i] >= 0]
            which = np.arange(len(pool)) if some is None else np.flatnonzero(some[slot])
            own = pool.signals.T[which]
            rest = [np.broadcast_to(pools[i].signals[:, chosen[i]], own.shape) for i in others]
            errors = error(np.stack([own, *rest], axis=-1))
            lines = [pools[i].paths[chosen[i]] for i in others if not (stays[slot] and stays[i])]
            best = np.argsort(errors, kind="stable")[
                : _MAX_EXCHANGE_TRIES if chosen[slot] >= 0 else None
            ]
            for k in which[best].tolist():
                if k == chosen[slot]:
                    break  # better ones are not clear
                if all(_keeps_clearance(pool.paths[k], line, clearance) for line in lines) and (
                    allowed is None or allowed({**{i: int(chosen[i]) for i in others}, slot: k})
                ):
                    chosen[slot] = k
                    break
            else:
                if chosen[slot] < 0:
                    return chosen
        if turn and (before == chosen).all():
            break
    return chosen


def _keeps_clearance(path: Float, other: Float, clearance: float) -> bool:
    """Whether the path (p, 3) keeps `clearance` from the path (q, 3)."""
    slack = np.linalg.norm(np.diff(other, axis=0), axis=1).max() / 4
    low, high = other.min(0) - clearance - slack, other.max(0) + clearance + slack
    if (path.max(0) < low).any() or (path.min(0) > high).any():
        return True
    return bool(path_gaps(path[None], other)[0] >= clearance + slack)


Layout = tuple[Sensor, ...]
FREE = frozenset({"path", "plane"})
_ALIGNED = frozenset({"path", "offset"})
_START_SHARE = 0.3  # of the candidates that a start sees, so that starts differ
_MAX_PLANE_TRIES = 5  # planes, or sets of them, for a start
_PLANE_CANDIDATES = 3000  # candidates in a plane
_ROOM_CANDIDATES = 2000  # to find out how many cords there is room for
_SAMPLING_MARGIN_MM = 0.1  # kept from the clearance for what coarse samples miss, mm


@dataclass(frozen=True)
class CordChoices:
    """The candidates of one cord, and the name and freedom that the chosen one takes. A `settled`
    one has a single candidate, the cord itself."""

    name: str
    free: frozenset[str]
    pool: Pool
    settled: bool = False

    @classmethod
    def of(cls, problem: Problem, sensor: Sensor) -> CordChoices:
        """No other than the cord itself."""
        return cls(sensor.name, sensor.free, Pool.of(problem, sensor), settled=True)


def candidate_choices(
    problem: Problem,
    drawn: Sequence[Sensor],
    extra: int,
    candidates: int,
    rng: np.random.Generator,
    planes: int | None = None,
    normals: Float | None = None,
) -> list[CordChoices]:
    """For each drawn cord its variations and, where path and plane are free, paths of all
    families; the latter alone for `extra` cords. With a limit on `planes` drawn cords stay as they
    are: descents come later, and their planes are few already. With `normals` (k, 3) cords that are
    free in path and plane take paths in planes square to one of these, and keep that direction.

    Raises LayoutError where no candidate fits.
    """
    size = float(np.sort(np.ptp(problem.surface.bounds, axis=0))[1])
    taken = len(distinct_planes([s.plane for s in drawn]))
    wanted = (extra and (planes is None or planes > taken)) or (
        planes is None and FREE in {s.free for s in drawn}
    )
    families = _family_pool(problem, candidates, rng, normals) if wanted else Pool.empty(problem)
    free = FREE if normals is None else _ALIGNED
    out = []
    for s in drawn:
        if planes is not None or not s.free:
            out.append(CordChoices.of(problem, s))
            continue
        if normals is not None and s.free == FREE:
            out.append(CordChoices(s.name, free, families))
            continue
        count = candidates // (8 if s.free == FREE else 2)
        own = build_pool(problem, [partial(vary_sensor, s, count, size / 2, rng)], keep_first=True)
        out.append(CordChoices(s.name, s.free, own.plus(families) if s.free == FREE else own))
    if extra:
        if wanted and not len(families):
            raise no_room_error(problem, len(drawn) + extra)
        used = {s.name for s in drawn}
        names = (f"cord-{i}" for i in range(1, len(drawn) + extra + 1 + len(used)))
        fresh = [n for n in names if n not in used][:extra]
        out += [CordChoices(n, free, families) for n in fresh]
    return out


def _family_pool(
    problem: Problem, count: int, rng: np.random.Generator, normals: Float | None
) -> Pool:
    """Candidates of all families; several makers of one family for several cores."""
    *four, last = rng.spawn(5)
    makers = [partial(waves_through_body, problem, count // 4, r, normals) for r in four]
    back = partial(there_and_back, problem, count // 4, last, normals)
    return build_pool(problem, [*makers, back])


def no_room_error(problem: Problem, count: int) -> LayoutError:
    """The error for a body in which so many cords do not fit, with what limits them."""
    limits, lengths = problem.limits, ""
    if limits.shortest > 0 or limits.longest < np.inf:
        lengths = (
            f", with channels of which {limits.lengths} by [cord] length and min_stretch, with"
            " pockets or free ends"
        )
    most = _count_that_fits(problem, count)
    fewer = f"Ask for {most}, for which room was found" if 0 < most < count else "Ask for fewer"
    return LayoutError(
        f"no layout of {count} cords was found that keeps their walls and clearances{lengths}",
        code="no-room-for-cords",
        where=f"[design] sensors = {count}",
        action=f"{fewer}, or draw them as [[sensors]]",
        count=count,
        found=most,
        shortest=limits.shortest,
        longest=limits.longest,
    )


def _count_that_fits(problem: Problem, count: int) -> int:
    """For how many of `count` cords greedy selection finds room."""
    pool = _family_pool(problem, _ROOM_CANDIDATES, np.random.default_rng(0), None)
    clearance = problem.limits.clearance + _SAMPLING_MARGIN_MM
    chosen = select_candidates([pool] * count, problem.expected_error, clearance, rounds=0)
    return int((chosen >= 0).sum())


def select_starts(
    problem: Problem,
    cords: Sequence[CordChoices],
    count: int,
    planes: int | None,
    slivers: ThinParts,
    rng: np.random.Generator,
    report: Callable[[float, str], None],
) -> list[Layout]:
    """Up to `count` layouts: the first chosen from all candidates, the others from shares. Once
    there are `planes` planes, the other cords are chosen from paths in those."""
    out: list[Layout] = []
    for n in range(count):
        report(n / count, f"selection {n + 1} of {count}")
        share = _START_SHARE if n else 1.0
        if planes is None:
            found = _select(problem, cords, share, slivers, rng)
        else:
            # The plane that is best for one cord may be too narrow for all: try others.
            tries = (
                _in_planes(problem, cords, planes, share * _START_SHARE**k, slivers, rng)
                for k in range(_MAX_PLANE_TRIES)
            )
            found = next((t for t in tries if t is not None), None)
        if found is not None:
            out.append(found)
    return out


def _in_planes(
    problem: Problem,
    cords: Sequence[CordChoices],
    planes: int,
    share: float,
    slivers: ThinParts,
    rng: np.random.Generator,
) -> Layout | None:
    """A selection in at most `planes` planes, or more only where drawn cords have them."""
    drawn = [c for c in cords if c.settled]
    new = [c for c in cords if not c.settled]
    room = planes - len(distinct_planes([c.pool.sensor(0, c.name, c.free).plane for c in drawn]))
    first = [*drawn, *new[: max(room, 0)]]
    chosen = _select(problem, first, share, slivers, rng) if first else ()
    if chosen is None or len(first) == len(cords):
        return chosen
    makers = [
        partial(waves_in_plane, problem, plane, _PLANE_CANDIDATES, rng.spawn(1)[0])
        for plane in distinct_planes([s.plane for s in chosen])
    ]
    pool = build_pool(problem, makers)
    if not len(pool):
        return None
    rest = [replace(c, pool=pool) for c in new[max(room, 0) :]]
    settled = [CordChoices.of(problem, s) for s in chosen]
    found = _select(problem, [*settled, *rest], 1.0, slivers, rng)
    if found is None:
        return None
    by_name = {s.name: s for s in found}
    return tuple(by_name[c.name] for c in cords)


def _select(
    problem: Problem,
    cords: Sequence[CordChoices],
    share: float,
    slivers: ThinParts,
    rng: np.random.Generator,
) -> Layout | None:
    """The best that greedy selection finds in a share of the candidates, without slivers if it
    can."""

    def layout(chosen: dict[int, int]) -> Layout:
        return tuple(
            cords[i].pool.sensor(k, cords[i].name, cords[i].free) for i, k in sorted(chosen.items())
        )

    some = [rng.random(len(c.pool)) < share for c in cords]
    for keep in some:
        keep[:1] = True  # the drawing, and something where there is little
    for allowed in (lambda c: not slivers(layout(c)), None):
        chosen = select_candidates(
            [c.pool for c in cords],
            problem.expected_error,
            problem.limits.clearance + _SAMPLING_MARGIN_MM,
            some=some,
            settled=[c.settled for c in cords],
            allowed=allowed,
        )
        if (chosen >= 0).all():
            return layout(dict(enumerate(chosen.tolist())))
    return None
