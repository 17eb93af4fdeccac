"""Describe the actions that assemble a device, and order them by their requirements."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from graphlib import CycleError, TopologicalSorter

from ...core.errors import FabricationError


class ActionKind(StrEnum):
    """Kind of an action; the values are those of `guide.json`."""

    PRINT = "print"
    CAST = "cast"
    TRY_PINS = "try pins"
    FACES = "prepare faces"
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
    PADS = "connect pads"
    MEASURE = "measure"
    CONNECT = "wire to the board"
    CHECK = "check wiring"


#: A state of the work that an action brings about: its name, then the cord, end or joint.
Fact = tuple[str | int, ...]


@dataclass(frozen=True)
class ExpectedResistance:
    """Resistance that a cord should have when it is measured.

    Attributes:
        cord: Name of the cord.
        about: Expected resistance, ohm.
        low: Lower limit, ohm.
        high: Upper limit, ohm.
    """

    cord: str
    about: float
    low: float
    high: float


@dataclass(frozen=True)
class Action:
    """One action of the assembler.

    Attributes:
        kind: Kind of action.
        joint: Index of the joint in the manifest's `assembly`, or None.
        cord: Name of the cord, or None.
        end: End of the cord (0: start, 1: end), or None.
        requires: Facts that must be true before the action.
        must_precede: Facts that must not be true yet.
        effects: Facts that the action makes true.
        amount: Length to cut, mark, trim or stretch, mm, or None.
        expected: Expected resistances, if the action is a measurement.
        steady: Cords whose resistance must not jump while it is measured in this joint. It is not
            their final one, since a later joint completes them.
        is_late: Whether the action belongs to an end that is crimped after its cord's joints are
            closed.
    """

    kind: ActionKind
    joint: int | None = None
    cord: str | None = None
    end: int | None = None
    requires: frozenset[Fact] = frozenset()
    must_precede: frozenset[Fact] = frozenset()
    effects: frozenset[Fact] = frozenset()
    amount: float | None = None
    expected: tuple[ExpectedResistance, ...] = ()
    steady: tuple[str, ...] = ()
    is_late: bool = False


def order_actions(actions: Sequence[Action]) -> tuple[Action, ...]:
    """Order actions so that each follows the actions that it requires.

    Of all valid orders, the one that is returned is closest to the order given: at each point it
    takes the earliest action that is possible.

    Args:
        actions: Actions in the preferred order.

    Returns:
        The same actions in a valid order.

    Raises:
        FabricationError: No action has an effect that another one requires, or some actions
            require each other.
    """
    sorter = TopologicalSorter(_find_predecessors(actions))
    try:
        sorter.prepare()
    except CycleError as error:
        blocked = actions[min(error.args[1])]
        raise FabricationError(
            f"{_describe(blocked)} and other actions require each other, so there is no order in"
            " which this device can be assembled",
            code="no-assembly-order",
            where="assembly",
            action="Move a cord plane, or let wires leave by the mouths (strain_relief = false in"
            " [fabrication])",
            action_kind=str(blocked.kind),
            joint=blocked.joint,
            cord=blocked.cord,
        ) from None
    ready = list(sorter.get_ready())
    heapq.heapify(ready)
    ordered = []
    while ready:
        k = heapq.heappop(ready)
        ordered.append(actions[k])
        sorter.done(k)
        for successor in sorter.get_ready():
            heapq.heappush(ready, successor)
    return tuple(ordered)


def _find_predecessors(actions: Sequence[Action]) -> dict[int, set[int]]:
    """Return, for each action, the indices of the actions that must come before it."""
    achievers: dict[Fact, list[int]] = defaultdict(list)
    for k, action in enumerate(actions):
        for fact in action.effects:
            achievers[fact].append(k)
    before: dict[int, set[int]] = {k: set() for k in range(len(actions))}
    for k, action in enumerate(actions):
        for fact in action.requires:
            if fact not in achievers:
                raise FabricationError(
                    f"no action achieves {fact}, which {_describe(action)} requires",
                    code="requirement-unmet",
                    where="assembly",
                    action_kind=str(action.kind),
                    joint=action.joint,
                    fact=fact,
                )
            before[k] |= set(achievers[fact])
        for fact in action.must_precede:
            for achiever in achievers[fact]:
                if achiever != k:
                    before[achiever].add(k)
    return before


def _describe(action: Action) -> str:
    subjects = [f"joint {action.joint + 1}"] if action.joint is not None else []
    subjects += [f"cord {action.cord}"] if action.cord else []
    return " of ".join([f"'{action.kind}'", *subjects])
