"""The quantities that a section can show, and the numbers of a point."""

from __future__ import annotations

from dataclasses import dataclass

from ....core.arrays import Float
from ....workflow.design.body_section import Quantity

_PERCENT = 100.0


@dataclass(frozen=True)
class SectionQuantity:
    """A quantity that a section shows.

    Attributes:
        quantity: Quantity of the body's stretch; None for the benefit of another cord.
    """

    quantity: Quantity | None = None

    @property
    def needs_direction(self) -> bool:
        """Whether it depends on a direction."""
        return self.quantity is not None and self.quantity.kind == "along"

    @property
    def varies_by_state(self) -> bool:
        """Whether it differs from state to state."""
        return self.quantity is not None and not self.quantity.variance

    def to_shown(self, values: Float) -> Float:
        """Return stretches as percent strain, and other values unchanged."""
        return _PERCENT * (values - 1) if self.varies_by_state else values


NEXT_CORD = SectionQuantity()
ALONG_DIRECTION = SectionQuantity(Quantity("along"))
LARGEST_STRETCH = SectionQuantity(Quantity("largest"))
SMALLEST_STRETCH = SectionQuantity(Quantity("smallest"))
VARIANCE_ALONG_DIRECTION = SectionQuantity(Quantity("along", variance=True))
VARIANCE_OF_LARGEST = SectionQuantity(Quantity("largest", variance=True))


@dataclass(frozen=True)
class PointValues:
    """Numbers of a point of a section.

    Attributes:
        rest: Position at rest (3,) mm.
        position: Position in the shown state (3,) mm.
        stretches: Stretches in the shown state by their names.
        variance: Variance of the stretch over all states.
    """

    rest: Float
    position: Float
    stretches: dict[str, float]
    variance: float
