"""From a measured amplitude to the value of a control: dead zone, curve, direction, limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...core.errors import ControlError


@dataclass(frozen=True)
class Shaping:
    """An input x counts from `dead_zone` on and is full at `full`: |x| between them becomes 0..1,
    to the power of `curve` (above 1: finer near rest), with the sign of x, within `minimum` and
    `maximum`. `invert` turns the range around. `smoothing` (Hz) and `quickness` are the cutoff at
    rest and the speed's weight of the One Euro filter that the input goes through first; a
    smoothing of 0 is none."""

    dead_zone: float = 0.0
    full: float = 1.0
    curve: float = 1.0
    minimum: float = 0.0
    maximum: float = 1.0
    invert: bool = False
    smoothing: float = 3.0
    quickness: float = 1.0

    def __post_init__(self) -> None:
        numbers = (self.dead_zone, self.full, self.curve, self.minimum, self.maximum)
        if not all(map(math.isfinite, (*numbers, self.smoothing, self.quickness))):
            raise ControlError("a control's settings must be finite numbers", code="not-finite")
        if not 0 <= self.dead_zone < self.full:
            raise ControlError(
                f"dead_zone must be at least 0 and below full, not {self.dead_zone:g} and"
                f" {self.full:g}",
                code="out-of-range",
                field="dead_zone",
            )
        if not 0.1 <= self.curve <= 10:
            raise ControlError(
                f"curve must lie between 0.1 and 10, not {self.curve:g}",
                code="out-of-range",
                field="curve",
            )
        if not -1 <= self.minimum < self.maximum <= 1:
            raise ControlError(
                "minimum must be below maximum, both between -1 and 1, not"
                f" {self.minimum:g} and {self.maximum:g}",
                code="out-of-range",
                field="minimum",
            )
        if self.smoothing < 0 or self.quickness < 0:
            raise ControlError(
                "smoothing and quickness must not be negative",
                code="out-of-range",
                field="smoothing",
            )

    def __call__(self, x: float) -> float:
        """The control's value of an input that is a finite number."""
        share = (abs(x) - self.dead_zone) / (self.full - self.dead_zone)
        y = math.copysign(min(max(share, 0.0), 1.0) ** self.curve, x)
        y = min(max(y, self.minimum), self.maximum)
        return self.minimum + self.maximum - y if self.invert else y
