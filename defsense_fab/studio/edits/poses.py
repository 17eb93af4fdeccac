"""Changes to poses, and to the regions that they fix and move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.errors import DeviceError
from .edit import Edit
from .tables import append, index, inline, named, number, numbers, remove, rename_key, rows, strings

_KEY, _FREE = "poses", "free"
_MIXED = ("mixtures", "held_out")  # lists of [states] that name poses


def add_pose(name: str, fixed: Sequence[str], region: str) -> Edit:
    """A pose that holds regions and moves another; the handle turns by 10 degrees about z to begin
    with, as a pose in which nothing moves is none."""

    def change(document: TOMLDocument) -> None:
        handle = inline(
            {"region": region, "rotate": _turn(np.array([0.0, 0.0, 1.0]), 10.0), "translate": _FREE}
        )
        append(document, _KEY, {"name": name, "fixed": strings(fixed), "handles": _list([handle])})

    return Edit(f"add the pose `{name}`", change)


def duplicate_pose(name: str, to: str) -> Edit:
    """A copy of a pose, by another name."""

    def change(document: TOMLDocument) -> None:
        values = named(document, _KEY, name).unwrap()
        append(document, _KEY, {**{k: _written(v) for k, v in values.items()}, "name": to})

    return Edit(f"duplicate the pose `{name}`", change)


def remove_pose(name: str) -> Edit:
    """With the mixed states that it is a part of."""

    def change(document: TOMLDocument) -> None:
        remove(document, _KEY, index(document, _KEY, name))
        states = document.get("states", {})
        for key in _MIXED:
            for k in reversed(range(len(rows(states, key)))):
                if name in states[key][k]:
                    remove(states, key, k)

    return Edit(f"delete the pose `{name}`", change)


def rename_pose(name: str, to: str) -> Edit:
    """In mixed states, too."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["name"] = to
        states = document.get("states", {})
        for key in _MIXED:
            for k, row in enumerate(rows(states, key)):
                if name in row:
                    renamed = {to if pose == name else pose: row[pose] for pose in row}
                    states[key][k] = inline(renamed)

    return Edit(f"rename the pose `{name}` to `{to}`", change)


def turn_handle(name: str, region: str, axis: Float, degrees: float) -> Edit:
    """A handle's rotation about an axis (3,); what it turns about stays."""

    def change(document: TOMLDocument) -> None:
        handle = _handle(document, name, region)
        turn = _turn(axis, degrees)
        before = handle.get("rotate")
        if isinstance(before, Mapping) and "about" in before:
            turn["about"] = before["about"]
        handle["rotate"] = turn

    return Edit(f"turn `{region}` in `{name}`", change)


def shift_handle(name: str, region: str, to: Sequence[float] | str) -> Edit:
    """A handle's translation: (3,) mm, or "free"."""

    def change(document: TOMLDocument) -> None:
        given = to if isinstance(to, str) else numbers(to)
        _handle(document, name, region)["translate"] = given

    return Edit(f"move `{region}` in `{name}`", change)


def hold_regions(name: str, fixed: Sequence[str]) -> Edit:
    """The regions that a pose fixes."""

    def change(document: TOMLDocument) -> None:
        named(document, _KEY, name)["fixed"] = strings(fixed)

    return Edit(f"hold {', '.join(fixed) or 'nothing'} in `{name}`", change)


def drag_point(name: str, at: Float, by: Float, stiffness: float) -> Edit:
    """A point (3,) mm pulled by (3,) mm with a spring, N/mm."""

    def change(document: TOMLDocument) -> None:
        drag = {"at": numbers(at), "by": numbers(by), "stiffness": number(stiffness)}
        pose = named(document, _KEY, name)
        if "drags" in pose:
            append(pose, "drags", drag)
        else:
            pose["drags"] = _list([inline(drag)])

    return Edit(f"pull at a point in `{name}`", change)


def set_box(region: str, low: Float, high: Float) -> Edit:
    """A region as a box between two corners (3,) mm; a new one where there is none of that name."""

    def change(document: TOMLDocument) -> None:
        regions = document.setdefault("regions", inline({}))
        regions[region] = inline({"box": numbers([low, high])})

    return Edit(f"set the region `{region}`", change)


def remove_region(region: str) -> Edit:
    """Raises DeviceError, when it is done, where a pose needs it."""

    def change(document: TOMLDocument) -> None:
        _known(document, region)
        users = [str(pose["name"]) for pose in rows(document, _KEY) if _uses(pose, region)]
        if users:
            raise DeviceError(
                f"device.toml: the region `{region}` is needed by {', '.join(users)}; take it out"
                " of them first"
            )
        del document["regions"][region]
        _anchor(document, region, None)

    return Edit(f"delete the region `{region}`", change)


def rename_region(region: str, to: str) -> Edit:
    """Wherever it is named."""

    def change(document: TOMLDocument) -> None:
        _known(document, region)
        regions: Any = document["regions"]
        if to in regions:
            raise DeviceError(f"device.toml: there is a region `{to}` already")
        rename_key(regions, region, to)
        for pose in rows(document, _KEY):
            for k, name in enumerate(pose.get("fixed", [])):
                if name == region:
                    pose["fixed"][k] = to
            for key in ("handles", "symmetry", "pressures"):
                for row in rows(pose, key):
                    if row.get("region") == region:
                        row["region"] = to
        _anchor(document, region, to)

    return Edit(f"rename the region `{region}` to `{to}`", change)


def pose_names(document: TOMLDocument) -> list[str]:
    """In their order."""
    return [str(row["name"]) for row in rows(document, _KEY)]


def _known(document: TOMLDocument, region: str) -> None:
    there = list(document.get("regions", {}))
    if region not in there:
        raise DeviceError(
            f"device.toml: there is no region {region!r} any more; there are"
            f" {', '.join(there) or 'none'}"
        )


def _uses(pose: Any, region: str) -> bool:
    moved = [row for key in ("handles", "symmetry", "pressures") for row in rows(pose, key)]
    return region in pose.get("fixed", []) or any(row.get("region") == region for row in moved)


def _anchor(document: TOMLDocument, region: str, to: str | None) -> None:
    outputs: Any = document.get("outputs", {})
    if outputs.get("anchor") == region:
        if to is None:
            del outputs["anchor"]
        else:
            outputs["anchor"] = to


def _handle(document: TOMLDocument, name: str, region: str) -> Any:
    handles = rows(named(document, _KEY, name), "handles")
    for handle in handles:
        if handle.get("region") == region:
            return handle
    raise DeviceError(f"device.toml: the pose `{name}` does not move `{region}` any more")


def _turn(axis: Float, degrees: float) -> Any:
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    return inline({"axis": numbers(unit), "degrees": number(degrees)})


def _list(values: Sequence[Any]) -> Any:
    out = numbers([])
    out.extend(values)
    return out


def _written(value: Any) -> Any:
    """Plain values as they are written in one line."""
    if isinstance(value, Mapping):
        return inline({k: _written(v) for k, v in value.items()})
    if isinstance(value, list):
        return _list([_written(v) for v in value])
    return value
