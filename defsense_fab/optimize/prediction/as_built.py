"""A layout as a device: its parts, its cords as they are built in, and what these sense."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import arc_lengths, resample, sample_path
from ...core.device.device import Device, Sensor
from ...core.device.materials import find_silicone
from ...core.errors import DeviceError, FabricationError
from ...core.mesh import Surface
from ...geometry.channels.channel_ends import Pockets
from ...geometry.channels.cord_channels import Channel, make_channels
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.moulds.records import MouldRules
from ...geometry.parts.parts import make_parts
from ...geometry.parts.records import PartRules, PartSet
from ...sensing.built_cord import BuiltCord, required_prestretch
from ...sensing.response import mean_strain
from ..limits.verification import verify
from .design_task import DesignTask, beyond_path, limits, pocket_diameter, wires
from .open_joints import least_across
from .predict import Scored, predict

Report = Callable[[float, str], None]
#: Predicted errors that grow by more than this with the bends of wires are worse.
WORSE = 1.05
_TOLERANCE = 0.05  # mm


def rules(device: Device, bay: Prism | None = None) -> PartRules:
    """What the device's cord and process ask of its parts, whose wires end in the `bay`."""
    f = device.fabrication
    relief = f.strain_relief is not False
    return PartRules(
        device.cord.diameter,
        device.channel_diameter,
        f.clearance,
        f.wall,
        f.limit_cuts,
        Pockets(
            pocket_diameter(device),
            device.cord.ferrule_length,
            wires(device, relief, bay) if bay or relief else None,
        )
        if f.pockets
        else None,
        f.marker_seats,
        f.marker_size,
        f.kind == "cast",
        least_across(device),
    )


def mould_rules(device: Device) -> MouldRules:
    """What the process and the silicone ask of moulds."""
    f = device.fabrication
    return MouldRules(wall=f.mould_wall, line=f.line, shrinkage=shrinkage(device))


def shrinkage(device: Device) -> float:
    """Linear, as given or by the silicone's row; none where neither is known."""
    given = device.fabrication.shrinkage
    if given is not None:
        return given
    known = find_silicone(device.material.name)
    return known.shrinkage if known else 0.0


def fabricate(
    device: Device,
    surface: Surface,
    sensors: Sequence[Sensor],
    report: Report,
    solid: Any = None,
    bay: Prism | None = None,
) -> PartSet:
    """The device's parts. Raises FabricationError where a cord or a part fails a check."""
    problems = verify(sensors, surface, limits(device)).violations
    if problems:
        raise FabricationError(
            problems[0].message,
            code=problems[0].code,
            cords=problems[0].cords,
            value=problems[0].value,
        )
    made = make_parts(surface, sensors, rules(device, bay), report, solid)
    for channel in made.channels:
        stretched = float(arc_lengths(channel.sensing)[-1])
        if stretched < device.cord.min_stretch - _TOLERANCE:
            f = device.fabrication
            if f.strain_relief is None and any(e.lead for c in made.channels for e in c.ends):
                straight = replace(device, fabrication=replace(f, strain_relief=False))
                return fabricate(straight, surface, sensors, report, solid, bay)
            raise FabricationError(
                f"cord {channel.name!r}: only {stretched:.1f} mm of it are stretched between its"
                f" ends, less than the {device.cord.min_stretch:g} mm of [cord] min_stretch; make"
                f" its path longer near {format_point(channel.ends[0].mouth)}"
            )
    return made


def with_relief(
    device: Device,
    task: DesignTask,
    surface: Surface,
    sensors: Sequence[Sensor],
    bay: Prism | None,
) -> tuple[Device, list[str]]:
    """The device with its strain relief decided where it leaves that open: bends are left out where
    the deeper pockets would cost too much accuracy on unseen states, leave too little to stretch,
    or ask for longer channels than there are, with a note.

    Raises FabricationError for a path that is no channel.
    """
    f = device.fabrication
    if f.strain_relief is not None or not f.pockets:
        return device, []
    found = []
    for relief in (False, True):
        changed = replace(device, fabrication=replace(f, strain_relief=relief))
        cords = built_cords(task, _channels(changed, surface, sensors, bay))
        found.append((changed, cords, predict(task, cords).prediction.unseen))
    (straight, _, without), (bent, cords, with_bends) = found
    costs = []
    if with_bends > WORSE * without:
        costs.append(f"raise the predicted error from {without:.3g} to {with_bends:.3g} mm")
    if any(c.length < device.cord.min_stretch - _TOLERANCE for c in cords):
        costs.append("leave too little cord to stretch")
    if not _allows(bent, surface, sensors):
        costs.append("ask for longer channels")
    if not costs:
        return bent, []
    return straight, [
        "wires leave by the cords' mouths, without a bend that relieves their joints: the deeper"
        f" pockets would {' and '.join(costs)}; strain_relief = true in [fabrication] makes them"
    ]


def _channels(
    device: Device, surface: Surface, sensors: Sequence[Sensor], bay: Prism | None
) -> Sequence[Channel]:
    r = rules(device, bay)
    return make_channels(sensors, surface, r.channel, r.inner_wall, r.pockets)


def _allows(device: Device, surface: Surface, sensors: Sequence[Sensor]) -> bool:
    """Whether the paths keep the limits of the device."""
    try:
        return not verify(sensors, surface, limits(device)).violations
    except DeviceError:  # no length is left at all
        return False


def built_cords(task: DesignTask, channels: Sequence[Channel]) -> list[BuiltCord]:
    """The cords in their channels: each between its ferrules, or its free ends."""
    out = []
    for channel in channels:
        path = channel.sensing
        lead = task.fabrication.lead
        between = channel.length + sum(-e.pocket if e.pocket else lead for e in channel.ends)
        out.append(_built(task, path, between - float(arc_lengths(path)[-1])))
    return out


def assumed_cords(task: DesignTask, sensors: Sequence[Sensor]) -> list[BuiltCord]:
    """The cords as the search assumes them to be built in, where their channels are not known."""
    out = []
    for sensor in sensors:
        path = sample_path(sensor)
        length = float(arc_lengths(path)[-1])
        hidden, series = assumed_ends(task, length)
        out.append(_built(task, resample(path, hidden, length - hidden, len(path)), series))
    return out


def assumed_ends(task: DesignTask, length: float) -> tuple[float, float]:
    """How much of a path of a `length` mm is assumed to lie in pockets at either end, and how much
    cord beyond it in all, mm."""
    hidden = task.design.sense.hidden
    return min(hidden, 0.45 * length), beyond_path(task.fabrication)


def _built(task: DesignTask, path: Float, series: float) -> BuiltCord:
    f = task.fabrication
    if f.assembly == "bonded":
        return BuiltCord(path, max(series, 0.0), None)
    prestretch = f.prestretch
    if prestretch is None:
        prestretch = prestretch_for(mean_strain(path, task.everything.deform(path)))
    return BuiltCord(path, max(series, 0.0), prestretch)


def prestretch_for(strain: Float) -> float:
    """How far a held cord is stretched as it is laid, by the body's mean strains (s,) along it."""
    return required_prestretch(float(np.min(strain, initial=0.0)))


def scored_by_paths(
    device: Device,
    task: DesignTask,
    surface: Surface,
    sensors: Sequence[Sensor],
    bay: Prism | None,
) -> Scored:
    """What cords along the paths would sense, with their ends as the channels would be made; as the
    search assumes them where there is no channel to be made."""
    try:
        device, _ = with_relief(device, task, surface, sensors, bay)
        return as_made(task, _channels(device, surface, sensors, bay))
    except FabricationError:
        return predict(task, assumed_cords(task, sensors))


def as_made(task: DesignTask, channels: Sequence[Channel]) -> Scored:
    """What the device is predicted to sense with its cords as they are built in."""
    return predict(task, built_cords(task, channels))
