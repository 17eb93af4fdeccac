"""The quantities that a section shows in colors, and the texts of their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...workflow.design.body_section import Quantity
from ..workbench.colors import ColorScale

_PERCENT = 100.0
_MIN_SHOWN_MOVE_MM = 5e-3  # below which only the rest position of a point is shown
_MINUS = "\u2212"


@dataclass(frozen=True)
class SectionQuantity:
    """A quantity that a section shows.

    Attributes:
        label: Its name in the list.
        title: Text above its color bar.
        quantity: Quantity of the body's stretch; None for the benefit of another cord.
    """

    label: str
    title: str
    quantity: Quantity | None = None

    @property
    def needs_direction(self) -> bool:
        """Whether it depends on a direction."""
        return self.quantity is not None and self.quantity.kind == "along"

    @property
    def varies_by_state(self) -> bool:
        """Whether it differs from state to state."""
        return self.quantity is not None and not self.quantity.variance

    @property
    def unit(self) -> str:
        """Unit of the numbers in the color bar."""
        if self.quantity is None:
            return "mm"
        return "stretch squared, no unit" if self.quantity.variance else "percent strain"

    def to_shown(self, values: Float) -> Float:
        """Return the numbers of the color bar: stretches as percent strain, others unchanged."""
        return _PERCENT * (values - 1) if self.varies_by_state else values

    def scale(self, reach: float) -> ColorScale:
        """Return a color scale for stretches that reach this far (see `BodySection.spread`)."""
        if self.varies_by_state:
            return ColorScale.symmetric(_PERCENT * reach)
        return ColorScale.from_zero(reach)


NEXT_CORD = SectionQuantity("benefit of another cord", "Decrease of the expected error by a cord")
ALONG_DIRECTION = SectionQuantity(
    "stretch along a direction", "Stretch along the direction", Quantity("along")
)
LARGEST_STRETCH = SectionQuantity(
    "largest principal stretch", "Largest principal stretch", Quantity("largest")
)
SMALLEST_STRETCH = SectionQuantity(
    "smallest principal stretch", "Smallest principal stretch", Quantity("smallest")
)
VARIANCE_ALONG_DIRECTION = SectionQuantity(
    "variance of stretch along a direction",
    "Variance of stretch along the direction, all states",
    Quantity("along", variance=True),
)
VARIANCE_OF_LARGEST = SectionQuantity(
    "variance of largest stretch",
    "Variance of the largest stretch, all states",
    Quantity("largest", variance=True),
)
SECTION_QUANTITIES = (
    ALONG_DIRECTION,
    LARGEST_STRETCH,
    SMALLEST_STRETCH,
    VARIANCE_ALONG_DIRECTION,
    VARIANCE_OF_LARGEST,
    NEXT_CORD,
)


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


def range_text(quantity: SectionQuantity, numbers: Float) -> str:
    """Return the range of the numbers in a section, for the note below the color bar."""
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return "no numbers in this section"
    low, high = float(known.min()), float(known.max())
    if quantity.varies_by_state:
        return f"in this section {_signed(low)} to {_signed(high)} %"
    unit = " mm" if quantity.quantity is None else ""
    return f"in this section {low:.3g} to {high:.3g}{unit}".replace("-", _MINUS)


def point_text(values: PointValues) -> str:
    """Return the numbers of a point in markdown."""
    lines = [f"Point at rest: ({_coordinates(values.rest)}) mm"]
    if np.linalg.norm(values.position - values.rest) > _MIN_SHOWN_MOVE_MM:
        lines.append(f"Point in this state: ({_coordinates(values.position)}) mm")
    lines += [
        f"Strain, {name}: {_signed(_PERCENT * (stretch - 1))} %"
        for name, stretch in values.stretches.items()
    ]
    lines.append(
        f"Standard deviation over all states: {_PERCENT * np.sqrt(values.variance):.1f} %"
        f" (variance {values.variance:.2g})"
    )
    return "  \n".join(lines)


def _signed(value: float) -> str:
    return f"{round(value, 1) + 0.0:+.1f}".replace("-", _MINUS)


def _coordinates(point: Float) -> str:
    return ", ".join(f"{x + 0.0:.1f}" for x in np.round(point, 1))
