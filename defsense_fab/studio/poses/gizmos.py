"""What hands take hold of in the scene: regions of a pose, points that are pulled, shapes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.camera import rotation_matrices
from ...core.device.device import Device, Handle, Pose
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere
from ..edits.edit import Edit
from ..edits.poses import move_drag, shift_handle, turn_handle

# Gizmos of a pose, and what a pose is once a hand has moved one.

_PULL = "pull"
_TURNED, _SHIFTED = np.deg2rad(0.05), 0.05  # rad, mm: less is no change


def grips_of(pose: Pose, device: Device, points: Float, found: Mapping[str, Float]) -> list[Grip]:
    """At the centre of each region that the pose moves, and at what each point is pulled to;
    `points` (v, 3) mm of the surface at rest; `found` says where the solver has centres (3,)."""
    out = []
    for h in pose.handles:
        free = np.isnan(h.translation)
        place = center(h, device, points)
        if free.any() and h.region in found:
            place = found[h.region]
        else:
            place = place + np.nan_to_num(h.translation)
        out.append(Grip(h.region, place, h.rotation, not free.any(), not len(h.free_axes)))
    for k, d in enumerate(pose.drags):
        out.append(Grip(f"{_PULL}/{k}", d.at + d.by, np.zeros(3), shifts=True, turns=False))
    return out


def center(handle: Handle, device: Device, points: Float) -> Float:
    """What a region turns about, (3,) mm at rest."""
    if handle.about is not None:
        return handle.about
    shape = device.regions[handle.region]
    return middle(shape, points[shape.contains(points)])


def with_grip(
    pose: Pose, device: Device, points: Float, name: str, position: Float, rotation: Float
) -> Pose:
    """The pose as a hand has it that holds a gizmo by name; as it was where that is gone."""
    if name.startswith(f"{_PULL}/"):
        drags = tuple(
            replace(d, by=position - d.at) if name == f"{_PULL}/{k}" else d
            for k, d in enumerate(pose.drags)
        )
        return replace(pose, drags=drags)
    handles = []
    for h in pose.handles:
        new = h
        if h.region == name:
            shift = position - center(h, device, points)
            translation = h.translation if np.isnan(h.translation).any() else shift
            turn = h.rotation if len(h.free_axes) else rotation
            new = replace(h, rotation=turn, translation=translation)
        handles.append(new)
    return replace(pose, handles=tuple(handles))


def edits_of(before: Pose, after: Pose) -> list[Edit]:
    """What is to be written for it."""
    out: list[Edit] = []
    for a, b in zip(before.handles, after.handles, strict=True):
        axis, degrees = tidy(b.rotation)
        if np.linalg.norm(axis * np.deg2rad(degrees) - a.rotation) > _TURNED:
            out.append(turn_handle(before.name, a.region, axis, degrees))
        shift = b.translation - a.translation
        if np.abs(np.nan_to_num(shift)).max() > _SHIFTED:
            to = [round(v, 1) for v in b.translation.tolist()]
            out.append(shift_handle(before.name, a.region, to))
    for p, q in zip(before.drags, after.drags, strict=True):
        if np.abs(q.by - p.by).max() > _SHIFTED:
            out.append(move_drag(before.name, p.at, np.round(q.by, 1)))
    return out


def middle(shape: Shape, points: Float) -> Float:
    """Where a region is taken hold of, (3,) mm: amid the points (k, 3) that it holds, or where its
    shape is, where it holds none."""
    if len(points):
        return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)
    if isinstance(shape, Box):
        return np.asarray((shape.low + shape.high) / 2)
    if isinstance(shape, Sphere):
        return shape.center
    return shape.origin if isinstance(shape, HalfSpace) else (shape.start + shape.end) / 2


def shifted(shape: Shape, by: Float) -> Shape:
    """A shape elsewhere by (3,) mm."""
    if isinstance(shape, Box):
        return Box(shape.low + by, shape.high + by)
    if isinstance(shape, Sphere):
        return Sphere(shape.center + by, shape.radius)
    if isinstance(shape, HalfSpace):
        return HalfSpace(shape.origin + by, shape.normal)
    return Cylinder(shape.start + by, shape.end + by, shape.radius)


_SIZE = 0.22  # of the body


@dataclass(frozen=True)
class Grip:
    """One gizmo: what it is called, where it is (3,) mm, its rotation vector (3,) rad, and whether
    it can be shifted and turned."""

    name: str
    position: Float
    rotation: Float
    shifts: bool
    turns: bool


#: Called with a grip's name, where a hand has it (3,) mm, its rotation vector (3,) rad, and whether
#: the hand has let go.
Moved = Callable[[str, Float, Float, bool], None]


class Gizmos:
    """In a viser server's scene. A gizmo that stays is moved and not made anew, so that one person
    keeps hold of it while another lets go."""

    def __init__(self, server: Any, size: float, moved: Moved) -> None:
        """For a body of a `size` mm."""
        self._scene, self._size, self._moved = server.scene, size, moved
        self._made: dict[tuple[str, bool, bool], Any] = {}
        self._turned: dict[str, Float] = {}  # rotation vectors, which count whole turns

    def place(self, grips: Sequence[Grip]) -> None:
        """These, and no others."""
        wanted = {(g.name, g.shifts, g.turns): g for g in grips if g.shifts or g.turns}
        for key in [key for key in self._made if key not in wanted]:
            self._made.pop(key).remove()
        for key, grip in wanted.items():
            self._turned[grip.name] = grip.rotation
            if key not in self._made:
                self._made[key] = self._add(grip)
            gizmo = self._made[key]
            gizmo.position, gizmo.wxyz = tuple(grip.position.tolist()), quaternion(grip.rotation)

    def _add(self, grip: Grip) -> Any:
        gizmo = self._scene.add_transform_controls(
            f"/grips/{grip.name}", scale=_SIZE * self._size, line_width=3.0, depth_test=False,
            disable_axes=not grip.shifts, disable_sliders=not grip.shifts,
            disable_rotations=not grip.turns, position=tuple(grip.position.tolist()),
            wxyz=quaternion(grip.rotation),
        )  # fmt: skip

        async def moved(event: Any) -> None:  # in their order, which threads would not keep
            if event.phase == "end":  # it is written: that takes a while
                await asyncio.to_thread(self._dragged, event, grip.name)
            else:
                self._dragged(event, grip.name)

        gizmo.on_update(moved)
        return gizmo

    def _dragged(self, event: Any, name: str) -> None:
        if event.client is None and event.client_id is None:  # set by the page itself
            return
        near = self._turned.get(name, np.zeros(3))
        rotation = rotation_vector(np.asarray(event.target.wxyz, float), near)
        self._turned[name] = rotation
        position = np.asarray(event.target.position, float)
        self._moved(name, position, rotation, event.phase == "end")


def quaternion(rotation: Float) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation vector (3,) rad."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation_matrices(rotation)).as_quat().tolist()
    return w, x, y, z


def rotation_vector(wxyz: Float, near: Float) -> Float:
    """Of a quaternion w, x, y, z, the vector (3,) rad that is nearest to another, so that a hand
    may turn on beyond half a turn."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    vector = Rotation.from_quat([x, y, z, w]).as_rotvec()
    angle = float(np.linalg.norm(vector))
    size = float(np.linalg.norm(near))
    if angle < 1e-9:
        if size < np.pi:
            return np.zeros(3)
        return np.asarray(near / size * 2 * np.pi * round(size / (2 * np.pi)))
    axis = vector / angle
    turns = round((float(near @ axis) - angle) / (2 * np.pi))
    return np.asarray(axis * (angle + 2 * np.pi * turns))


def tidy(rotation: Float) -> tuple[Float, float]:
    """Axis (3,) and degrees of a rotation vector as a person writes them: to a tenth of a degree,
    and about a coordinate axis where that is within a degree of it."""
    angle = float(np.linalg.norm(rotation))
    if angle < 1e-6:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis = rotation / angle
    main = int(np.abs(axis).argmax())
    degrees = round(float(np.rad2deg(angle)), 1)
    if abs(axis[main]) > np.cos(np.deg2rad(1.0)):
        return np.eye(3)[main], degrees * float(np.sign(axis[main]))
    return axis, degrees
