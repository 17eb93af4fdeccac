"""Gizmos of a pose, and what a pose is once a hand has moved one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device, Handle, Pose
from ..edits.edit import Edit
from ..edits.movers import move_drag
from ..edits.poses import shift_handle, turn_handle
from .gizmos import Grip, tidy
from .region_part import middle

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
