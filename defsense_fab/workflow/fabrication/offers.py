"""The layouts that a build offers, one for each number of parts, with what they take to print."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.device.device import Device
from ...core.progress import describe_duration
from ...optimization.prediction.choose_layout import offered_layouts
from ...store.layout import LayoutRecord
from .effort import describe_count
from .print_time import print_hours


@dataclass(frozen=True)
class Offer:
    """A layout that can be built without another search.

    Attributes:
        parts: Number of parts.
        error: RMSE (mm) on unseen states as built.
        hours: Time to print all copies, h; None without an estimate.
        is_chosen: Whether it is the layout of the build.
    """

    parts: int
    error: float
    hours: float | None
    is_chosen: bool

    def describe(self) -> str:
        """Return the offer as in "5 parts, 0.49 mm, 18 h"."""
        time = "" if self.hours is None else f", {describe_duration(3600 * self.hours)}"
        return f"{describe_count(self.parts, 'part')}, {self.error:.2f} mm{time}"


def find_offers(device: Device, layout: LayoutRecord) -> tuple[Offer, ...]:
    """Return the layouts that a build offers, the one with the fewest parts first.

    Args:
        device: The device.
        layout: The layout of its build, with those that it was chosen from.

    Returns:
        The offers; fewer than two if there is no choice.
    """
    fabrication = device.fabrication
    return tuple(
        Offer(
            parts=record.parts or 0,
            error=record.designed if record.built is None else record.built,
            hours=print_hours(fabrication, record.pieces * fabrication.copies)
            if record.pieces
            else None,
            is_chosen=record.chosen,
        )
        for record in offered_layouts(layout.weighed, device.prefer)
    )
