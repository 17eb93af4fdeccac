"""The edit that fits cords, regions and poses to the body."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ...core.device.device import Device, Sensor
from ...workflow.design.body_fit import BoxMap, Item
from .cords import redraw
from .edit import Edit, combine
from .pose_loads import set_pivot, set_pull
from .regions import set_shape


def fit_to_body(
    device: Device,
    cords: Sequence[Sensor],
    maps: Mapping[Item, BoxMap],
    moved: Collection[Item],
) -> Edit:
    """Redraw cords, and move regions and the points of poses, in one step of undo.

    The pivots of a pose about a moved region move, too.

    Args:
        device: The device.
        cords: The cords that change, as they become.
        maps: Maps from the body that a region or pose was made for to the new one.
        moved: The regions and poses that move.
    """
    edits = [redraw(cord) for cord in cords]
    regions = [name for name in device.regions if ("region", name) in moved]
    edits += [set_shape(n, maps["region", n].region(device.regions[n])) for n in regions]
    poses = []
    for pose in device.poses:
        is_moved = ("pose", pose.name) in moved
        changes = list[Edit]()
        for handle in pose.handles:
            box_map = maps.get(("pose", pose.name), maps.get(("region", handle.region)))
            has_pivot = handle.about is not None and not np.isnan(handle.rotation).any()
            if has_pivot and box_map is not None and (is_moved or handle.region in regions):
                pivot = box_map.point(np.asarray(handle.about)).tolist()
                changes.append(set_pivot(pose.name, handle.region, pivot))
        if is_moved:
            pulls = [maps["pose", pose.name].pull(drag) for drag in pose.drags]
            changes += [
                set_pull(pose.name, k, drag.at.tolist(), drag.by.tolist(), drag.stiffness)
                for k, drag in enumerate(pulls)
            ]
        poses += [pose.name] if changes else []
        edits += changes
    return combine(
        f"fit {describe_fit([c.name for c in cords], regions, poses)} to the body", edits
    )


def describe_fit(cords: Sequence[str], regions: Sequence[str], poses: Sequence[str]) -> str:
    """Return what is fitted: names of cords, regions and poses, or their numbers if many."""
    parts = list[str]()
    for names, word in ((cords, "cord"), (regions, "region"), (poses, "pose")):
        if len(names) > _MAX_NAMES:
            parts.append(f"{len(names)} {word}s")
        else:
            parts += [f"`{name}`" for name in names]
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1] if parts else ""]))


_MAX_NAMES = 3  # of one kind that are listed
