"""The studio of a folder: the page on which a device is begun, then the one on which it is
designed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, StorageError
from ...runtime.view.upload_limit import limit_uploads
from ..project.agreement import Agreement
from ..project.project import Project
from ..start.start_page import StartPage
from .studio_page import StudioPage


class _Page(Protocol):
    def look(self) -> None: ...
    def close(self) -> None: ...


class TroublePage:
    """A device that cannot be read yet: what is wrong, until it is mended."""

    def __init__(self, server: Any, folder: Path, error: Exception) -> None:
        self.about = str(error)
        server.gui.add_markdown(
            f"## {folder.absolute().name}\n**{error}**\n\nThe page goes on by itself once that is"
            " mended: edit the file in any editor."
        )

    def look(self) -> None:
        """Nothing of it changes by itself."""

    def close(self) -> None:
        """Nothing is under way."""


class Studio:
    """On a viser server. Without a device it begins with the gallery, with one that cannot be read
    by what is wrong with it; `look`, called once a second, goes on from there."""

    def __init__(self, server: Any, folder: Path, agreement: Agreement) -> None:
        """Raises StorageError where the folder is a file."""
        if folder.exists() and not folder.is_dir():
            raise StorageError(f"{folder}: is no folder; give one for the device")
        self._server, self._folder, self._agreement = server, folder, agreement
        self._lock = threading.RLock()
        self.page: _Page | None = None
        limit_uploads(server, self._refused)
        self.look()

    def look(self) -> None:
        """Take up what others have written."""
        with self._lock:
            if isinstance(self.page, StudioPage):
                self.page.look()
            elif not (self._folder / DEVICE).exists():
                if not isinstance(self.page, StartPage):
                    self._turn_to(self._start)
            else:
                self._open()

    def close(self) -> None:
        """End what is under way."""
        with self._lock:
            if self.page is not None:
                self.page.close()

    def _open(self) -> None:
        try:
            project = Project(self._folder)
        except DefsenseError as error:
            told = str(error)
            if not (isinstance(self.page, TroublePage) and self.page.about == told):
                self._turn_to(lambda: TroublePage(self._server, self._folder, DefsenseError(told)))
            return
        self._turn_to(lambda: StudioPage(self._server, project, self._agreement))

    def _start(self) -> StartPage:
        return StartPage(self._server, self._folder, self._agreement, self.look)

    def _turn_to(self, make: Callable[[], _Page]) -> None:
        """Another page in place of the one before."""
        if self.page is not None:
            self.page.close()
        self._server.gui.reset()
        self._server.gui.main_panel.dock_right()  # which the reset has undone
        self._server.scene.reset()
        self.page = make()

    def _refused(self, client: Any, name: str, why: object) -> None:
        """An upload that was not taken."""
        if isinstance(self.page, StartPage):
            self.page.refuse(name, str(why))
        if client is not None:
            client.add_notification(
                "The upload is not taken", f"{name[:80]}: {why}", color="orange"
            )
