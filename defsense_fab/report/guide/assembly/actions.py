"""What the hands do to put a device together: typed actions, what each needs done before it, and
what it bars."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ....core.errors import FabricationError

# Actions in an order in which each finds done what it needs, and nothing that bars it.


def in_order(actions: Sequence[Action]) -> tuple[Action, ...]:
    """Of the orders that there are the one that keeps closest to the order given: joint by joint.

    Raises FabricationError where something needed is done by nothing, or each of some actions has
    to wait for another one of them.
    """
    after = _followers(actions)
    waits = [0] * len(actions)
    for followers in after:
        for k in followers:
            waits[k] += 1
    ready = [k for k, n in enumerate(waits) if not n]
    heapq.heapify(ready)
    out = []
    while ready:
        k = heapq.heappop(ready)
        out.append(actions[k])
        for follower in after[k]:
            waits[follower] -= 1
            if not waits[follower]:
                heapq.heappush(ready, follower)
    if len(out) < len(actions):
        stuck = next(a for a, n in zip(actions, waits, strict=True) if n)
        raise FabricationError(
            f"assembly: {_told(stuck)} and others each have to wait for another: there is no order"
            " in which this device can be put together; move a cord plane, or leave wires by the"
            " mouths (strain_relief = false in [fabrication])"
        )
    return tuple(out)


def _followers(actions: Sequence[Action]) -> list[set[int]]:
    """By action those that come behind it: what it makes possible, and what would bar it."""
    makers: dict[Fact, list[int]] = defaultdict(list)
    for k, action in enumerate(actions):
        for fact in action.makes:
            makers[fact].append(k)
    after: list[set[int]] = [set() for _ in actions]
    for k, action in enumerate(actions):
        for fact in action.needs:
            if fact not in makers:
                raise FabricationError(f"assembly: nothing does what {_told(action)} needs: {fact}")
            for maker in makers[fact]:
                after[maker].add(k)
        for fact in action.bars:
            for maker in makers[fact]:
                if maker != k:
                    after[k].add(maker)
    return after


def _told(action: Action) -> str:
    of = [f"joint {action.joint + 1}"] if action.joint is not None else []
    of += [f"cord {action.cord}"] if action.cord else []
    return " of ".join([f"'{action.kind}'", *of])


class Kind(StrEnum):
    """What is done."""

    PRINT = "print"
    CAST = "cast"
    TRY_PINS = "try pins"
    CUT = "cut cord"
    CRIMP = "crimp"
    MARK = "mark"
    TRIM = "trim"
    DRY_FIT = "dry-fit"
    PINS = "pins in"
    LAY = "lay"
    THREAD = "thread"
    STRETCH = "stretch"
    GLUE_END = "glue end"
    SET_END = "let end set"
    WIRE = "route wire"
    GLUE = "glue joint"
    SET = "let set"
    PULL = "pull out"
    SEAT = "let in"
    MEASURE = "measure"
    CONNECT = "wire to the board"


#: Something that is true once an action has made it: its name and what it is of.
Fact = tuple[str | int, ...]


@dataclass(frozen=True)
class Expected:
    """What a cord should measure, ohm: `about`, and between `low` and `high`."""

    cord: str
    about: float
    low: float
    high: float


@dataclass(frozen=True)
class Action:
    """One thing to do, of a `joint` (index of the assembly's step), a `cord`, an `end` of it (0:
    start), as far as it is of these. It needs all of `needs` to be true, none of `bars`, and makes
    `makes` true. `amount`: mm to cut, to mark, to trim or to stretch; `expected`: of a measurement;
    `late`: of an end that is crimped when its cord lies in closed joints.
    """

    kind: Kind
    joint: int | None = None
    cord: str | None = None
    end: int | None = None
    needs: frozenset[Fact] = frozenset()
    bars: frozenset[Fact] = frozenset()
    makes: frozenset[Fact] = frozenset()
    amount: float | None = None
    expected: tuple[Expected, ...] = ()
    late: bool = False
