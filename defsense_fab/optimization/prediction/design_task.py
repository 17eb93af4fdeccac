"""Define the design task of a device from its simulated poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.device import DECODERS, Device, FabricationSpec
from ...core.errors import DeviceError
from ...core.mesh import Surface
from ...decoding.expected_errors import NONE, UnseenStates, choose_unseen_states
from ...geometry.bodies import regions
from ...geometry.channels.channel_ends import MAX_INLET_SLOPE
from ...geometry.channels.wire_channels import Wires
from ...geometry.kernels.cutting_tools import Prism
from ...mechanics.elements.point_location import PointLocator
from ...sensing.built_cord import CordReading, held_response, taut_response
from ...store.build import Build
from ..problem.cord_signals import SignalModel
from ..problem.problem import Limits, Problem
from ..studies.tolerance_monte_carlo import Tolerances

SEED = 1  # of markers, built devices and proposals; the search has its own seed
TRIM_SLACK_MM = 5.0  # extra length of a piece of cord, trimmed during assembly
_MAX_MARKER_OFFSET_MM = 1.0  # outside the body: tags have a thickness, meshes a deviation
_ASSUMED_PRESTRETCH = 0.06  # of held cords while it is unknown
_ASSUMED_INLET_MM = 2.0  # from a path's end to the surface while it is unknown


def layout_limits(device: Device) -> Limits:
    """Return what the cords of a device must keep.

    Raises:
        DeviceError: If no length of channel is allowed.
    """
    channel, wall = device.channel_diameter, device.fabrication.wall
    exits = tuple(device.regions[name] for name in device.exits)
    kept = tuple(device.regions[name] for name in device.fabrication.keep_whole)
    if device.cord.trace is not None:
        assert device.pad is not None
        radius, room = device.cord.min_bend_radius, device.pad.room
        shortest = device.cord.min_stretch + 2 * device.pad.depth
        # The wall around a pad is kept up to where required_depth no longer allows less.
        pad_end = ((wall + room / 2) / MAX_INLET_SLOPE, room)
        return Limits(
            wall,
            radius,
            channel + wall,
            channel,
            shortest=shortest,
            pocket=pad_end,
            is_cut=False,
            exits=exits,
            kept_whole=kept,
            pad=(room, device.pad.depth),
        )
    pocket = pocket_depth(device, bends=device.fabrication.strain_relief is True)
    prestretch = device.fabrication.prestretch
    # A piece reaches further when stretched; the pre-stretch is assumed unless it is given.
    assumed = _ASSUMED_PRESTRETCH if device.fabrication.assembly == "held" else 0.0
    stretches = (assumed, 0.0) if prestretch is None else (prestretch, prestretch)
    shortest, longest = (
        _channel_length(device, piece, pocket, stretch)
        for piece, stretch in zip(device.cord.lengths, stretches, strict=True)
    )
    min_length = max(shortest, device.cord.min_stretch + 2 * pocket)
    if longest < min_length + 1:
        raise DeviceError(
            f"pieces of up to {device.cord.lengths[1]:g} mm reach through channels of"
            f" {longest:.1f} mm, and {min_length:.1f} mm are needed for [cord] min_stretch"
            f" ({device.cord.min_stretch:g} mm) and two ends",
            code="cord-pieces-too-short",
            where="device.toml: cord.length",
            action="Use longer pieces, a smaller min_stretch, or strain_relief = false in"
            " [fabrication]",
            piece=device.cord.lengths[1],
            longest=longest,
            needed=min_length,
        )
    return Limits(
        wall,
        device.cord.min_bend_radius,
        channel + wall,
        channel,
        shortest=min_length,
        longest=longest,
        pocket=(_usual_pocket_depth(device), pocket_diameter(device)),
        exits=exits,
        kept_whole=kept,
    )


def check_exits(device: Device, surface: Surface) -> None:
    """Check that both ends of a cord have room on the skin in the regions of exits.

    Args:
        device: The device.
        surface: Surface of its body.

    Raises:
        DeviceError: The regions have no skin, or too little.
    """
    if not device.exits:
        return
    shapes = [device.regions[name] for name in device.exits]
    skin = np.concatenate([regions.sample_skin(shape, surface) for shape in shapes])
    limits = layout_limits(device)
    needed = limits.pad_to_pad if limits.pad[0] else limits.clearance
    # No two points of the skin are further apart than the diagonal of its bounds.
    extent = float(np.linalg.norm(np.ptp(skin, axis=0))) if len(skin) else 0.0
    if extent >= needed:
        return
    names = ", ".join(map(repr, device.exits))
    where, key = "device.toml: wires.exit", "wires.exit"
    if not len(skin):
        described = "; ".join(map(regions.describe_region, shapes))
        raise DeviceError(
            f"no skin of the body is in {names} ({described}), so nothing can leave the body there;"
            f" the body extends {regions.describe_extent(surface)}",
            code="exit-off-skin",
            where=where,
            action="Move or enlarge a region so that it contains skin, or name another one",
            key=key,
        )
    raise DeviceError(
        f"the skin in {names} is at most {extent:.1f} mm wide, and the ends of a"
        f" {device.cord.noun} need {needed:.1f} mm from each other",
        code="exit-too-small",
        where=where,
        action="Enlarge a region, or name another one",
        key=key,
        extent=extent,
        needed=needed,
    )


def wire_rules(device: Device, relief: bool, bay: Prism | None = None) -> Wires:
    """Return the rules for wires from the cords to a connector bay, or by a bend to the skin.

    Args:
        device: The device.
        relief: Whether wires bend to relieve their joints.
        bay: Connector bay, if any.
    """
    f = device.fabrication
    return Wires(f.wire_diameter, f.wire_diameter + f.clearance, bay, relief)


def pocket_depth(device: Device, bends: bool) -> float:
    """Return the depth (mm) of the pockets of the cords' ends, or of the pads of traces.

    It is zero if there are neither.

    Args:
        device: The device.
        bends: Whether the pockets hold bends of the wires.
    """
    f = device.fabrication
    if device.pad is not None:
        return device.pad.depth
    if not f.pockets:
        return 0.0
    return device.cord.ferrule_length + (
        wire_rules(device, relief=True).room(f.wall) if bends else 0.0
    )


def _usual_pocket_depth(device: Device) -> float:
    """Return the depth of most pockets, mm: bends are omitted only if they cost too much."""
    return pocket_depth(device, bends=device.fabrication.strain_relief is not False)


def _channel_length(device: Device, piece: float, pocket: float, stretch: float) -> float:
    """Return the length of channel (mm) that a stretched piece of cord reaches through.

    The ends lie in pockets of the given depth or hang out. Half a ferrule at each end and the slack
    are subtracted.
    """
    beyond = 0.0 if pocket else 2 * device.fabrication.lead
    between = piece - device.cord.ferrule_length - TRIM_SLACK_MM - beyond
    return between * (1 + stretch) + 2 * pocket


def pocket_diameter(device: Device) -> float:
    """Return the diameter (mm) of the pockets of the cords' ends."""
    clearance = device.fabrication.clearance
    return max(device.cord.ferrule_diameter + clearance, device.channel_diameter + 0.1)


def signal_model(device: Device) -> tuple[SignalModel, float]:
    """Return how the device's cords sense before their ends are known.

    Returns:
        The signal model, and the noise of (R - R0)/R0 of a long cord.
    """
    reading, f = CordReading.from_device(device), device.fabrication
    response, scale = reading.response, 1.0
    if f.assembly == "held":
        p = _ASSUMED_PRESTRETCH if f.prestretch is None else f.prestretch
        respond = taut_response if f.prestretch is None else held_response
        response = respond(reading.response, p)
        scale = (1 + float(reading.response(np.array(p)))) / (1 + p)
    pocket = _usual_pocket_depth(device)
    joints = np.sqrt(2) * reading.contact / (reading.ohm_per_mm * reading.relative)
    model = SignalModel(
        response,
        local=f.assembly == "bonded",
        hidden=max(pocket - _ASSUMED_INLET_MM, 0.0),
        series=length_beyond_path(f, reading) / scale,
        contact=float(joints) / scale,
        section=reading.section,
    )
    return model, reading.relative


def length_beyond_path(fabrication: FabricationSpec, reading: CordReading) -> float:
    """Return the length (mm) of unstrained cord beyond both ends of a path.

    It is zero with pockets and for printed traces, which are bonded up to their pads.
    """
    if fabrication.pockets or reading.section is not None:
        return 0.0
    return 2 * (fabrication.lead + _ASSUMED_INLET_MM)


def device_tolerances(device: Device) -> Tolerances:
    """Return the tolerances of built devices, reduced by what was measured of the cord.

    Gauge factors and resistances of printed traces differ by the spread of the filament.
    """
    tolerances, cord = Tolerances(), device.cord
    if cord.trace is not None:
        spread = cord.trace.spread
        tolerances = replace(tolerances, gauge=spread, resistance=spread)
    if cord.compression == "measured":
        tolerances = replace(tolerances, compression=0.0)
    if cord.measured is not None:
        tolerances = replace(tolerances, gauge=cord.measured.spread)
    return tolerances


def marker_points(device: Device, surface: Surface, locator: PointLocator) -> tuple[Float, Float]:
    """Return the positions of the markers at rest and their weights.

    Args:
        device: The device.
        surface: The body's surface.
        locator: Locator of its mesh.

    Returns:
        Positions (k, 3) mm in the rest frame and weights (k,) that sum to one.

    Raises:
        DeviceError: If a given marker lies off the body.
    """
    spec = device.outputs.markers
    if isinstance(spec, np.ndarray):
        square = igl.point_mesh_squared_distance(spec, surface.vertices, surface.faces)[0]
        outside = np.where(locator.find(spec).depth < 0, np.sqrt(np.asarray(square)), 0.0)
        if outside.max() > _MAX_MARKER_OFFSET_MM:
            k = int(outside.argmax())
            raise DeviceError(
                f"point {k + 1} at {spec[k].tolist()} lies {outside[k]:.2g} mm off the body",
                code="marker-off-body",
                where="device.toml: outputs.markers",
                action="Move it onto the surface",
                marker=k,
                distance=float(outside[k]),
            )
        return spec, np.full(len(spec), 1 / len(spec))
    dense = 4000 if spec == "surface" else max(4000, 4 * spec)
    points = surface.scatter(dense, np.random.default_rng(SEED))
    if spec == "surface":
        return points, np.full(dense, 1 / dense)
    return _farthest_points(points, spec), np.full(spec, 1 / spec)


def _farthest_points(points: Float, count: int) -> Float:
    """Choose `count` evenly spread points by farthest-point sampling."""
    chosen = [int(np.linalg.norm(points - points.mean(0), axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


@dataclass(frozen=True)
class DesignTask:
    """The states of a device, and what layouts are designed for and judged by.

    Attributes:
        everything: Problem with all states.
        design: Problem with the states that layouts are designed for.
        names: (n,) names of all states, rest first.
        weights: For each state the weight of each pose, by name.
        held_out: (n,), whether a state is excluded from the design.
        points: (k, 3) mm, positions of the markers at rest.
        reading: How the cords are read.
        fabrication: How they are built in.
    """

    everything: Problem
    design: Problem
    names: tuple[str, ...]
    weights: tuple[Mapping[str, float], ...]
    held_out: Bool
    points: Float
    reading: CordReading
    fabrication: FabricationSpec

    @property
    def unseen(self) -> UnseenStates:
        """States to train and to test on when layouts are judged."""
        return choose_unseen_states(self.weights, self.held_out)

    def with_decoder(self, kind: str) -> DesignTask:
        """Return the same task for another decoder."""
        both = self.everything.with_decoder(kind), self.design.with_decoder(kind)
        return replace(self, everything=both[0], design=both[1])


def candidate_decoders(device: Device, task: DesignTask) -> tuple[str, ...]:
    """Return the decoders to choose from by their errors on unseen states.

    Without unseen states it is only the affine map, because others fit the states exactly and are
    wrong in between.

    Args:
        device: The device.
        task: Its design task.
    """
    if device.decoder != "auto":
        return (device.decoder,)
    return DECODERS[:1] if task.unseen.how == NONE else DECODERS


def load_task(device: Device, build: Build) -> DesignTask:
    """Load the design task of a device from the simulated poses of its build.

    Args:
        device: The device.
        build: Its build.
    """
    surface, locator, fields = build.surface, build.locator, build.fields
    points, weights = marker_points(device, surface, locator)
    moved = locator.displacement(locator.find(points), fields.displacements)
    everything = Problem(
        surface,
        locator,
        fields.displacements,
        np.concatenate([np.zeros((1, *points.shape)), moved]),
        weights,
        *signal_model(device),
        layout_limits(device),
        DECODERS[0] if device.decoder == "auto" else device.decoder,
    )
    designed = np.flatnonzero(~fields.held_out)
    design = replace(
        everything,
        fields=fields.displacements[designed],
        markers=everything.markers[np.append(0, designed + 1)],
    )
    names, held_out = ("rest", *fields.names), np.append(False, fields.held_out)
    reading = CordReading.from_device(device)
    return DesignTask(
        everything,
        design,
        names,
        ({}, *fields.weights),
        held_out,
        points,
        reading,
        device.fabrication,
    )
