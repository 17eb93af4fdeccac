"""The studio of a folder: the start page, then the page of the device."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError
from ...core.storage.files import write_text
from ...core.version import __version__
from ...workflow.view import Client, Download, Event, Problem, Request, WebServer
from ..messages.catalogue import DECODER
from ..messages.shell import Page, Restore
from ..project.agreement import Agreement
from ..project.history import last_valid_text
from ..project.project import Project
from ..session.request_limits import check_values
from .device_folder import check_folder
from .start_app import StartApp

if TYPE_CHECKING:
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
        home: Folder of the command line.
        folder: Folder of the device that is open, or that was open last.
        device: The device that is open, or None.
        start: The start page.

    Raises:
        StorageError: `folder` is a file.
    """

    decoder = DECODER

    def __init__(self, server: WebServer, folder: Path, agreement: Agreement) -> None:
        check_folder(folder)
        self._server, self._agreement = server, agreement
        self.home, self.folder = folder, folder
        self._lock = threading.RLock()
        self._page: Event | None = None
        self._is_closed_by_user = False
        self._clients: set[Client] = set()
        self.device: DeviceApp | None = None
        self.start = StartApp(server, self, agreement)
        self._start_handlers = self.start.handlers
        self.start.publish()
        self.poll()

    @property
    def is_device_open(self) -> bool:
        """Whether a device is open."""
        return self.device is not None

    def poll(self) -> None:
        """Follow changes of the folder by other programs."""
        with self._lock:
            if self.device is not None:
                self._show("device", self.device.poll())
            elif (self.folder / DEVICE).exists() and not self._is_closed_by_user:
                self._open_device()
            else:
                self._show("start", None)

    def check_idle(self) -> None:
        """Check that no job of the device is running. Raises DefsenseError."""
        device = self.device
        if device is not None:
            device.session.jobs.check_idle()

    def open_folder(self, folder: Path) -> None:
        """Open the device in a folder, in place of the one that is open.

        Raises:
            DefsenseError: A job of the other device is running.
        """
        with self._lock:
            is_open = self.device is not None and folder.absolute() == self.folder.absolute()
            if not is_open:
                self.close_device()
                self.folder = folder
                self._is_closed_by_user = False
                self._open_device()

    def close_device(self) -> None:
        """Close the device, and show the start page.

        Raises:
            DefsenseError: A job is running.
        """
        with self._lock:
            self.check_idle()
            if self.device is not None:
                self.device.close()
                self.device = None
                self._server.forget()
                self.start.publish()
            self._is_closed_by_user = True
            self._page = None
            self._show("start", None)

    def connect(self, client: Client) -> None:
        with self._lock:
            if not client.is_open:  # it was closed while this waited for the lock
                return
            self._clients.add(client)
            device = self.device
        self.start.publish_recent()
        if device is not None:
            device.connect(client)

    def disconnect(self, client: Client) -> None:
        with self._lock:
            self._clients.discard(client)
            device = self.device
        self.start.disconnect(client)
        if device is not None:
            device.disconnect(client)

    def handle(self, client: Client, request: Request) -> Any:
        check_values(request)
        handler = self._start_handlers.get(type(request))
        if handler is not None:
            return handler(client, request)
        device = self.device  # another browser may close it meanwhile
        if device is not None:
            return device.handle(client, request)
        if isinstance(request, Restore):
            self._restore()
            return None
        raise DefsenseError("no device is open", code="no-device")

    def receive(self, client: Client, name: str, content: bytes) -> None:
        self.start.receive(client, name, content)

    def download(self, path: str) -> Download | None:
        device = self.device
        return None if device is None else device.download(path)

    def close(self) -> None:
        """End all running work."""
        with self._lock:
            if self.device is not None:
                self.device.close()

    def _restore(self) -> None:
        """Replace a device file that cannot be read by that of the last applied edit."""
        text = last_valid_text(self.folder)
        if text is None:
            raise DefsenseError(
                "there is no earlier file of this device",
                code="nothing-to-restore",
                action="Fix the file in an editor",
            )
        write_text(self.folder / DEVICE, text)
        self.poll()

    def _open_device(self) -> None:
        try:
            project = Project(self.folder)
        except DefsenseError as error:
            self._show("broken", Problem.of(error))
            return
        from .device_app import DeviceApp  # slow, and not needed for the start page

        self._server.forget()
        self._page = None
        self.device = DeviceApp(self._server, project, self._agreement)
        self.start.remember(self.folder, project.device.name)
        self.start.publish()
        self._show("device", None)
        for client in tuple(self._clients):
            self.device.connect(client)

    def _show(self, screen: Any, problem: Problem | None) -> None:
        folder = str(self.folder.absolute())
        page = Page(screen=screen, folder=folder, problem=problem, version=__version__)
        if page != self._page:
            self._page = page
            self._server.publish(page)
