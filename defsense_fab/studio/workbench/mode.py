"""A mode of the studio: one part of its panel, and what it shows in three dimensions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from .workbench import Workbench


class Mode(ABC):
    """One at a time is entered. All methods but `add_panel` may be called from any thread, while
    the workbench's `drawing` lock is taken."""

    label: ClassVar[str]  # on its button
    hint: ClassVar[str]  # what one does in it

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench

    @abstractmethod
    def add_panel(self) -> None:
        """Its buttons and words, in the folder of the panel that is open."""

    def enter(self) -> None:  # noqa: B027 - most modes have something to show, not all
        """It has been chosen: show what is its own in the scene."""

    def leave(self) -> None:  # noqa: B027
        """Another has been chosen: take it away."""

    def device_changed(self) -> None:  # noqa: B027
        """The device's file has changed; called in every mode, entered or not."""

    def built(self) -> None:  # noqa: B027
        """There is another build, or the first; called in every mode before `device_changed`."""

    def look(self) -> None:  # noqa: B027
        """About once a second: take up what others have written beside the device's file."""

    def close(self) -> None:  # noqa: B027
        """End threads and processes; the page is gone."""
