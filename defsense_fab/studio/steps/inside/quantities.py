"""The quantities that sections show, and their colors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float
from ...messages.inside import ColorMap, QuantityInfo, QuantityName
from . import colors
from . import section_quantities as engine

_PERCENT = 100.0


@dataclass(frozen=True)
class ShownQuantity:
    """A quantity as the page shows it.

    Attributes:
        info: Its texts.
        engine: What is computed.
    """

    info: QuantityInfo
    engine: engine.SectionQuantity

    def to_shown(self, numbers: Float) -> Float:
        """Return shown numbers: percent strain, or its standard deviation in percent; or mm."""
        quantity = self.engine.quantity
        if quantity is not None and quantity.variance:
            return np.asarray(_PERCENT * np.sqrt(np.maximum(numbers, 0.0)))
        return numbers


def _quantity(
    name: QuantityName, label: str, hint: str, color_map: str, computed: engine.SectionQuantity
) -> ShownQuantity:
    info = QuantityInfo(
        name=name,
        label=label,
        hint=hint,
        unit="mm" if computed.quantity is None else "%",
        color_map=color_map,
        needs_direction=computed.needs_direction,
        varies_by_state=computed.varies_by_state,
    )
    return ShownQuantity(info, computed)


_SHOWN = (
    _quantity(
        "largest",
        "Largest principal strain",
        "Strain in the direction in which the material stretches most",
        "strain",
        engine.LARGEST_STRETCH,
    ),
    _quantity(
        "smallest",
        "Smallest principal strain",
        "Strain in the direction in which the material shortens most",
        "strain",
        engine.SMALLEST_STRETCH,
    ),
    _quantity(
        "along",
        "Strain along a direction",
        "Strain along a line in the plane, or along a cord",
        "strain",
        engine.ALONG_DIRECTION,
    ),
    _quantity(
        "deviation-largest",
        "Variation of the largest strain",
        "Standard deviation over all states: where it is large, a cord has a signal",
        "deviation",
        engine.VARIANCE_OF_LARGEST,
    ),
    _quantity(
        "deviation-along",
        "Variation along a direction",
        "Standard deviation over all states of the strain along a direction",
        "deviation",
        engine.VARIANCE_ALONG_DIRECTION,
    ),
    _quantity(
        "next-cord",
        "Decrease of the expected error",
        "By how much one more cord through a point would lower the expected error",
        "gain",
        engine.NEXT_CORD,
    ),
)
QUANTITIES = {shown.info.name: shown for shown in _SHOWN}
COLOR_MAPS = [
    ColorMap(name=name, colors=[list(color) for color in anchors], is_diverging=is_diverging)
    for name, anchors, is_diverging in (
        ("strain", colors.DIVERGING, True),
        ("deviation", colors.CIVIDIS, False),
        ("gain", colors.VIRIDIS, False),
    )
]
UNKNOWN_COLOR = list(colors.UNKNOWN_COLOR)
