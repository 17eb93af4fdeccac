"""Build a layout on trial: its parts, its cords as built in, and what these sense."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import arc_lengths, resample, sample_path
from ...core.device.device import Device, Sensor
from ...core.device.materials import find_silicone
from ...core.errors import DeviceError, FabricationError
from ...core.mesh import Surface
from ...core.progress import Report
from ...geometry.bodies.regions import KEPT_SPACING_MM, fill_region
from ...geometry.channels.channel_ends import Pockets
from ...geometry.channels.cord_channels import Channel, make_channels, make_trace_lines
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.moulds.records import MouldRules
from ...geometry.parts.parts import make_parts
from ...geometry.parts.printed_traces import TraceShape, make_printed
from ...geometry.parts.records import PartRules, PartSet
from ...sensing.built_cord import BuiltCord, required_prestretch
from ...sensing.response import mean_strain
from ..limits.verification import verify
from .assembly_effects import min_length_across_joint
from .design_task import DesignTask, layout_limits, length_beyond_path, pocket_diameter, wire_rules
from .predict import ScoredLayout, predict

MAX_ERROR_GROWTH = 1.05  # of the predicted error, accepted for the bends of wires
_TOLERANCE_MM = 0.05


def part_rules(device: Device, bay: Prism | None = None) -> PartRules:
    """Return the rules that the device's cord and process set for its parts.

    Args:
        device: The device.
        bay: Connector bay in which the wires end, if any.
    """
    f = device.fabrication
    relief = f.strain_relief is not False
    shapes = tuple(device.regions[name] for name in f.keep_whole)
    kept = tuple((fill_region(shape, KEPT_SPACING_MM), KEPT_SPACING_MM / 2) for shape in shapes)
    return PartRules(
        device.cord.diameter,
        device.channel_diameter,
        f.clearance,
        f.wall,
        f.limit_cuts,
        Pockets(
            pocket_diameter(device),
            device.cord.ferrule_length,
            wire_rules(device, relief, bay) if bay or relief else None,
            kept,
        )
        if f.pockets
        else None,
        f.marker_seats,
        f.marker_size,
        f.kind == "cast",
        min_length_across_joint(device),
        shapes,
    )


def trace_shape(device: Device) -> TraceShape:
    """Return the section of a device's printed traces, and the direction of printing."""
    trace, pad = device.cord.trace, device.pad
    assert trace is not None
    assert pad is not None
    return TraceShape(trace.width, trace.height, np.array(device.fabrication.up), pad)


def mould_rules(device: Device) -> MouldRules:
    """Return the rules that the process and the silicone set for moulds."""
    f = device.fabrication
    return MouldRules(wall=f.mould_wall, line=f.line, shrinkage=linear_shrinkage(device))


def linear_shrinkage(device: Device) -> float:
    """Return the linear shrinkage, as given or of the silicone; zero if neither is known."""
    shrinkage = device.fabrication.shrinkage
    if shrinkage is not None:
        return shrinkage
    silicone = find_silicone(device.material.name)
    return silicone.shrinkage if silicone else 0.0


def fabricate(
    device: Device,
    surface: Surface,
    sensors: Sequence[Sensor],
    report: Report,
    solid: Any = None,
    bay: Prism | None = None,
    channels: Sequence[Channel] | None = None,
) -> PartSet:
    """Make the parts of a device.

    Args:
        device: The device.
        surface: Its body's surface.
        sensors: The cords of the layout.
        report: Called with the share of the work done and a description.
        solid: CAD solid of the body, if any.
        bay: Connector bay, if any.
        channels: The cords' channels, if they are known.

    Raises:
        FabricationError: If a cord or a part fails a check.
    """
    violations = verify(sensors, surface, layout_limits(device)).violations
    if violations:
        raise FabricationError(
            violations[0].message,
            code=violations[0].code,
            cords=violations[0].cords,
            value=violations[0].value,
            at=list(violations[0].at),
        )
    rules = part_rules(device, bay)
    if device.cord.trace is not None:
        lines = channels or _channels(device, surface, sensors, bay)
        return make_printed(surface, lines, rules, trace_shape(device), report)
    parts = make_parts(surface, sensors, rules, report, solid, channels)
    for channel in parts.channels:
        stretched = float(arc_lengths(channel.sensing)[-1])
        if stretched < device.cord.min_stretch - _TOLERANCE_MM:
            f = device.fabrication
            if f.strain_relief is None and any(e.lead for c in parts.channels for e in c.ends):
                straight = replace(device, fabrication=replace(f, strain_relief=False))
                return fabricate(straight, surface, sensors, report, solid, bay)
            raise FabricationError(
                f"only {stretched:.1f} mm of it are stretched between its ends, less than the"
                f" {device.cord.min_stretch:g} mm of [cord] min_stretch",
                code="cord-stretch-too-short",
                where=f"cord {channel.name!r}",
                action=f"Make its path longer near {format_point(channel.ends[0].mouth)}",
                cord=channel.name,
                stretched=stretched,
                at=channel.ends[0].mouth.tolist(),
            )
    return parts


class StrainRelief(NamedTuple):
    """A decision about the strain relief of the wires.

    Attributes:
        device: The device with its strain relief decided.
        channels: The channels of its cords.
        notes: Notes about the decision.
    """

    device: Device
    channels: Sequence[Channel]
    notes: tuple[str, ...] = ()


def decide_strain_relief(
    device: Device,
    task: DesignTask,
    surface: Surface,
    sensors: Sequence[Sensor],
    bay: Prism | None,
) -> StrainRelief:
    """Decide about strain relief of the wires if the device leaves that open.

    Bends are omitted if their deeper pockets would cost too much accuracy on unseen states, leave
    too little cord to stretch, or require longer channels than allowed.

    Args:
        device: The device.
        task: Its design task.
        surface: Its body's surface.
        sensors: The cords of the layout.
        bay: Connector bay, if any.

    Raises:
        FabricationError: If a path cannot be a channel.
    """
    f = device.fabrication
    if f.strain_relief is not None or not f.pockets:
        return StrainRelief(device, _channels(device, surface, sensors, bay))
    options = []
    for relief in (False, True):
        changed = replace(device, fabrication=replace(f, strain_relief=relief))
        channels = _channels(changed, surface, sensors, bay)
        cords = built_cords(task, channels)
        error = predict(task, cords).prediction.unseen
        options.append((StrainRelief(changed, channels), cords, error))
    (straight, _, without), (bent, cords, with_bends) = options
    costs = []
    if with_bends > MAX_ERROR_GROWTH * without:
        costs.append(f"raise the predicted error from {without:.3g} to {with_bends:.3g} mm")
    if any(c.length < device.cord.min_stretch - _TOLERANCE_MM for c in cords):
        costs.append("leave too little cord to stretch")
    if not _keeps_limits(bent.device, surface, sensors):
        costs.append("require longer channels")
    if not costs:
        return bent
    note = (
        "wires leave by the cords' mouths, without a bend that relieves their joints, because the"
        f" deeper pockets would {' and '.join(costs)}. Set strain_relief = true in [fabrication] to"
        " make them"
    )
    return straight._replace(notes=(note,))


def _channels(
    device: Device, surface: Surface, sensors: Sequence[Sensor], bay: Prism | None
) -> Sequence[Channel]:
    trace = device.cord.trace
    if trace is not None:
        assert device.pad is not None
        return make_trace_lines(sensors, surface, trace.width, device.pad.depth)
    r = part_rules(device, bay)
    return make_channels(sensors, surface, r.channel, r.inner_wall, r.pockets)


def _keeps_limits(device: Device, surface: Surface, sensors: Sequence[Sensor]) -> bool:
    """Return whether the paths keep the limits of the device."""
    try:
        return not verify(sensors, surface, layout_limits(device)).violations
    except DeviceError:  # no length of channel is allowed at all
        return False


def built_cords(task: DesignTask, channels: Sequence[Channel]) -> list[BuiltCord]:
    """Return the cords in their channels, each between its ferrules or its free ends.

    A printed trace is strained, and conducts, along its whole line between the pads.
    """
    out = []
    for channel in channels:
        path = channel.sensing
        lead = task.fabrication.lead
        between = channel.length + sum(-e.pocket if e.pocket else lead for e in channel.ends)
        series = 0.0 if channel.is_trace else between - float(arc_lengths(path)[-1])
        out.append(_built(task, path, series))
    return out


def assumed_cords(task: DesignTask, sensors: Sequence[Sensor]) -> list[BuiltCord]:
    """Return the cords as the search assumes them to be built in, before channels are made."""
    out = []
    for sensor in sensors:
        path = sample_path(sensor)
        length = float(arc_lengths(path)[-1])
        hidden, series = assumed_ends(task, length)
        out.append(_built(task, resample(path, hidden, length - hidden, len(path)), series))
    return out


def assumed_ends(task: DesignTask, length: float) -> tuple[float, float]:
    """Return the assumed ends of a path.

    Args:
        task: The design task.
        length: Length of the path, mm.

    Returns:
        The length (mm) in a pocket at each end, and the total length (mm) of cord beyond the path.
    """
    hidden = task.design.sense.hidden
    return min(hidden, 0.45 * length), length_beyond_path(task.fabrication, task.reading)


def _built(task: DesignTask, path: Float, series: float) -> BuiltCord:
    f = task.fabrication
    if f.assembly == "bonded":
        return BuiltCord(path, max(series, 0.0), None)
    prestretch = f.prestretch
    if prestretch is None:
        prestretch = prestretch_for(mean_strain(path, task.everything.deform(path)))
    return BuiltCord(path, max(series, 0.0), prestretch)


def prestretch_for(strain: Float) -> float:
    """Return the pre-stretch of a held cord for the body's mean strains (s,) along it."""
    return required_prestretch(float(np.min(strain, initial=0.0)))


def score_paths(
    device: Device,
    task: DesignTask,
    surface: Surface,
    sensors: Sequence[Sensor],
    bay: Prism | None,
) -> ScoredLayout:
    """Predict what cords along paths would sense, with the ends of their channels.

    If no channel can be made, the ends are those that the search assumes.

    Args:
        device: The device.
        task: Its design task.
        surface: Its body's surface.
        sensors: The cords.
        bay: Connector bay, if any.
    """
    try:
        relief = decide_strain_relief(device, task, surface, sensors, bay)
        return score_channels(task, relief.channels)
    except FabricationError:
        return predict(task, assumed_cords(task, sensors))


def score_channels(task: DesignTask, channels: Sequence[Channel]) -> ScoredLayout:
    """Predict what the device senses with its cords as built in."""
    return predict(task, built_cords(task, channels))
