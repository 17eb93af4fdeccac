"""What the optimise stage works on, from the device and the files of the earlier stages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.device import DECODERS, Device
from ...core.errors import DeviceError
from ...core.mesh import Surface
from ...decoding.unseen import UnseenStates, unseen_states
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...optimize.problem.problem import Limits, Problem
from ...sensing.response import response_of
from ..artifacts.body import load_surface
from ..artifacts.fields import load_fields
from ..artifacts.mesh import load_mesh

#: Of every random choice of the design.
SEED = 1
#: Markers may lie this far outside, mm: tags have a thickness, meshes a deviation.
_OFF_BODY = 1.0


def limits(device: Device) -> Limits:
    """What the cords of a device must keep, mm."""
    channel, wall = device.channel_diameter, device.fabrication.wall
    shortest, longest = (n - 2 * device.fabrication.lead for n in device.cord.lengths)
    return Limits(
        wall,
        device.cord.min_bend_radius,
        channel + wall,
        channel,
        shortest=max(shortest, 0.0),
        longest=longest,
    )


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
    """Every state of the device, `names` (n,) with rest first, and which are `held_out` (n,): the
    layout is to be designed on the others. Marker positions `points` (k, 3) mm."""

    everything: Problem
    design: Problem
    names: tuple[str, ...]
    held_out: Bool
    points: Float

    @property
    def unseen(self) -> UnseenStates:
        """The states by which the design is judged."""
        return unseen_states(self.names, self.held_out)

    def decoded_by(self, kind: str) -> DesignTask:
        """The same for another decoder."""
        both = self.everything.decoded_by(kind), self.design.decoded_by(kind)
        return replace(self, everything=both[0], design=both[1])


def load_task(device: Device, folder: Path) -> DesignTask:
    """What there is to optimise, from the files of the earlier stages."""
    surface = load_surface(folder)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    found = load_fields(folder)
    points, weights = markers(device, surface, locator)
    moved = locator.displacement(locator.find(points), found.displacements)
    everything = Problem(
        surface,
        locator,
        found.displacements,
        np.concatenate([np.zeros((1, *points.shape)), moved]),
        weights,
        response_of(device.cord.response),
        device.cord.noise,
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
    return DesignTask(everything, design, names, held_out, points)
