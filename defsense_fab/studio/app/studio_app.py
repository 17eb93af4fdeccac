"""The studio of a folder: the start page, then the page of the device."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, StorageError
from ...core.version import __version__
from ...workflow.view import Client, Download, Event, Problem, Request, WebServer
from ..messages.catalogue import DECODER
from ..messages.shell import Page
from ..project.agreement import Agreement
from ..project.project import Project
from .device_app import DeviceApp


class StudioApp:
    """The studio as the application of a server.

    It shows the start page for a folder without a device, the problem of a device that cannot be
    read, and otherwise the device. Call `poll` once a second.

    Args:
        server: The server, which is started by the caller.
        folder: The device's folder, which need not exist.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        decoder: Reads the requests of browsers.
        device: The device that is shown, or None.

    Raises:
        StorageError: `folder` is a file.
    """

    decoder = DECODER

    def __init__(self, server: WebServer, folder: Path, agreement: Agreement) -> None:
        if folder.exists() and not folder.is_dir():
            raise StorageError(
                "is not a folder",
                code="not-a-folder",
                where=folder,
                action="Give the folder of the device",
            )
        self._server, self._folder, self._agreement = server, folder, agreement
        self._lock = threading.RLock()
        self._page: Event | None = None
        self.device: DeviceApp | None = None
        self.poll()

    def poll(self) -> None:
        """Follow changes of the folder by other programs."""
        with self._lock:
            if self.device is not None:
                self._show("device", self.device.poll())
            elif (self._folder / DEVICE).exists():
                self._open_device()
            else:
                self._show("start", None)

    def connect(self, client: Client) -> None:
        if self.device is not None:
            self.device.connect(client)

    def disconnect(self, client: Client) -> None:
        if self.device is not None:
            self.device.disconnect(client)

    def handle(self, client: Client, request: Request) -> Any:
        if self.device is None:
            raise DefsenseError("no device is open", code="no-device")
        return self.device.handle(client, request)

    def receive(self, client: Client, name: str, content: bytes) -> None:  # noqa: ARG002
        raise DefsenseError(f"{name!r} is not expected here", code="upload-not-expected")

    def download(self, path: str) -> Download | None:
        return None if self.device is None else self.device.download(path)

    def close(self) -> None:
        """End all running work."""
        with self._lock:
            if self.device is not None:
                self.device.close()

    def _open_device(self) -> None:
        try:
            project = Project(self._folder)
        except DefsenseError as error:
            self._show("broken", Problem.of(error))
            return
        self._server.forget()
        self._page = None
        self.device = DeviceApp(self._server, project, self._agreement)
        self._show("device", None)

    def _show(self, screen: Any, problem: Problem | None) -> None:
        folder = str(self._folder.absolute())
        page = Page(screen=screen, folder=folder, problem=problem, version=__version__)
        if page != self._page:
            self._page = page
            self._server.publish(page)
