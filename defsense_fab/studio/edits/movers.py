"""Changes to what a pose does with regions and points, one role at a time."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from tomlkit import TOMLDocument

from ...core.arrays import Float
from ...core.errors import DeviceError
from .edit import Edit
from .tables import append, inline, named, number, numbers, remove, rows

#: What a pose does with a region.
Role = Literal["free", "held", "moved"]
_BEGINS = 10.0  # degrees about z that a region is turned by which has just been moved


def set_role(name: str, region: str, role: Role) -> Edit:
    """A pose leaves a region free, holds it, or moves it, to begin with by 10 degrees about z."""

    def change(document: TOMLDocument) -> None:
        pose = named(document, "poses", name)
        fixed = pose.get("fixed")
        if fixed is not None and region in fixed and role != "held":
            del fixed[list(fixed).index(region)]
        if role == "held" and (fixed is None or region not in fixed):
            if fixed is None:
                pose["fixed"] = numbers([])
            pose["fixed"].append(region)
        moved = [k for k, row in enumerate(rows(pose, "handles")) if row.get("region") == region]
        if role != "moved":
            for k in reversed(moved):
                remove(pose, "handles", k)
        elif not moved:
            turn = inline({"axis": numbers([0, 0, 1]), "degrees": number(_BEGINS)})
            append(pose, "handles", {"region": region, "rotate": turn, "translate": "free"})

    done = {"free": "leave", "held": "hold", "moved": "move"}[role]
    return Edit(f"{done} `{region}` in `{name}`", change)


def move_drag(name: str, at: Float, by: Float) -> Edit:
    """Where the point `at` (3,) mm is pulled to: by (3,) mm."""

    def change(document: TOMLDocument) -> None:
        _drag(named(document, "poses", name), name, at)["by"] = numbers(by)

    return Edit(f"pull elsewhere in `{name}`", change)


def stiffen_drag(name: str, at: Float, stiffness: float) -> Edit:
    """The spring that pulls at a point `at` (3,) mm, N/mm."""

    def change(document: TOMLDocument) -> None:
        _drag(named(document, "poses", name), name, at)["stiffness"] = number(stiffness)

    return Edit(f"set a spring in `{name}`", change)


def remove_drag(name: str, at: Float) -> Edit:
    """The pull at a point (3,) mm."""

    def change(document: TOMLDocument) -> None:
        pose = named(document, "poses", name)
        drag = _drag(pose, name, at)
        remove(pose, "drags", next(k for k, row in enumerate(pose["drags"]) if row is drag))

    return Edit(f"pull no more at a point in `{name}`", change)


def shift_region(region: str, by: Float) -> Edit:
    """A region's shape, whatever it is, elsewhere by (3,) mm."""

    def change(document: TOMLDocument) -> None:
        shape = document.get("regions", {}).get(region)
        if shape is None:
            raise DeviceError(f"device.toml: there is no region {region!r} any more")
        for kind, keys in _PLACED.items():
            if kind not in shape:
                continue
            if kind == "box":
                shape["box"] = numbers(np.asarray(shape["box"], float) + by)
            for key in keys:
                shape[kind][key] = numbers(np.asarray(shape[kind][key], float) + by)

    return Edit(f"move the region `{region}`", change)


#: The points of each kind of shape.
_PLACED: dict[str, tuple[str, ...]] = {
    "box": (),
    "sphere": ("center",),
    "half_space": ("origin",),
    "cylinder": ("start", "end"),
}


def _drag(pose: Any, name: str, at: Float) -> Any:
    for drag in rows(pose, "drags"):
        if np.allclose(np.asarray(drag.get("at"), float), at, atol=1e-6):
            return drag
    where = ", ".join(f"{v:g}" for v in at)
    raise DeviceError(f"device.toml: the pose `{name}` does not pull at ({where}) any more")
