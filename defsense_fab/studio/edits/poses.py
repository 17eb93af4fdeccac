"""Edits of poses, and of the regions that poses hold and move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.device.device import Pose
from ...core.device.device_file import DEVICE
from ...core.errors import DeviceError
from .edit import (
    Edit,
    append,
    index,
    inline,
    named,
    not_in_device,
    number,
    numbers,
    remove,
    rename_key,
    rows,
    strings,
)

#: What a pose does with a region. A region that is "turned" moves to where no force is left.
PoseRole = Literal["free", "held", "turned", "moved"]
_KEY = "poses"
_STATE_LISTS = ("mixtures", "held_out")  # lists of [states] whose rows name poses
_REGION_LISTS = ("handles", "symmetry", "pressures")  # lists of a pose whose rows name a region
_INITIAL_TURN_DEGREES = 10.0  # as a pose without motion is invalid
_POINT_TOLERANCE_MM = 1e-6
_MIN_TURN_RAD, _MIN_SHIFT_MM = np.deg2rad(0.05), 0.05  # smaller changes are not written
_COORDINATE_AXIS_TOLERANCE_DEG = 1.0
_MIN_ANGLE_RAD = 1e-6
#: Keys of the points of each kind of shape.
_POINT_KEYS: dict[str, tuple[str, ...]] = {
    "box": (),
    "sphere": ("center",),
    "half_space": ("origin",),
    "cylinder": ("start", "end"),
}


def add_pose(name: str, fixed: Sequence[str], region: str, axis: Float) -> Edit:
    """Add a pose that holds regions and turns another one by 10 degrees about an axis (3,)."""

    def change(document: TOMLDocument) -> None:
        turn = rotation_table(axis, _INITIAL_TURN_DEGREES)
        handle = inline({"region": region, "rotate": turn, "translate": "free"})
        append(
            document,
            _KEY,
            {"name": name, "fixed": strings(fixed), "handles": table_array([handle])},
        )

    return Edit(f"add the pose `{name}`", change)


def duplicate_pose(name: str, to: str) -> Edit:
    """Copy a pose under the name `to`."""

    def change(document: TOMLDocument) -> None:
        values = named(document, _KEY, name).unwrap()
        append(document, _KEY, {**{k: _to_inline(v) for k, v in values.items()}, "name": to})

    return Edit(f"duplicate the pose `{name}`", change)


def remove_pose(name: str) -> Edit:
    """Delete a pose and the mixed states that contain it."""

    def change(document: TOMLDocument) -> None:
        remove(document, _KEY, index(document, _KEY, name))
        states = document.get("states", {})
        for key in _STATE_LISTS:
            for k in reversed(range(len(rows(states, key)))):
                if name in states[key][k]:
                    remove(states, key, k)

    return Edit(f"delete the pose `{name}`", change)


def rename_pose(name: str, to: str) -> Edit:
    """Rename a pose, also in mixed states."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["name"] = to
        states = document.get("states", {})
        for key in _STATE_LISTS:
            for k, row in enumerate(rows(states, key)):
                if name in row:
                    renamed = {to if pose == name else pose: row[pose] for pose in row}
                    states[key][k] = inline(renamed)

    return Edit(f"rename the pose `{name}` to `{to}`", change)


def role_of(pose: Pose, region: str) -> PoseRole:
    """Return what a pose does with a region."""
    if region in pose.fixed:
        return "held"
    for handle in pose.handles:
        if handle.region == region:
            return "turned" if np.isnan(handle.translation).any() else "moved"
    return "free"


def set_role(name: str, region: str, role: PoseRole, shift: Sequence[float] = (0, 0, 0)) -> Edit:
    """Set what a pose does with a region.

    A region that is turned or moved from now on turns by 10 degrees about z.

    Args:
        name: Name of the pose.
        region: Name of the region.
        role: The new role.
        shift: Translation (3,) mm of a region that is moved.
    """

    def change(document: TOMLDocument) -> None:
        pose = named(document, _KEY, name)
        fixed = pose.get("fixed")
        if fixed is not None and region in fixed and role != "held":
            del fixed[list(fixed).index(region)]
        if role == "held" and (fixed is None or region not in fixed):
            if fixed is None:
                pose["fixed"] = numbers([])
            pose["fixed"].append(region)
        handles = [k for k, row in enumerate(rows(pose, "handles")) if row.get("region") == region]
        if role in ("free", "held"):
            for k in reversed(handles):
                remove(pose, "handles", k)
            return
        translation = "free" if role == "turned" else numbers(shift)
        if handles:
            handle_table(document, name, region)["translate"] = translation
        else:
            turn = rotation_table(np.array([0.0, 0.0, 1.0]), _INITIAL_TURN_DEGREES)
            values = {"region": region, "rotate": turn, "translate": translation}
            append(pose, "handles", values)

    verb = {"free": "leave", "held": "hold", "turned": "turn", "moved": "move"}[role]
    return Edit(f"{verb} `{region}` in `{name}`", change)


def pose_edits(before: Pose, after: Pose) -> list[Edit]:
    """Return the edits for rotations, translations and pulls that differ between two poses.

    Args:
        before: The pose as the device has it.
        after: The same pose with the same handles and pulls, some of them moved.
    """
    edits: list[Edit] = []
    for old, new in zip(before.handles, after.handles, strict=True):
        axis, degrees = round_rotation(new.rotation)
        if np.linalg.norm(axis * np.deg2rad(degrees) - old.rotation) > _MIN_TURN_RAD:
            edits.append(turn_handle(before.name, old.region, axis, degrees))
        shift = new.translation - old.translation
        if np.abs(np.nan_to_num(shift)).max() > _MIN_SHIFT_MM:
            translation = [round(v, 1) for v in new.translation.tolist()]
            edits.append(shift_handle(before.name, old.region, translation))
    for pull, moved in zip(before.drags, after.drags, strict=True):
        if np.abs(moved.by - pull.by).max() > _MIN_SHIFT_MM:
            edits.append(move_drag(before.name, pull.at, np.round(moved.by, 1)))
    return edits


def round_rotation(rotation: Float) -> tuple[Float, float]:
    """Round a rotation to a tenth of a degree, and to a coordinate axis within one degree.

    Args:
        rotation: Rotation vector (3,) rad.

    Returns:
        Unit axis (3,), and the angle in degrees.
    """
    angle = float(np.linalg.norm(rotation))
    if angle < _MIN_ANGLE_RAD:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis = rotation / angle
    main = int(np.abs(axis).argmax())
    degrees = round(float(np.rad2deg(angle)), 1)
    if abs(axis[main]) > np.cos(np.deg2rad(_COORDINATE_AXIS_TOLERANCE_DEG)):
        return np.eye(3)[main], degrees * float(np.sign(axis[main]))
    return axis, degrees


def turn_handle(name: str, region: str, axis: Float, degrees: float) -> Edit:
    """Set the rotation of a moved region about an axis (3,); the center of rotation stays."""

    def change(document: TOMLDocument) -> None:
        handle = handle_table(document, name, region)
        turn = rotation_table(axis, degrees)
        before = handle.get("rotate")
        if isinstance(before, Mapping) and "about" in before:
            turn["about"] = before["about"]
        handle["rotate"] = turn

    return Edit(f"turn `{region}` in `{name}`", change)


def shift_handle(name: str, region: str, to: Sequence[float] | str) -> Edit:
    """Set the translation of a moved region: (3,) mm, or "free"."""

    def change(document: TOMLDocument) -> None:
        translation = to if isinstance(to, str) else numbers(to)
        handle_table(document, name, region)["translate"] = translation

    return Edit(f"move `{region}` in `{name}`", change)


def drag_point(name: str, at: Float, by: Float, stiffness: float) -> Edit:
    """Pull a point `at` (3,) mm by (3,) mm with a spring of `stiffness` N/mm."""

    def change(document: TOMLDocument) -> None:
        drag = {"at": numbers(at), "by": numbers(by), "stiffness": number(stiffness)}
        pose = named(document, _KEY, name)
        if "drags" in pose:
            append(pose, "drags", drag)
        else:
            pose["drags"] = table_array([inline(drag)])

    return Edit(f"pull at a point in `{name}`", change)


def move_drag(name: str, at: Float, by: Float) -> Edit:
    """Change the displacement of the point pulled `at` (3,) mm to `by` (3,) mm."""

    def change(document: TOMLDocument) -> None:
        _drag(named(document, _KEY, name), name, at)["by"] = numbers(by)

    return Edit(f"move a pull in `{name}`", change)


def stiffen_drag(name: str, at: Float, stiffness: float) -> Edit:
    """Set the stiffness, N/mm, of the spring that pulls at a point (3,) mm."""

    def change(document: TOMLDocument) -> None:
        _drag(named(document, _KEY, name), name, at)["stiffness"] = number(stiffness)

    return Edit(f"set a spring in `{name}`", change)


def remove_drag(name: str, at: Float) -> Edit:
    """Delete the pull at a point (3,) mm."""

    def change(document: TOMLDocument) -> None:
        pose = named(document, _KEY, name)
        drag = _drag(pose, name, at)
        remove(pose, "drags", next(k for k, row in enumerate(pose["drags"]) if row is drag))

    return Edit(f"delete a pull in `{name}`", change)


def set_box(region: str, low: Float, high: Float) -> Edit:
    """Set a region to the box between two corners (3,) mm; add it if it does not exist."""

    def change(document: TOMLDocument) -> None:
        regions = document.setdefault("regions", inline({}))
        regions[region] = inline({"box": numbers([low, high])})

    return Edit(f"set the region `{region}`", change)


def shift_region(region: str, by: Float) -> Edit:
    """Move a region of any shape by (3,) mm."""

    def change(document: TOMLDocument) -> None:
        check_region(document, region)
        regions: Any = document["regions"]
        shape = regions[region]
        for kind, keys in _POINT_KEYS.items():
            if kind not in shape:
                continue
            if kind == "box":
                shape["box"] = numbers(np.asarray(shape["box"], float) + by)
            for key in keys:
                shape[kind][key] = numbers(np.asarray(shape[kind][key], float) + by)

    return Edit(f"move the region `{region}`", change)


def remove_region(region: str) -> Edit:
    """Delete a region; the edit raises DeviceError if a pose uses it."""

    def change(document: TOMLDocument) -> None:
        check_region(document, region)
        users = [str(pose["name"]) for pose in rows(document, _KEY) if _uses(pose, region)]
        if users:
            raise DeviceError(
                f"the region `{region}` is used by the poses {', '.join(users)}",
                code="region-in-use",
                where=DEVICE,
                action="Remove it from them first",
                region=region,
                poses=tuple(users),
            )
        del document["regions"][region]
        _set_anchor(document, region, None)

    return Edit(f"delete the region `{region}`", change)


def rename_region(region: str, to: str) -> Edit:
    """Rename a region, also in poses and in the outputs."""

    def change(document: TOMLDocument) -> None:
        check_region(document, region)
        regions: Any = document["regions"]
        if to in regions:
            raise DeviceError(
                f"already has a region `{to}`",
                code="name-repeated",
                where=DEVICE,
                action="Choose another name",
                name=to,
            )
        rename_key(regions, region, to)
        for pose in rows(document, _KEY):
            for k, name in enumerate(pose.get("fixed", [])):
                if name == region:
                    pose["fixed"][k] = to
            for key in _REGION_LISTS:
                for row in rows(pose, key):
                    if row.get("region") == region:
                        row["region"] = to
        _set_anchor(document, region, to)

    return Edit(f"rename the region `{region}` to `{to}`", change)


def check_region(document: TOMLDocument, region: str) -> None:
    """Raise DeviceError if the device has no such region."""
    names = list(document.get("regions", {}))
    if region not in names:
        raise not_in_device("region", region, names)


def _uses(pose: Any, region: str) -> bool:
    users = [row for key in _REGION_LISTS for row in rows(pose, key)]
    return region in pose.get("fixed", []) or any(row.get("region") == region for row in users)


def _set_anchor(document: TOMLDocument, region: str, to: str | None) -> None:
    """Rename or remove the anchor of the outputs if it is this region."""
    outputs: Any = document.get("outputs", {})
    if outputs.get("anchor") == region:
        if to is None:
            del outputs["anchor"]
        else:
            outputs["anchor"] = to


def handle_table(document: TOMLDocument, name: str, region: str) -> Any:
    """Return the table of the handle of a region. Raises DeviceError if there is none."""
    for handle in rows(named(document, _KEY, name), "handles"):
        if handle.get("region") == region:
            return handle
    raise DeviceError(
        f"the pose `{name}` no longer moves `{region}`",
        code="region-not-moved",
        where=DEVICE,
        pose=name,
        region=region,
    )


def _drag(pose: Any, name: str, at: Float) -> Any:
    for drag in rows(pose, "drags"):
        if np.allclose(np.asarray(drag.get("at"), float), at, atol=_POINT_TOLERANCE_MM):
            return drag
    point = ", ".join(f"{v:g}" for v in at)
    raise DeviceError(
        f"the pose `{name}` no longer pulls at ({point})",
        code="point-not-pulled",
        where=DEVICE,
        pose=name,
    )


def rotation_table(axis: Float, degrees: float) -> Any:
    """Return the inline table of a rotation about an axis (3,)."""
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    return inline({"axis": numbers(unit), "degrees": number(degrees)})


def table_array(values: Sequence[Any]) -> Any:
    """Return an array in one line of inline tables or other items."""
    array = numbers([])
    array.extend(values)
    return array


def _to_inline(value: Any) -> Any:
    """Convert plain values to TOML in one line."""
    if isinstance(value, Mapping):
        return inline({k: _to_inline(v) for k, v in value.items()})
    if isinstance(value, list):
        return table_array([_to_inline(v) for v in value])
    return value
