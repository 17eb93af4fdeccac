"""Provide the names, numbers and phrases that the guide's instructions share."""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice

from ....core.device.device import Device
from ....store.manifest import CutCord, JoinStep, Manifest
from .actions import Action, ExpectedResistance

#: Names of a cord's ends, as `guide.json` has them.
ENDS = ("start", "end")


@dataclass(frozen=True)
class GuideContext:
    """What instructions refer to: the device, its manifest, and the numbers of the steps.

    Attributes:
        device: The device.
        manifest: The manifest of its parts.
        step_numbers: Number of the step in which each joint is closed, by the joint's index.
        lower_parts: Names of the parts that lie on the table while each joint is open.
    """

    device: Device
    manifest: Manifest
    step_numbers: Mapping[int, int]
    lower_parts: Sequence[tuple[str, ...]]

    def cord(self, action: Action) -> CutCord:
        """Return the cord of an action."""
        return next(c for c in self.manifest.cords if c.sensor == action.cord)

    def joint(self, action: Action) -> JoinStep:
        """Return the joint of an action."""
        assert action.joint is not None
        return self.manifest.assembly[action.joint]

    @property
    def is_bonded(self) -> bool:
        """Whether cords are glued along their grooves."""
        return self.manifest.assembly_of_cords == "bonded"


def join_names(names: Sequence[str]) -> str:
    """Join names as in "a, b and c"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def cord_label(cord: str) -> str:
    """Return "cord left" for `left`, but "cord-1" for `cord-1`."""
    return cord if cord.lower().startswith("cord") else f"cord {cord}"


def describe_sides(joint: JoinStep) -> str:
    """Describe the parts on both sides of a joint, as in "a + b and c"."""
    return " + ".join(joint.join[0]) + " and " + " + ".join(joint.join[1])


def pin_letters(joint: JoinStep) -> tuple[str, ...]:
    """Return a letter for each pin of a joint, by which texts and pictures name it.

    After z the names have two letters: aa, ab and so on, like the columns of a spreadsheet.
    """
    singles = string.ascii_lowercase
    pairs = (a + b for a in singles for b in singles)
    return tuple(islice(chain(singles, pairs), len(joint.pins)))


def capitalize_first(text: str) -> str:
    """Return a text with its first letter in upper case and the rest unchanged."""
    return text[:1].upper() + text[1:]


def format_resistance(expected: ExpectedResistance) -> str:
    """Format an expected resistance, as in "about 1146 ohm (1031 to 1260)"."""
    return f"about {expected.about:.0f} ohm ({expected.low:.0f} to {expected.high:.0f})"
