"""The edit that moves cords, regions and poses with the bounding box of the body."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ...core.device.device import Device
from ...workflow.design.body_fit import BoxMap
from .cords import set_path, set_plane
from .edit import Edit, combine
from .pose_loads import set_pivot, set_pull
from .regions import set_shape


def fit_to_body(device: Device, box_map: BoxMap, names: Collection[tuple[str, str]]) -> Edit:
    """Move cords, regions, and the points of poses, in one step of undo.

    Args:
        device: The device.
        box_map: Maps the bounding box of the earlier body to that of the new one.
        names: Kind and name of each cord ("cord"), region ("region") and pose ("pose") that moves.
    """
    edits = list[Edit]()
    for sensor in device.sensors:
        if ("cord", sensor.name) in names:
            moved = box_map.cord(sensor)
            if moved.curve.is_planar:
                edits.append(set_plane(sensor.name, moved.plane))
            edits.append(set_path(sensor.name, moved.curve))
    for name, shape in device.regions.items():
        if ("region", name) in names:
            edits.append(set_shape(name, box_map.region(shape)))
    for pose in device.poses:
        if ("pose", pose.name) in names:
            edits += [
                set_pivot(pose.name, handle.region, box_map.point(handle.about).tolist())
                for handle in pose.handles
                if handle.about is not None and not np.isnan(handle.rotation).any()
            ]
            moved_pulls = [box_map.pull(drag) for drag in pose.drags]
            edits += [
                set_pull(pose.name, k, drag.at.tolist(), drag.by.tolist(), drag.stiffness)
                for k, drag in enumerate(moved_pulls)
            ]
    return combine("fit cords, regions and poses to the body", edits)
