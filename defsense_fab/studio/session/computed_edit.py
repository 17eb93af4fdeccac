"""Apply edits that took a while to compute, unless what they are based on has changed meanwhile."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from tomlkit import TOMLDocument

from ...core.device.device import Device
from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, DeviceError
from ...core.mesh import Surface
from ...workflow.view import Client
from ..background.background_job import CANCELLED
from ..edits.edit import Edit
from .device_session import DeviceSession

REPAIR_S = 30.0  # in which cords are repaired; the other edits wait for it


@dataclass(frozen=True)
class EditBasis:
    """The device and its body from which an edit is computed.

    Attributes:
        session: The present device.
        device: The device when the computation began.
        surface: Its newest body; None without one.
    """

    session: DeviceSession
    device: Device
    surface: Surface | None

    @classmethod
    def of(cls, session: DeviceSession) -> EditBasis:
        """Return the present basis."""
        return cls(session, session.device, session.newest_surface)

    def check_wanted(self, client: Client) -> Callable[[], None]:
        """Return a function that raises an error once nobody waits for the edit any more.

        Args:
            client: The browser that waits.

        The function raises:
            DefsenseError: The device or the browser was closed.
        """

        def check() -> None:
            self.session.require_open()
            if not client.is_open:
                raise DefsenseError("the page was closed", code=CANCELLED)

        return check

    def apply(self, edit: Edit, action: str, *, changes_poses: bool = False) -> None:
        """Apply an edit that was computed from this basis.

        Args:
            edit: The edit.
            action: What to do if it is refused, as a command.
            changes_poses: Whether it changes regions and poses, and not only cords.

        Raises:
            DeviceError: The cords, the body, or the regions and poses have changed meanwhile
                (`changed-meanwhile`), or the device was closed (`device-closed`).
        """
        expected = _contents(self.device, self.surface, changes_poses)

        def change(document: TOMLDocument) -> TOMLDocument | None:
            session = self.session
            present = _contents(session.device, session.newest_surface, changes_poses)
            changed = [kind for kind, content in present.items() if content != expected[kind]]
            if changed:
                words = [f"{session.device.cord.noun}s" if k == "cords" else k for k in changed]
                verb = "was" if changed == ["body"] else "were"
                raise DeviceError(
                    f"the {' and '.join(words)} {verb} changed meanwhile",
                    code="changed-meanwhile",
                    where=DEVICE,
                    action=action,
                    changed=tuple(changed),
                )
            return edit.change(document)

        self.session.apply(Edit(edit.name, change))


def _contents(device: Device, surface: Surface | None, has_poses: bool) -> dict[str, object]:
    """Return values that differ if the paths of cords, the body, or regions and poses differ."""
    kinds: dict[str, object] = {"cords": [(s.name, s.plane, s.curve) for s in device.sensors]}
    if has_poses:
        kinds |= {"regions": device.regions, "poses": device.poses}
    with np.printoptions(threshold=sys.maxsize):
        texts: dict[str, object] = {kind: repr(content) for kind, content in kinds.items()}
    body = None if surface is None else (surface.vertices.tobytes(), surface.faces.tobytes())
    return {**texts, "body": body}
