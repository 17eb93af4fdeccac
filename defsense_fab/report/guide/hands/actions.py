"""What the hands do to put a device together: typed actions, what each needs done before it, and
what it bars."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


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
