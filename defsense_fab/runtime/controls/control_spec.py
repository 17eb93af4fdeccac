"""What makes a control: a formula, and how its value is shaped."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from keyword import iskeyword

from ...core.errors import ControlError
from .shaping import Shaping

_NAME = re.compile(r"[A-Za-z_]\w{0,40}", re.ASCII)


@dataclass(frozen=True)
class ControlSpec:
    """A control by its name: a formula of poses' amplitudes and of controls before it, and how its
    value is shaped."""

    name: str
    formula: str
    shaping: Shaping = field(default_factory=Shaping)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or iskeyword(self.name):
            raise ControlError(
                f"{self.name!r} cannot name a control; use letters, digits and _, a letter first"
                " (and no word of Python)",
                code="name-invalid",
                name=self.name,
            )


def default_specs(poses: Sequence[str]) -> list[ControlSpec]:
    """A control for each pose, named like it."""
    return [ControlSpec(plain_name(name), plain_name(name)) for name in poses]


def plain_name(name: str) -> str:
    """A pose's name as it stands in formulas: "bend-up" is bend_up there, "in" is in_."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = f"pose_{plain}" if not plain[:1].isalpha() else plain
    return f"{plain}_" if iskeyword(plain) else plain
