"""What can be looked at in a section, and how its numbers are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...optimize.prediction.body_section import Quantity
from .color_scale import Scale

_PERCENT = 100.0


@dataclass(frozen=True)
class Look:
    """A `quantity` of the body's stretch by its `label` in the list, and the words over its bar;
    without a quantity it is where the next cord would help."""

    label: str
    title: str
    quantity: Quantity | None = None

    @property
    def along(self) -> bool:
        """Whether it needs a direction."""
        return self.quantity is not None and self.quantity.kind == "along"

    @property
    def of_state(self) -> bool:
        """Whether it differs from state to state."""
        return self.quantity is not None and not self.quantity.variance

    @property
    def unit(self) -> str:
        """What stands behind the title."""
        if self.quantity is None:
            return "mm"
        return "square of stretch, no unit" if self.quantity.variance else "percent strain"

    def numbers(self, values: Float) -> Float:
        """What the bar has: strains in per cent of stretches, the rest as it is."""
        return _PERCENT * (values - 1) if self.of_state else values

    def scale(self, reach: float) -> Scale:
        """For values that reach so far, see `BodySection.spread`; not for the next cord."""
        if self.of_state:
            return Scale.about_zero(_PERCENT * reach)
        return Scale.spread(reach)


NEXT_CORD = Look("where a cord would help", "Drop of the expected error by one more cord")
LOOKS = (
    Look("stretch along a direction", "Stretch along the direction", Quantity("along")),
    Look("largest principal stretch", "Largest principal stretch", Quantity("largest")),
    Look("smallest principal stretch", "Smallest principal stretch", Quantity("smallest")),
    Look(
        "variance of stretch along a direction", "Variance over all states, along the direction",
        Quantity("along", variance=True),
    ),
    Look(
        "variance of largest stretch", "Variance over all states of the largest stretch",
        Quantity("largest", variance=True),
    ),
    NEXT_CORD,
)  # fmt: skip


def reach_words(look: Look, numbers: Float) -> str:
    """What the section has, for the note below the bar."""
    known = numbers[np.isfinite(numbers)]
    if not len(known):
        return "no number is known here"
    low, high = float(known.min()), float(known.max())
    if look.of_state:
        return f"in this section {_signed(low)} to {_signed(high)} %"
    unit = " mm" if look.quantity is None else ""
    return f"in this section {low:.3g} to {high:.3g}{unit}".replace("-", "\u2212")


def _signed(value: float) -> str:
    return f"{round(value, 1) + 0.0:+.1f}".replace("-", "\u2212")


def point_words(rest: Float, now: Float, stretches: dict[str, float], variance: float) -> str:
    """Markdown: what is known of a point that was clicked, rest and deformed positions (3,) mm."""
    lines = [f"Point at rest ({_place(rest)}) mm"]
    if np.linalg.norm(now - rest) > 5e-3:
        lines.append(f"here ({_place(now)}) mm")
    lines += [f"{name} {_signed(_PERCENT * (s - 1))} %" for name, s in stretches.items()]
    lines.append(
        f"over all states {_PERCENT * np.sqrt(variance):.1f} % standard deviation"
        f" (variance {variance:.2g})"
    )
    return "  \n".join(lines)


def _place(point: Float) -> str:
    return ", ".join(f"{x + 0.0:.1f}" for x in np.round(point, 1))
