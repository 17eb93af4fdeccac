"""Repair drawn cords before a search starts from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ...core.device.device import Device
from ...optimization.limits.verification import verify
from ...optimization.prediction.design_task import DesignTask
from ...optimization.refinement.refine import require_drawing
from ...optimization.refinement.repair import repair_layout
from .stages import Report


def repair_drawing(
    device: Device, task: DesignTask, report: Report
) -> tuple[Device, Mapping[str, float]]:
    """Repair drawn cords that break a limit and whose paths are free.

    Returns:
        The device with the repaired cords, which a search can start from, and how far each of them
        moved at most, mm, by name.

    Raises:
        LayoutError: A limit stays broken, or the cord that breaks it may not move.
    """
    problem = task.design
    if not verify(device.sensors, problem.surface, problem.limits).violations:
        return device, {}
    report(0.0, f"repairing {device.cord.noun}s that break a limit")
    movable = [s.name for s in device.sensors if "path" in s.free]
    found = repair_layout(
        device.sensors,
        problem.surface,
        problem.limits,
        names=movable,
        keeps_freedoms=True,
        depth=problem.depth,
    )
    require_drawing(problem, found.sensors)
    return replace(device, sensors=found.sensors), found.moves


def describe_repairs(device: Device, repairs: Mapping[str, float], how: str) -> list[str]:
    """Return a sentence on each repaired cord; `how` is as in `LayoutRecord.continued`."""
    start = "" if how else ", from where the search started"
    return [
        f"The drawn {device.cord.noun} {name!r} breaks a limit. Its repair moves it by up to"
        f" {move:.2f} mm{start}."
        for name, move in repairs.items()
    ]
