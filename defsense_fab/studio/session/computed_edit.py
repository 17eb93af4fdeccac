"""Apply an edit that took a while to compute, unless what it changes has changed meanwhile."""

from __future__ import annotations

import sys

import numpy as np
from tomlkit import TOMLDocument

from ...core.device.device import Device
from ...core.device.device_file import DEVICE
from ...core.errors import DeviceError
from ..edits.edit import Edit
from .device_session import DeviceSession


def apply_computed(
    session: DeviceSession,
    edit: Edit,
    computed_for: Device,
    action: str,
    *,
    changes_poses: bool = False,
) -> None:
    """Apply an edit that was computed for a device that may not be the present one.

    Args:
        session: The present device.
        edit: The edit.
        computed_for: The device that it was computed for.
        action: What to do if it is refused, as a command.
        changes_poses: Whether it changes regions and poses, and not only cords.

    Raises:
        DeviceError: The cords, or the regions and poses, have changed meanwhile.
    """
    expected = _contents(computed_for, changes_poses)

    def change(document: TOMLDocument) -> TOMLDocument | None:
        present = _contents(session.device, changes_poses)
        changed = [kind for kind, content in present.items() if content != expected[kind]]
        if changed:
            raise DeviceError(
                f"the {' and '.join(changed)} were changed meanwhile",
                code="changed-meanwhile",
                where=DEVICE,
                action=action,
                changed=tuple(changed),
            )
        return edit.change(document)

    session.apply(Edit(edit.name, change))


def _contents(device: Device, has_poses: bool) -> dict[str, str]:
    """Return texts that differ if the paths of cords, or regions and poses, differ."""
    kinds: dict[str, object] = {
        f"{device.cord.noun}s": [(s.name, s.plane, s.curve) for s in device.sensors]
    }
    if has_poses:
        kinds |= {"regions": device.regions, "poses": device.poses}
    with np.printoptions(threshold=sys.maxsize):
        return {kind: repr(content) for kind, content in kinds.items()}
