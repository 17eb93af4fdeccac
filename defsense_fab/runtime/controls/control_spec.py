"""Define controls: a name, a formula, and the shaping of its value."""

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


class Shaping(Table, frozen=True):
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
        """Return the control's value for the finite amplitude `x`."""
        share = (abs(x) - self.dead_zone) / (self.full - self.dead_zone)
        y = math.copysign(min(max(share, 0.0), 1.0) ** self.curve, x)
        y = min(max(y, self.minimum), self.maximum)
        return self.minimum + self.maximum - y if self.invert else y


_NAME = re.compile(r"[A-Za-z_]\w{0,40}", re.ASCII)


@dataclass(frozen=True)
class ControlSpec:
    """The definition of a control.

    Attributes:
        name: Its name: ASCII letters, digits and underscores, not a Python keyword.
        formula: Expression of the amplitudes of poses and of earlier controls.
        shaping: How its value follows from the formula's value.

    Raises:
        ControlError: The name is not valid.
    """

    name: str
    formula: str
    shaping: Shaping = field(default_factory=Shaping)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or iskeyword(self.name):
            raise ControlError(
                f"{self.name!r} is not a valid control name",
                code="name-invalid",
                action="Use letters, digits and underscores, starting with a letter, and no Python"
                " keyword",
                name=self.name,
            )


def default_specs(poses: Sequence[str]) -> list[ControlSpec]:
    """Return a control for each pose, with the name of the pose."""
    return [ControlSpec(plain_name(name), plain_name(name)) for name in poses]


def plain_name(name: str) -> str:
    """Return the name of a pose in formulas: "bend-up" becomes bend_up, "in" becomes in_."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    plain = f"pose_{plain}" if not plain[:1].isalpha() else plain
    return f"{plain}_" if iskeyword(plain) else plain
