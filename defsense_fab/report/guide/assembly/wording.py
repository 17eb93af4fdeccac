"""The words that the guide's sentences have in common."""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice

from ....core.device.device import Device
from ....store.manifest import CutCord, JoinStep, Manifest
from .actions import Action, Expected

ENDS = ("start", "end")


@dataclass(frozen=True)
class Words:
    """Sentences for the actions of one device; `numbers` are those of the steps in which each joint
    (index of the assembly's step) is closed."""

    device: Device
    manifest: Manifest
    numbers: Mapping[int, int]

    def cord(self, action: Action) -> CutCord:
        """That an action is of."""
        return next(c for c in self.manifest.cords if c.sensor == action.cord)

    def step(self, action: Action) -> JoinStep:
        """The joint that an action is of."""
        assert action.joint is not None
        return self.manifest.assembly[action.joint]

    @property
    def bonded(self) -> bool:
        return self.manifest.assembly_of_cords == "bonded"


def named(names: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def called(cord: str) -> str:
    """cord left, but cord-1."""
    return cord if cord.lower().startswith("cord") else f"cord {cord}"


def sides(step: JoinStep) -> str:
    """a + b and c."""
    return " + ".join(step.join[0]) + " and " + " + ".join(step.join[1])


def pin_letters(step: JoinStep) -> tuple[str, ...]:
    """A letter for each pin of a joint, by which text and picture name it; behind z they are two,
    aa, ab and so on, as the columns of a table are."""
    singles = string.ascii_lowercase
    pairs = (a + b for a in singles for b in singles)
    return tuple(islice(chain(singles, pairs), len(step.pins)))


def first(text: str) -> str:
    """With a capital."""
    return text[:1].upper() + text[1:]


def limits(expected: Expected) -> str:
    """About 1146 ohm (1031 to 1260)."""
    return f"about {expected.about:.0f} ohm ({expected.low:.0f} to {expected.high:.0f})"
