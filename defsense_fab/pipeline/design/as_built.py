"""A layout as a device: its parts, and what its cords sense between their ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ...core.device import Device, Sensor
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import Pockets
from ...geometry.channels.cord_channels import Channel
from ...geometry.channels.wire_channels import Wires
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.parts.parts import make_parts
from ...geometry.parts.records import Made, Rules
from ...optimize.limits.verification import verify
from .design_task import DesignTask, limits
from .predict import Scored, predict

Report = Callable[[float, str], None]


def rules(device: Device, bay: Prism | None = None) -> Rules:
    """What the device's cord and process ask of its parts, whose wires end in the `bay`."""
    f = device.fabrication
    relief = f.strain_relief is not False
    wires = Wires(f.wire_diameter, f.wire_diameter + f.clearance, bay, relief)
    pocket = max(device.cord.ferrule_diameter + f.clearance, device.channel_diameter + 0.1)
    return Rules(
        device.cord.diameter,
        device.channel_diameter,
        f.clearance,
        f.wall,
        f.limit_cuts,
        Pockets(pocket, device.cord.ferrule_length, wires if bay or relief else None)
        if f.pockets
        else None,
        f.marker_seats,
        f.marker_size,
    )


def fabricate(
    device: Device,
    surface: Surface,
    sensors: Sequence[Sensor],
    report: Report,
    solid: Any = None,
    bay: Prism | None = None,
) -> Made:
    """The device's parts. Raises FabricationError where a cord or a part fails a check."""
    problems = verify(sensors, surface, limits(device)).problems
    if problems:
        raise FabricationError(problems[0])
    return make_parts(surface, sensors, rules(device, bay), report, solid)


def as_made(task: DesignTask, channels: Sequence[Channel]) -> Scored:
    """What the device is predicted to sense without the ends of cords that lie in pockets."""
    return predict(task, [c.sensing for c in channels])
