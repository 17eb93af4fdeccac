"""The studio of a folder: the start page, then the page of the device."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, StorageError
from ...workflow.upload_limit import UploadLimit
from ..project.agreement import Agreement
from ..project.project import Project
from .start_page import StartPage
from .studio_page import StudioPage

_MAX_NAME_LENGTH = 80  # of a refused file in the notification


class _Page(Protocol):
    def close(self) -> None: ...


class ErrorPage:
    """The page of a device that cannot be read.

    Args:
        server: The viser server.
        folder: The device's folder.
        error: What is wrong.

    Attributes:
        error: What is wrong.
    """

    def __init__(self, server: Any, folder: Path, error: DefsenseError) -> None:
        self.error = error
        server.gui.add_markdown(
            f"## {folder.absolute().name}\n**{error}**\n\nFix the file in any editor to continue."
        )

    def close(self) -> None:
        """Do nothing; the page runs no work."""


class Studio:
    """The studio on a viser server.

    It shows the start page for a folder without a device, an error page for a device that cannot
    be read, and otherwise the page of the device. Call `poll` once a second.

    Args:
        server: The viser server.
        folder: The device's folder, which need not exist.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        page: The page that is shown.

    Raises:
        StorageError: `folder` is a file.
    """

    def __init__(self, server: Any, folder: Path, agreement: Agreement) -> None:
        if folder.exists() and not folder.is_dir():
            raise StorageError(
                "is not a folder",
                code="not-a-folder",
                where=folder,
                action="Give the folder of the device",
            )
        self._server, self._folder, self._agreement = server, folder, agreement
        self._lock = threading.RLock()
        self.page: _Page | None = None
        UploadLimit(server, self.refuse_upload)
        self.poll()

    def poll(self) -> None:
        """Follow changes of the folder by other programs."""
        with self._lock:
            if isinstance(self.page, StudioPage):
                self.page.poll()
            elif not (self._folder / DEVICE).exists():
                if not isinstance(self.page, StartPage):
                    self._show_page(self._make_start_page)
            else:
                self._open_device()

    def refuse_upload(self, client: Any, name: str, reason: object) -> None:
        """Show why an upload was refused, on the page and to the client."""
        if isinstance(self.page, StartPage):
            self.page.refuse(name, str(reason))
        if client is not None:
            client.add_notification(
                "Upload refused", f"{name[:_MAX_NAME_LENGTH]}: {reason}", color="orange"
            )

    def close(self) -> None:
        """End all running work."""
        with self._lock:
            if self.page is not None:
                self.page.close()

    def _open_device(self) -> None:
        try:
            project = Project(self._folder)
        except DefsenseError as error:
            shown = self.page.error if isinstance(self.page, ErrorPage) else None
            page = partial(ErrorPage, self._server, self._folder, error)
            if shown is None or str(shown) != str(error):
                self._show_page(page)
            return
        self._show_page(lambda: StudioPage(self._server, project, self._agreement))

    def _make_start_page(self) -> StartPage:
        return StartPage(self._server, self._folder, self._agreement, self.poll)

    def _show_page(self, make: Callable[[], _Page]) -> None:
        """Replace the page."""
        if self.page is not None:
            self.page.close()
        self._server.gui.reset()
        self._server.gui.main_panel.dock_right()  # which the reset has undone
        self._server.scene.reset()
        self.page = make()
