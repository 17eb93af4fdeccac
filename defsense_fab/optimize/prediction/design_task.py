"""What the optimise stage works on, from the device and the files of the earlier stages."""

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
from ...geometry.channels.wire_channels import Wires
from ...geometry.kernels.cutting_tools import Prism
from ...mechanics.elements.point_location import PointLocator
from ...sensing.built_cord import CordReading, held_response, taut_response
from ...store.build import Build
from ..problem.cord_signals import SignalModel
from ..problem.problem import Limits, Problem
from ..studies.tolerance_monte_carlo import Tolerances

#: Of markers, of devices as built, and of whatever is found beside the search, which has its own.
SEED = 1
#: Pieces of cord are longer by this much than needed, mm: they are trimmed as they are laid.
SLACK = 5.0
#: Markers may lie this far outside, mm: tags have a thickness, meshes a deviation.
_OFF_BODY = 1.0
#: Until it is known how far a held cord must be stretched as it is laid, and how far a path's end
#: lies below the skin, mm.
_PRESTRETCH, _INLET = 0.06, 2.0


def limits(device: Device) -> Limits:
    """What the cords of a device must keep, mm. Raises DeviceError where no length is left."""
    channel, wall = device.channel_diameter, device.fabrication.wall
    shallow = pocket_depth(device, bends=device.fabrication.strain_relief is True)
    given = device.fabrication.prestretch
    # A piece reaches as far as it is stretched, which is not known yet where it is not given.
    likely = _PRESTRETCH if device.fabrication.assembly == "held" else 0.0
    stretches = (likely, 0.0) if given is None else (given, given)
    shortest, longest = (
        _channel_of(device, piece, shallow, stretch)
        for piece, stretch in zip(device.cord.lengths, stretches, strict=True)
    )
    least = max(shortest, device.cord.min_stretch + 2 * shallow)
    if longest < least + 1:
        raise DeviceError(
            f"device.toml: cord.length: pieces of up to {device.cord.lengths[1]:g} mm reach through"
            f" channels of {longest:.1f} mm, and {least:.1f} mm are needed for [cord] min_stretch"
            f" ({device.cord.min_stretch:g} mm) and two ends; use longer pieces, a smaller"
            " min_stretch, or strain_relief = false in [fabrication]"
        )
    return Limits(
        wall,
        device.cord.min_bend_radius,
        channel + wall,
        channel,
        shortest=least,
        longest=longest,
        pocket=(_likely_depth(device), pocket_diameter(device)),
    )


def wires(device: Device, relief: bool, bay: Prism | None = None) -> Wires:
    """The wires from the device's cords to the `bay`, or by a bend to the skin."""
    f = device.fabrication
    return Wires(f.wire_diameter, f.wire_diameter + f.clearance, bay, relief)


def pocket_depth(device: Device, bends: bool) -> float:
    """How deep the pockets of the cords' ends are, mm, with `bends` for their wires; 0: none."""
    f = device.fabrication
    if not f.pockets:
        return 0.0
    return device.cord.ferrule_length + (wires(device, relief=True).room(f.wall) if bends else 0.0)


def _likely_depth(device: Device) -> float:
    """That of most pockets: bends are left out only where they cost too much."""
    return pocket_depth(device, bends=device.fabrication.strain_relief is not False)


def _channel_of(device: Device, piece: float, pocket: float, stretch: float) -> float:
    """How long a channel a piece of cord reaches through, mm, stretched by so much (a strain)
    between its ends, which lie in pockets so deep or hang out: a ferrule's half at either end and
    the slack are cut besides."""
    beyond = 0.0 if pocket else 2 * device.fabrication.lead
    between = piece - device.cord.ferrule_length - SLACK - beyond
    return between * (1 + stretch) + 2 * pocket


def pocket_diameter(device: Device) -> float:
    """Of the pockets of the cords' ends, mm."""
    clearance = device.fabrication.clearance
    return max(device.cord.ferrule_diameter + clearance, device.channel_diameter + 0.1)


def sensing(device: Device) -> tuple[SignalModel, float]:
    """How the device's cords sense as far as that is known before they have ends, and the noise of
    (R - R0)/R0 of a long one."""
    reading, f = CordReading.from_device(device), device.fabrication
    response, scale = reading.response, 1.0
    if f.assembly == "held":
        p = _PRESTRETCH if f.prestretch is None else f.prestretch
        found = taut_response if f.prestretch is None else held_response
        response = found(reading.response, p)
        scale = (1 + float(reading.response(np.array(p)))) / (1 + p)
    pocket = _likely_depth(device)
    joints = np.sqrt(2) * reading.contact / (reading.ohm_per_mm * reading.relative)
    model = SignalModel(
        response,
        local=f.assembly == "bonded",
        hidden=max(pocket - _INLET, 0.0),
        series=beyond_path(f) / scale,
        contact=float(joints) / scale,
    )
    return model, reading.relative


def beyond_path(fabrication: FabricationSpec) -> float:
    """How much cord there is beyond both ends of a path where no pockets end it, mm."""
    return 0.0 if fabrication.pockets else 2 * (fabrication.lead + _INLET)


def tolerances_of(device: Device) -> Tolerances:
    """What the device's maker cannot hold, less what was measured of the cord."""
    found, cord = Tolerances(), device.cord
    if cord.compression == "measured":
        found = replace(found, compression=0.0)
    if cord.measured is not None:
        found = replace(found, gauge=cord.measured.spread)
    return found


def markers(device: Device, surface: Surface, locator: PointLocator) -> tuple[Float, Float]:
    """Marker positions (k, 3) mm in the rest frame and weights (k,) that sum to one."""
    spec = device.outputs.markers
    if isinstance(spec, np.ndarray):
        square = igl.point_mesh_squared_distance(spec, surface.vertices, surface.faces)[0]
        outside = np.where(locator.find(spec).depth < 0, np.sqrt(np.asarray(square)), 0.0)
        if outside.max() > _OFF_BODY:
            k = int(outside.argmax())
            raise DeviceError(
                f"device.toml: outputs.markers: point {k + 1} at {spec[k].tolist()} lies"
                f" {outside[k]:.2g} mm off the body; move it onto the surface"
            )
        return spec, np.full(len(spec), 1 / len(spec))
    dense = 4000 if spec == "surface" else max(4000, 4 * spec)
    points = surface.scatter(dense, np.random.default_rng(SEED))
    if spec == "surface":
        return points, np.full(dense, 1 / dense)
    return _farthest_points(points, spec), np.full(spec, 1 / spec)


def _farthest_points(points: Float, count: int) -> Float:
    """Farthest-point sampling: `count` of the points, evenly spread."""
    chosen = [int(np.linalg.norm(points - points.mean(0), axis=1).argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


@dataclass(frozen=True)
class DesignTask:
    """Every state of the device with rest first: `names` (n,), how much of each pose they have, and
    which are `held_out` (n,): the layout is to be designed on the others. Marker positions `points`
    (k, 3) mm; how the cords are read and built in."""

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
        """The states by which the design is judged."""
        return choose_unseen_states(self.weights, self.held_out)

    def with_decoder(self, kind: str) -> DesignTask:
        """The same for another decoder."""
        both = self.everything.with_decoder(kind), self.design.with_decoder(kind)
        return replace(self, everything=both[0], design=both[1])


def decoders(device: Device, task: DesignTask) -> tuple[str, ...]:
    """Those to choose from by their errors on unseen states. Where there are none, the affine map
    alone: the others fit the states exactly, and are far off beside them."""
    if device.decoder != "auto":
        return (device.decoder,)
    return DECODERS[:1] if task.unseen.how == NONE else DECODERS


def load_task(device: Device, build: Build) -> DesignTask:
    """Return what there is to optimize, from the simulated poses of a build."""
    surface, locator, found = build.surface, build.locator, build.fields
    points, weights = markers(device, surface, locator)
    moved = locator.displacement(locator.find(points), found.displacements)
    everything = Problem(
        surface,
        locator,
        found.displacements,
        np.concatenate([np.zeros((1, *points.shape)), moved]),
        weights,
        *sensing(device),
        limits(device),
        DECODERS[0] if device.decoder == "auto" else device.decoder,
    )
    seen = np.flatnonzero(~found.held_out)
    design = replace(
        everything,
        fields=found.displacements[seen],
        markers=everything.markers[np.append(0, seen + 1)],
    )
    names, held_out = ("rest", *found.names), np.append(False, found.held_out)
    reading = CordReading.from_device(device)
    return DesignTask(
        everything,
        design,
        names,
        ({}, *found.weights),
        held_out,
        points,
        reading,
        device.fabrication,
    )
