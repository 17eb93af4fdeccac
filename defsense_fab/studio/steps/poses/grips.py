"""Grips: the places at which the user moves regions, their shapes, and pulled points of a pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device, Handle, Pose
from ....core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere

_PULL_PREFIX = "pull/"  # of the names of grips of pulled points


@dataclass(frozen=True)
class Grip:
    """A place that the user can drag or turn with a gizmo.

    Attributes:
        name: Name of the grip.
        position: Position (3,) mm.
        rotation: Rotation vector (3,) rad.
        can_shift: Whether it can be dragged.
        can_turn: Whether it can be turned.
    """

    name: str
    position: Float
    rotation: Float
    can_shift: bool
    can_turn: bool


#: Called with a grip's name, its position (3,) mm, its rotation vector (3,) rad, and whether the
#: user has released it.
GripCallback = Callable[[str, Float, Float, bool], None]


def pose_grips(
    pose: Pose, device: Device, points: Float, centers: Mapping[str, Float]
) -> list[Grip]:
    """Return the grips of a pose: one for each region that it moves and each point that it pulls.

    Args:
        pose: The pose.
        device: The device.
        points: Points (v, 3) mm of the surface at rest.
        centers: Centers (3,) mm of moved regions in the solved pose, by region; they are used
            where the translation is free.
    """
    grips = []
    for handle in pose.handles:
        is_free = bool(np.isnan(handle.translation).any())
        position = rotation_center(handle, device, points)
        if is_free and handle.region in centers:
            position = centers[handle.region]
        else:
            position = position + np.nan_to_num(handle.translation)
        can_turn = not len(handle.free_axes)
        grips.append(Grip(handle.region, position, handle.rotation, not is_free, can_turn))
    for k, pull in enumerate(pose.drags):
        goal = pull.at + pull.by
        grips.append(Grip(f"{_PULL_PREFIX}{k}", goal, np.zeros(3), can_shift=True, can_turn=False))
    return grips


def rotation_center(handle: Handle, device: Device, points: Float) -> Float:
    """Return the point (3,) mm at rest about which a handle turns its region.

    Args:
        handle: The handle.
        device: The device.
        points: Points (v, 3) mm of the surface at rest.
    """
    if handle.about is not None:
        return handle.about
    shape = device.regions[handle.region]
    return shape_center(shape, points[shape.contains(points)])


def move_grip(
    pose: Pose, device: Device, points: Float, name: str, position: Float, rotation: Float
) -> Pose:
    """Return the pose after a grip was moved; the same pose if it no longer has the grip.

    Args:
        pose: The pose.
        device: The device.
        points: Points (v, 3) mm of the surface at rest.
        name: Name of the grip.
        position: Its new position (3,) mm.
        rotation: Its new rotation vector (3,) rad.
    """
    if name.startswith(_PULL_PREFIX):
        pulls = tuple(
            replace(pull, by=position - pull.at) if name == f"{_PULL_PREFIX}{k}" else pull
            for k, pull in enumerate(pose.drags)
        )
        return replace(pose, drags=pulls)
    handles = []
    for handle in pose.handles:
        moved = handle
        if handle.region == name:
            shift = position - rotation_center(handle, device, points)
            is_free = np.isnan(handle.translation).any()
            moved = replace(
                handle,
                rotation=handle.rotation if len(handle.free_axes) else rotation,
                translation=handle.translation if is_free else shift,
            )
        handles.append(moved)
    return replace(pose, handles=tuple(handles))


def shape_center(shape: Shape, points: Float) -> Float:
    """Return the center (3,) mm of a region.

    Args:
        shape: Shape of the region.
        points: Surface points (k, 3) mm in the region; without any, the shape's own center counts.
    """
    if len(points):
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)
    if isinstance(shape, Box):
        return np.asarray((shape.low + shape.high) / 2)
    if isinstance(shape, Sphere):
        return shape.center
    return shape.origin if isinstance(shape, HalfSpace) else (shape.start + shape.end) / 2


def shift_shape(shape: Shape, shift: Float) -> Shape:
    """Return a shape moved by a vector (3,) mm."""
    if isinstance(shape, Box):
        return Box(shape.low + shift, shape.high + shift)
    if isinstance(shape, Sphere):
        return Sphere(shape.center + shift, shape.radius)
    if isinstance(shape, HalfSpace):
        return HalfSpace(shape.origin + shift, shape.normal)
    return Cylinder(shape.start + shift, shape.end + shift, shape.radius)
