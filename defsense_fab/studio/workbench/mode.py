"""The interface of a mode: one part of the panel, and its objects in the scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from .workbench import Workbench


class Mode(ABC):
    """A mode of the studio; one mode is active at a time.

    All methods except `add_panel` may be called from any thread, while the workbench's
    `drawing_lock` is held.

    Args:
        bench: The device, its build and the page, which all modes share.

    Attributes:
        label: Text of the mode's button.
        hint: What the user does in the mode.
    """

    label: ClassVar[str]
    hint: ClassVar[str]

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench

    @property
    def is_active(self) -> bool:
        """Whether this is the active mode."""
        return self.bench.mode == self.label

    @abstractmethod
    def add_panel(self) -> None:
        """Add the mode's controls to the open folder of the panel."""

    def enter(self) -> None:  # noqa: B027 - most modes show objects, not all
        """Show the mode's objects in the scene."""

    def leave(self) -> None:  # noqa: B027
        """Hide the mode's objects; another mode becomes active."""

    def on_device_changed(self) -> None:  # noqa: B027
        """Follow a change of `device.toml`; called in every mode, active or not."""

    def on_build_loaded(self) -> None:  # noqa: B027
        """Follow a new build; called in every mode before `on_device_changed`."""

    def poll(self) -> None:  # noqa: B027
        """Check for files that other programs have changed; called about once a second."""

    def close(self) -> None:  # noqa: B027
        """End threads and processes; the page is gone."""
