"""Requests that add, change and delete poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Handle, Pose
from ....core.errors import DeviceError, LayoutError
from ....workflow.design.region_points import points_in_regions
from ....workflow.view import Client, Request
from ...edits import pose_loads as loads
from ...edits.edit import combine, free_name
from ...edits.poses import (
    add_pose,
    drag_point,
    duplicate_pose,
    remove_pose,
    rename_pose,
    role_of,
    set_role,
)
from ...messages import pose_edits as messages
from ...session.device_session import DeviceSession
from ...session.step import Handler
from .grips import rotation_center, shape_center

_INITIAL_PULL = 0.15  # of a new pull, times the body's size
_TWIST_COSINE = 0.9  # of the angle between the axis of a twist and the line of both regions
_SAME_AXIS_COSINE = 0.9
_INITIAL_STIFFNESS = 1.0  # N/mm, the default of `poses.drags.stiffness`


class PoseRequests:
    """Handles requests about poses.

    Args:
        session: The device.
        points: Returns the points (v, 3) mm of the meshed surface; none without a mesh.
    """

    def __init__(self, session: DeviceSession, points: Callable[[], Float]) -> None:
        self._session, self._points = session, points

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that this object handles."""
        apply = self._session.apply
        return {
            messages.AddPose: self._add,
            messages.DuplicatePose: self._duplicate,
            messages.RenamePose: self._rename,
            messages.DeletePoses: self._delete,
            messages.SetRole: self._set_role,
            messages.SetTurn: self._set_turn,
            messages.SetShift: self._set_shift,
            messages.SetPivot: lambda _, r: apply(loads.set_pivot(r.pose, r.region, r.about)),
            messages.AddPull: self._add_pull,
            messages.SetPull: lambda _, r: apply(
                loads.set_pull(r.pose, r.index, r.at, r.by, r.stiffness)
            ),
            messages.DeletePull: lambda _, r: apply(loads.delete_pull(r.pose, r.index)),
            messages.SetPressure: lambda _, r: apply(loads.set_pressure(r.pose, r.region, r.value)),
            messages.SetSymmetry: lambda _, r: apply(
                loads.set_symmetry(r.pose, r.region, r.normal)
            ),
            messages.SetGravity: lambda _, r: apply(
                loads.set_gravity(r.pose, finite_list(r.gravity, "gravity"))
            ),
        }

    def _add(self, _: Client, __: messages.AddPose) -> messages.PoseResult:
        device = self._session.device
        regions = list(device.regions)
        if len(regions) < 2:
            raise LayoutError(
                "a pose needs two regions: one to hold and one to move",
                code="regions-too-few",
                action="Add a region first",
            )
        held = device.outputs.anchor or regions[0]
        inside = points_in_regions(device.regions, self._points())
        others = [name for name in regions if name != held]
        separate = [name for name in others if not (inside[name] & inside[held]).any()]
        region = (separate or others)[-1]
        axis, motion = self._new_motion(held, region)
        name = self._free_name(motion)
        self._session.apply(add_pose(name, [held], region, axis))
        return messages.PoseResult(name=name)

    def _new_motion(self, held: str, region: str) -> tuple[Float, str]:
        """Return the axis (3,) of the first turn that no pose has, bends first, and its name."""
        device, points = self._session.device, self._points()
        base, moved = (
            shape_center(shape, points[shape.contains(points)])
            for shape in (device.regions[held], device.regions[region])
        )
        direction = np.abs(moved - base) / (np.linalg.norm(moved - base) or 1.0)
        turns = [h.rotation for pose in device.poses for h in pose.handles if h.region == region]
        order = np.argsort(direction, kind="stable")
        unused = [k for k in order if not any(_is_about(turn, k) for turn in turns)]
        k = (unused or order)[0]
        return np.eye(3)[k], "twist" if direction[k] > _TWIST_COSINE else "bend"

    def _duplicate(self, _: Client, request: messages.DuplicatePose) -> messages.PoseResult:
        name = self._free_name(request.pose)
        self._session.apply(duplicate_pose(request.pose, name))
        return messages.PoseResult(name=name)

    def _rename(self, _: Client, request: messages.RenamePose) -> None:
        name = request.name.strip()
        if name != request.pose:
            self._session.apply(rename_pose(request.pose, name))

    def _delete(self, _: Client, request: messages.DeletePoses) -> None:
        listed = ", ".join(f"`{name}`" for name in request.poses)
        edits = [remove_pose(name) for name in request.poses]
        self._session.apply(combine(f"delete {listed}", edits))

    def _set_role(self, _: Client, request: messages.SetRole) -> None:
        device, pose = self._session.device, self.pose(request.pose)
        if role_of(pose, request.region) == request.role:
            return
        shift = [0.0, 0.0, 0.0]
        handle = next((h for h in pose.handles if h.region == request.region), None)
        if handle is not None and request.center is not None:
            rest = rotation_center(handle, device, self._points())
            center = loads.finite(request.center, 3, "the center")
            shift = np.round(center - rest, 1).tolist()
        self._session.apply(set_role(pose.name, request.region, request.role, shift))

    def _set_turn(self, _: Client, request: messages.SetTurn) -> None:
        finite_list([request.degrees], "the angle", 1)
        self._handle(request.pose, request.region)
        self._session.apply(
            loads.set_turn(
                request.pose, request.region, request.turn, request.axis, request.degrees
            )
        )

    def _set_shift(self, _: Client, request: messages.SetShift) -> None:
        finite_list([value or 0.0 for value in request.shift], "the translation")
        self._session.apply(loads.set_translation(request.pose, request.region, request.shift))

    def _add_pull(self, _: Client, request: messages.AddPull) -> None:
        at = loads.finite(request.at, 3, "the point")
        normal = loads.finite(request.normal, 3, "the direction")
        length = float(np.linalg.norm(normal)) or 1.0
        by = np.round(_INITIAL_PULL * self._session.size * normal / length, 1)
        self._session.apply(drag_point(request.pose, np.round(at, 2), by, _INITIAL_STIFFNESS))

    def pose(self, name: str) -> Pose:
        """Return a pose of the device. Raises DeviceError."""
        for pose in self._session.device.poses:
            if pose.name == name:
                return pose
        raise DeviceError(
            f"there is no pose {name!r} any more", code="not-in-device", table="pose", name=name
        )

    def _handle(self, pose: str, region: str) -> Handle:
        for handle in self.pose(pose).handles:
            if handle.region == region:
                return handle
        raise DeviceError(
            f"the pose {pose!r} no longer moves {region!r}",
            code="region-not-moved",
            pose=pose,
            region=region,
        )

    def _free_name(self, name: str) -> str:
        return free_name(name, [pose.name for pose in self._session.device.poses])


def _is_about(turn: Float, axis: int) -> bool:
    """Return whether a rotation vector (3,) is mainly about a coordinate axis."""
    return bool(abs(turn[axis]) > _SAME_AXIS_COSINE * np.linalg.norm(turn))


def finite_list(values: list[float], what: str, count: int = 3) -> list[float]:
    """Return finite numbers. Raises DeviceError."""
    return [float(v) for v in loads.finite(values, count, what)]
