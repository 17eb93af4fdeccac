"""What a pose does with each region: a drop-down each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.device.device import Device, Pose
from ..edits.edit import Edit
from ..edits.movers import set_role
from ..edits.poses import shift_handle
from ..workbench.workbench import Workbench

FREE, HELD, TURNED, MOVED = "left alone", "held", "turned, its place free", "turned and shifted"
ROLES = (FREE, HELD, TURNED, MOVED)


def role_of(pose: Pose, region: str) -> str:
    """One of ROLES."""
    if region in pose.fixed:
        return HELD
    for handle in pose.handles:
        if handle.region == region:
            return TURNED if np.isnan(handle.translation).any() else MOVED
    return FREE


def role_edits(pose: Pose, region: str, role: str, shift: list[float]) -> list[Edit]:
    """What is to be written for a role; `shift` (3,) mm is where a region lies that is moved from
    now on, so that nothing jumps."""
    if role == role_of(pose, region):
        return []
    if role in (FREE, HELD):
        return [set_role(pose.name, region, "held" if role == HELD else "free")]
    out = []
    if role_of(pose, region) in (FREE, HELD):
        out.append(set_role(pose.name, region, "moved"))
        if role == TURNED:  # which it begins with
            return out
    out.append(shift_handle(pose.name, region, "free" if role == TURNED else shift))
    return out


class RoleList:
    """In a folder of the panel. `chosen` hears of a region and its role."""

    def __init__(self, bench: Workbench, chosen: Any) -> None:
        self._bench, self._chosen = bench, chosen
        self._lists: dict[str, Any] = {}

    def add_panel(self) -> None:
        """In the folder that is open."""
        self._folder = self._bench.server.gui.add_folder("What it does with regions")

    def show(self, device: Device, pose: Pose | None) -> None:
        """The roles that a pose has now."""
        regions = list(device.regions)
        if list(self._lists) != regions:
            for made in self._lists.values():
                made.remove()
            with self._folder:
                self._lists = {name: self._add(name) for name in regions}
        self._folder.visible = pose is not None
        if pose is not None:
            for name, made in self._lists.items():
                made.value = role_of(pose, name)

    def _add(self, region: str) -> Any:
        made = self._bench.server.gui.add_dropdown(
            region, ROLES, hint="Moved regions have a gizmo: rings turn them, arrows shift them"
        )

        def updated(event: Any) -> None:
            if event.client is not None:
                self._chosen(region, made.value)

        made.on_update(updated)
        return made
