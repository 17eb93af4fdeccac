"""Repair and smooth the cords of a device, in a body that need not be simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from ...core.curve import Hermite, catmull_rom
from ...core.device.device import Device, Sensor
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...optimization.limits.verification import verify
from ...optimization.limits.worsening import worsened_limits
from ...optimization.prediction.design_task import layout_limits
from ...optimization.refinement.repair import Repair, repair_layout


def repair_cords(
    device: Device,
    surface: Surface,
    names: Collection[str] | None = None,
    check_wanted: Callable[[], None] = lambda: None,
    limit_s: float = math.inf,
) -> Repair:
    """Repair the cords that break a limit; see `repair_layout`.

    Args:
        device: The device.
        surface: The body's surface.
        names: Names of the cords that may move; None for all.
        check_wanted: Called often; what it raises ends the repair.
        limit_s: Time after which the cords that were not reached stay as they are, s.

    Raises:
        LayoutError: None of the cords breaks a limit, or none can be improved (in this time).
        DeviceError: No length of channel is allowed.
    """
    limits = layout_limits(device)
    found = repair_layout(
        device.sensors, surface, limits, names=names, check_wanted=check_wanted, limit_s=limit_s
    )
    if found.moves:
        return found
    noun = device.cord.noun
    if not found.remaining:
        raise LayoutError(f"no {noun} breaks a limit", code="nothing-to-repair")
    if not found.is_complete:
        raise _takes_too_long(limit_s, f"Repair the {noun}s one by one, or draw new paths")
    broken = found.remaining[0]
    raise LayoutError(
        f"no path near the drawn one was found that keeps all limits: {broken}",
        code="repair-failed",
        action=f"Draw a new path, or move or delete a {noun}",
        cord=broken.cords[0],
        cords=found.unrepaired,
    )


@dataclass(frozen=True)
class SmoothCord:
    """A cord with tangents that follow from its points.

    Attributes:
        sensor: The cord.
        has_moved: Whether its points had to move to keep the limits.
    """

    sensor: Sensor
    has_moved: bool


def smooth_cord(
    device: Device,
    surface: Surface | None,
    name: str,
    check_wanted: Callable[[], None] = lambda: None,
    limit_s: float = math.inf,
) -> SmoothCord:
    """Smooth a cord so that no limit is broken that was kept, and none is broken more.

    Args:
        device: The device.
        surface: The body's surface; None if there is no body, and so no limit.
        name: Name of the cord.
        check_wanted: Called often; what it raises ends the work.
        limit_s: Time for moving control points, s.

    Raises:
        LayoutError: A limit would be broken, and moving the control points does not help (in this
            time).
    """
    k = [s.name for s in device.sensors].index(name)
    points = device.sensors[k].curve.points
    smooth = replace(device.sensors[k], curve=Hermite(points, catmull_rom(points)))
    if surface is None:
        return SmoothCord(smooth, has_moved=False)
    layout, limits = (*device.sensors[:k], smooth, *device.sensors[k + 1 :]), layout_limits(device)
    before = verify(device.sensors, surface, limits)
    if not worsened_limits(before, verify(layout, surface, limits), limits):
        return SmoothCord(smooth, has_moved=False)
    repaired = repair_layout(
        layout, surface, limits, names=[name], check_wanted=check_wanted, limit_s=limit_s
    )
    worse = worsened_limits(before, repaired.check, limits)
    if worse and not repaired.is_complete:
        raise _takes_too_long(limit_s, f"Repair the {device.cord.noun}s that break a limit first")
    if worse:
        raise LayoutError(
            f"a smooth path through these points breaks a limit: {worse[0]}",
            code="smooth-breaks-limit",
            action="Move or add control points first",
            cord=name,
            limit=worse[0].code,
        )
    return SmoothCord(repaired.sensors[k], has_moved=True)


def _takes_too_long(limit_s: float, action: str) -> LayoutError:
    message = f"no path that keeps all limits was found within {limit_s:g} s"
    return LayoutError(message, code="takes-too-long", action=action)
