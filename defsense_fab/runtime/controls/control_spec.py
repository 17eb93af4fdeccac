"""What makes a control: a formula, and how its value is shaped."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from keyword import iskeyword
from typing import Annotated

from msgspec import Meta

from ...core.errors import ControlError
from ...core.schema.declare import NonNegative, Problem, Table, key
from ...core.schema.reader import validate

_Share = Annotated[float, Meta(ge=-1, le=1)]


class Shaping(Table):
    """How a control's value follows from the measured amplitude of its formula.

    An amplitude x goes through a One Euro filter first. Then |x| from `dead_zone` to `full` becomes
    0 to 1, to the power of `curve`, with the sign of x, within `minimum` and `maximum`.

    Raises:
        ControlError: if a value is out of range.
    """

    dead_zone: Annotated[NonNegative, key("Amplitude up to which the control is 0.")] = 0.0
    full: Annotated[float, key("Amplitude at which the control is 1.")] = 1.0
    curve: Annotated[
        Annotated[float, Meta(ge=0.1, le=10)], key("Exponent; above 1 is finer near rest.")
    ] = 1.0
    minimum: Annotated[_Share, key("Smallest value; -1 for controls that go both ways.")] = 0.0
    maximum: Annotated[_Share, key("Largest value.")] = 1.0
    invert: Annotated[bool, key("Whether the range is turned around.")] = False
    smoothing: Annotated[
        NonNegative,
        key("Cutoff of the One Euro filter at rest; lower is calmer, 0 is off.", unit="Hz"),
    ] = 3.0
    quickness: Annotated[
        NonNegative,
        key("How much speed raises the cutoff; higher lags less.", unit="Hz per unit/s"),
    ] = 1.0

    def __post_init__(self) -> None:
        validate(self, ControlError)

    def check(self) -> Iterator[Problem]:
        """Yield problems of limits that are in the wrong order."""
        if self.dead_zone >= self.full:
            text = f"must be below full, {self.full:g}, not {self.dead_zone:g}"
            yield Problem(("dead_zone",), text, "out-of-range", "Decrease it")
        if self.minimum >= self.maximum:
            text = f"must be below maximum, {self.maximum:g}, not {self.minimum:g}"
            yield Problem(("minimum",), text, "out-of-range", "Decrease it")

    def __call__(self, x: float) -> float:
        """The control's value of an input that is a finite number."""
        share = (abs(x) - self.dead_zone) / (self.full - self.dead_zone)
        y = math.copysign(min(max(share, 0.0), 1.0) ** self.curve, x)
        y = min(max(y, self.minimum), self.maximum)
        return self.minimum + self.maximum - y if self.invert else y


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
