"""Find what of a device no longer fits its body, and fit it to the body."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.device.device import Device, PointDrag, Sensor
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere, inset
from ...core.mesh import Surface
from ...geometry.bodies.regions import EXIT_TOLERANCE_MM, sample_skin
from ...geometry.kernels.surface_queries import signed_distance_of
from ...optimization.limits.verification import LayoutCheck, verify
from ...optimization.limits.verification import LimitViolation as LimitViolation
from ...optimization.prediction.design_task import layout_limits
from ...optimization.refinement.repair import Repair, repair_layout

#: Limits that a cord breaks because the body is elsewhere.
OUTSIDE_CODES = ("path-leaves-body", "end-far-from-surface")
_MAX_PULL_HEIGHT_MM = 1.0  # of a pulled point above the skin: meshes deviate from the body
_SKIN_SAMPLES = 20_000
_MIN_COMMON_SHARE = 0.5  # of the skin in a region and in its place on the changed body, together

#: A cord, region or pose: what it is, and its name.
Kind = Literal["cord", "region", "pose"]
Item = tuple[Kind, str]


@dataclass(frozen=True)
class Misfit:
    """A cord, region or pose that does not fit the body.

    Attributes:
        kind: What it is; a pose has a pull outside the body.
        name: Its name.
        text: What is wrong, in one sentence.
        at: Where (3,), mm.
        is_outside: Whether it is outside of the body; otherwise it is in a wrong place inside.
    """

    kind: Kind
    name: str
    text: str
    at: tuple[float, float, float]
    is_outside: bool = True


def check_cords(device: Device, sensors: Sequence[Sensor], surface: Surface) -> LayoutCheck:
    """Measure cords in a body that need not be simulated, and find broken limits.

    Raises:
        DeviceError: No length of channel is allowed.
    """
    return verify(sensors, surface, layout_limits(device))


def skin_points(surface: Surface) -> Float:
    """Return the vertices of a surface and points spread over it, (n, 3) mm."""
    return np.concatenate(
        [surface.vertices, surface.scatter(_SKIN_SAMPLES, np.random.default_rng(0))]
    )


def find_misfits(
    device: Device,
    surface: Surface,
    check: LayoutCheck | None,
    maps: Mapping[Item, BoxMap] | None = None,
) -> list[Misfit]:
    """Return the cords, regions and pulls that do not fit a body.

    Args:
        device: The device.
        surface: Surface of the body.
        check: The cords as they were checked in this body, or None.
        maps: Maps from an earlier body, for what was made for it. Such a cord must keep all limits,
            and such a region must hold about the same part of the body as before.
    """
    maps = maps or {}
    return [
        *(_cord_misfits(check, maps) if check is not None else ()),
        *_region_misfits(device, surface, maps),
        *_pull_misfits(device, surface),
    ]


def fit_cords(
    device: Device,
    surface: Surface,
    names: Collection[str],
    maps: Mapping[Item, BoxMap],
    check_wanted: Callable[[], None] = lambda: None,
    limit_s: float = math.inf,
) -> Repair:
    """Move cords with the bounding box of the body, and repair the limits that they break there.

    Args:
        device: The device.
        surface: Surface of the body.
        names: Names of the cords; the others stay.
        maps: Maps from the earlier body, for the cords that were made for it.
        check_wanted: Called often; what it raises ends the repair.
        limit_s: Time after which the cords that were not reached are not repaired, s.

    Raises:
        DeviceError: No length of channel is allowed.
    """
    moved = []
    for sensor in device.sensors:
        box_map = maps.get(("cord", sensor.name)) if sensor.name in names else None
        moved.append(sensor if box_map is None else box_map.cord(sensor))
    limits = layout_limits(device)
    return repair_layout(
        moved, surface, limits, names=names, check_wanted=check_wanted, limit_s=limit_s
    )


class BoxMap:
    """Maps one box onto another, axis by axis.

    Args:
        before: Lowest and highest corner (2, 3), mm.
        after: The same of the other box.
    """

    def __init__(self, before: Float, after: Float) -> None:
        size = np.ptp(before, axis=0)
        self._scale: Float = np.where(size > 0, np.ptp(after, axis=0) / np.maximum(size, 1e-9), 1.0)
        self._before, self._after = before[0], after[0]

    def point(self, points: Float) -> Float:
        """Return mapped points (..., 3), mm."""
        return np.asarray(self._after + (points - self._before) * self._scale)

    def region(self, shape: Shape) -> Shape:
        """Return a mapped region; radii follow the mean scale across."""
        if isinstance(shape, Box):
            return Box(self.point(shape.low), self.point(shape.high))
        if isinstance(shape, Sphere):
            return Sphere(self.point(shape.center), shape.radius * float(self._scale.mean()))
        if isinstance(shape, HalfSpace):
            return HalfSpace(self.point(shape.origin), shape.normal / self._scale)
        axis = (shape.end - shape.start) / np.linalg.norm(shape.end - shape.start)
        across = float((1 - axis**2) @ self._scale / 2)
        return Cylinder(self.point(shape.start), self.point(shape.end), shape.radius * across)

    def cord(self, sensor: Sensor) -> Sensor:
        """Return a mapped cord; a planar one stays planar."""
        points, tangents = sensor.curve.points, sensor.curve.tangents
        if not sensor.curve.is_planar:
            curve = Hermite(self.point(points), tangents * self._scale)
            return replace(sensor, curve=curve)
        old = sensor.plane
        plane = Plane.from_normal(
            self.point(old.origin), old.normal / self._scale, old.axes[:, 0] * self._scale
        )
        world = self.point(old.to_world(points)) - plane.origin
        turned = (tangents @ old.axes[:, :2].T) * self._scale
        return replace(
            sensor,
            plane=plane,
            curve=Hermite((world @ plane.axes)[:, :2], (turned @ plane.axes)[:, :2]),
        )

    def pull(self, drag: PointDrag) -> PointDrag:
        """Return a pull at the mapped point."""
        return replace(drag, at=self.point(drag.at))


def _cord_misfits(check: LayoutCheck, maps: Mapping[Item, BoxMap]) -> list[Misfit]:
    found: dict[str, Misfit] = {}
    for violation in check.violations:
        is_outside = violation.code == OUTSIDE_CODES[0]
        for name in violation.cords:
            if violation.code in OUTSIDE_CODES or ("cord", name) in maps:
                misfit = Misfit("cord", name, str(violation), violation.at, is_outside)
                if name not in found or (is_outside and not found[name].is_outside):
                    found[name] = misfit
    return list(found.values())


def _region_misfits(device: Device, surface: Surface, maps: Mapping[Item, BoxMap]) -> list[Misfit]:
    low, high = surface.bounds
    found = []
    for name, shape in device.regions.items():
        box_map = maps.get(("region", name))
        if not len(sample_skin(shape, surface)):
            text, is_outside = f"{name} holds no point of the body", True
        elif box_map is not None and not _hold_the_same(shape, box_map.region(shape), surface):
            text, is_outside = f"{name} holds another part of the body than before", False
        else:
            continue
        at = _place(np.clip(_middle(shape), low, high))
        found.append(Misfit("region", name, text, at, is_outside))
    return found


def _hold_the_same(some: Shape, other: Shape, surface: Surface) -> bool:
    """Return whether two regions hold about the same part of the skin."""
    skin = surface.scatter(_SKIN_SAMPLES, np.random.default_rng(0))
    a, b = (inset(shape, skin)[0] > -EXIT_TOLERANCE_MM for shape in (some, other))
    return bool((a & b).sum() >= _MIN_COMMON_SHARE * (a | b).sum())


def _pull_misfits(device: Device, surface: Surface) -> list[Misfit]:
    found = []
    for pose in device.poses:
        if not pose.drags:
            continue
        points = np.array([drag.at for drag in pose.drags])
        depth = signed_distance_of(surface)(points)
        if depth.min() < -_MAX_PULL_HEIGHT_MM:
            text = f"{pose.name} pulls at a point outside the body"
            found.append(Misfit("pose", pose.name, text, _place(points[int(depth.argmin())])))
    return found


def _middle(shape: Shape) -> Float:
    if isinstance(shape, Box):
        return (shape.low + shape.high) / 2
    if isinstance(shape, Sphere):
        return shape.center
    return shape.origin if isinstance(shape, HalfSpace) else (shape.start + shape.end) / 2


def _place(point: Float) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
