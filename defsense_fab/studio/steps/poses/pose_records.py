"""Regions and poses of a device as the page gets them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device, Handle, Pose
from ....core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere
from ....core.errors import DeviceError
from ....workflow.design.region_points import find_region_problems, points_in_regions
from ...edits.pose_loads import finite
from ...edits.poses import role_of
from ...messages import poses as messages
from ...session.cord_states import rounded
from .grips import rotation_center, shape_center

#: Colors of regions in their order: pale ones, as those of cords are strong (light of Tol, 2021).
REGION_COLORS = ("#eedd88", "#99b8dd", "#bbcc77", "#ffaabb", "#77cfbe", "#ee9f78", "#c4b0dc")
_MIN_ANGLE_RAD = 1e-6
_AXIS_TOLERANCE = 1e-9
_DIGEST_LENGTH = 16
_KINDS: dict[type, messages.ShapeKind] = {
    Box: "box",
    Sphere: "sphere",
    HalfSpace: "half-space",
    Cylinder: "cylinder",
}


def region_states(device: Device, points: Float) -> list[messages.RegionState]:
    """Return the regions of a device.

    Args:
        device: The device.
        points: Points (v, 3) mm of the surface at rest; none while the body has no mesh.
    """
    held = points_in_regions(device.regions, points)
    problems = find_region_problems(held) if len(points) else {}
    return [
        messages.RegionState(
            name=name,
            color=REGION_COLORS[k % len(REGION_COLORS)],
            shape=_KINDS[type(shape)],
            points=rounded(np.array(shape_points(shape))),
            radius=shape.radius if isinstance(shape, Sphere | Cylinder) else 0.0,
            center=rounded(shape_center(shape, points[held[name]])),
            count=int(held[name].sum()),
            problems=[str(p).replace("`", "") for p in problems.get(name, [])],
            poses=[pose.name for pose in device.poses if uses_region(pose, name)],
        )
        for k, (name, shape) in enumerate(device.regions.items())
    ]


def pose_states(
    device: Device, points: Float, warnings: Mapping[str, messages.PoseWarning]
) -> list[messages.PoseState]:
    """Return the poses of a device.

    Args:
        device: The device.
        points: Points (v, 3) mm of the surface at rest; none while the body has no mesh.
        warnings: What was wrong with poses when they were solved, by their digests.
    """
    states = []
    for pose in device.poses:
        digest = pose_digest(pose, device)
        states.append(
            messages.PoseState(
                name=pose.name,
                roles=[role_of(pose, region) for region in device.regions],
                handles=[_handle_state(handle, device, points) for handle in pose.handles],
                pulls=[
                    messages.PullState(
                        at=rounded(pull.at), by=rounded(pull.by), stiffness=pull.stiffness
                    )
                    for pull in pose.drags
                ],
                pressures=[
                    messages.PressureState(region=p.region, value=p.value) for p in pose.pressures
                ],
                symmetry=[
                    messages.SymmetryState(region=s.region, normal=rounded(s.normal))
                    for s in pose.symmetry
                ],
                gravity=rounded(pose.gravity),
                picture=digest,
                warning=warnings.get(digest),
            )
        )
    return states


def uses_region(pose: Pose, region: str) -> bool:
    """Return whether a pose holds, moves or loads a region."""
    lists = (pose.handles, pose.symmetry, pose.pressures)
    return region in pose.fixed or any(row.region == region for rows in lists for row in rows)


def pose_digest(pose: Pose, device: Device) -> str:
    """Return a digest of everything that a pose's shape follows from, besides the mesh."""
    regions = {n: s for n, s in device.regions.items() if uses_region(pose, n)}
    content = repr((replace(pose, name=""), regions, device.material))
    return hashlib.sha256(content.encode()).hexdigest()[:_DIGEST_LENGTH]


def axis_and_degrees(rotation: Float) -> tuple[Float, float]:
    """Return the unit axis (3,) and the angle in degrees of a rotation vector (3,) rad.

    Of a coordinate axis the positive direction is returned.
    """
    angle = float(np.linalg.norm(rotation))
    if angle < _MIN_ANGLE_RAD:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis, degrees = rotation / angle, float(np.rad2deg(angle))
    main = int(np.abs(axis).argmax())
    if abs(axis[main]) > 1 - _AXIS_TOLERANCE:
        return np.eye(3)[main], degrees * float(np.sign(axis[main]))
    return axis, degrees


def shape_points(shape: Shape) -> tuple[Float, ...]:
    """Return the points and vectors of a shape, as `messages.poses.RegionState` has them."""
    if isinstance(shape, Box):
        return shape.low, shape.high
    if isinstance(shape, Sphere):
        return (shape.center,)
    if isinstance(shape, HalfSpace):
        return shape.origin, shape.normal
    return shape.start, shape.end


def make_shape(kind: messages.ShapeKind, points: Sequence[Sequence[float]], radius: float) -> Shape:
    """Return the shape with these points and radius, mm. Raises DeviceError."""
    count = 1 if kind == "sphere" else 2
    if len(points) != count or not np.isfinite(radius):
        raise DeviceError(f"a {kind} needs {count} points", code="region-shape")
    vectors = [finite(point, 3, f"a point of a {kind}") for point in points]
    if kind == "box":
        return Box(np.minimum(*vectors), np.maximum(*vectors))
    if kind == "sphere":
        return Sphere(vectors[0], radius)
    if kind == "half-space":
        return HalfSpace(*vectors)
    return Cylinder(vectors[0], vectors[1], radius)


def default_shape(kind: messages.ShapeKind, low: Float, high: Float) -> Shape:
    """Return a shape that holds the end of a body along its longest axis.

    Args:
        kind: Kind of the shape.
        low: Smallest coordinates (3,) of the body, mm.
        high: Largest coordinates (3,), mm.
    """
    size = high - low
    main = int(size.argmax())
    axis = np.eye(3)[main]
    depth = 0.1 * size[main]
    margin = 0.01 * size.max()
    middle = (low + high) / 2
    end = middle + axis * (high - middle)
    if kind == "half-space":
        return HalfSpace(np.round(end - depth * axis, 1), axis)
    across = float(np.linalg.norm(np.where(axis > 0, 0, size))) / 2 + margin
    if kind == "sphere":
        return Sphere(np.round(end, 1), round(across, 1))
    if kind == "cylinder":
        start, far = end - depth * axis, end + margin * axis
        return Cylinder(np.round(start, 1), np.round(far, 1), round(across, 1))
    corner = np.where(axis > 0, high - depth, low - margin)
    return Box(np.round(corner, 1), np.round(high + margin, 1))


def _handle_state(handle: Handle, device: Device, points: Float) -> messages.HandleState:
    axis, degrees = axis_and_degrees(handle.rotation)
    free = len(handle.free_axes)
    if free == 1:
        axis = handle.free_axes[0]
    return messages.HandleState(
        region=handle.region,
        turn="free" if free == 3 else "hinge" if free else "angle",
        axis=rounded(axis),
        degrees=round(degrees, 3),
        shift=[None if np.isnan(v) else round(float(v), 4) for v in handle.translation],
        about=None if handle.about is None else rounded(handle.about),
        center=rounded(rotation_center(handle, device, points)),
    )
