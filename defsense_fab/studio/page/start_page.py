"""The page of an empty folder: start from a device of the gallery or from an uploaded body."""

from __future__ import annotations

import base64
import html
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...core.device.device_file import load_device
from ...core.errors import DefsenseError
from ...core.storage.file_names import safe_name
from ...geometry.bodies.mesh_files import FORMAT_NAMES
from ...runtime.view.upload_limit import MAX_UPLOAD_BYTES
from ...workflow.starts.dropped_body import load_body_content
from ...workflow.starts.starting_devices import (
    STARTING_DEVICES,
    StartingDevice,
    create_starting_device,
)
from ..project.agreement import Agreement
from ..workbench.latest_worker import LatestWorker
from .body_form import BodyForm

_PICTURE_HTML = (
    '<img alt="{title}" src="data:image/png;base64,{data}" style="display: block; width: 70%;'
    ' margin: 0.6em auto 0.3em; border-radius: 4px">'
)
_UPLOAD_HINT = (
    f"Upload a body: a STEP file or a mesh ({FORMAT_NAMES}) of up to {MAX_UPLOAD_BYTES // 2**20} MB"
)


class StartPage:
    """The gallery of devices and the form for an uploaded body.

    Args:
        server: The viser server.
        folder: The empty folder.
        agreement: The scripts that the user has agreed to run.
        on_created: Called once the folder has a device.

    Attributes:
        message: Text at the top of the page.
        error: The last error that was shown, or None.
        form: Form for an uploaded body.
        buttons: Buttons of the gallery by the devices' names.
        upload: The button for uploads.
    """

    def __init__(
        self, server: Any, folder: Path, agreement: Agreement, on_created: Callable[[], None]
    ) -> None:
        self.server, self.folder = server, folder
        self._agreement, self._on_created = agreement, on_created
        self._lock, self._is_closed = threading.RLock(), False
        self._reader = LatestWorker(self._read, self.show_error)
        self.error: Exception | None = None
        gui = server.gui
        gui.add_markdown(
            f"## A new device\nin the folder `{folder.absolute()}`. Choose a device to start from"
            " and change it as you like, or upload a body."
        )
        self.message = gui.add_markdown("")
        self.upload = self._add_upload()
        self.form = BodyForm(server, folder, self._on_created, self.show_error)
        self.buttons = {start.name: self._add_start(start) for start in STARTING_DEVICES}

    def close(self) -> None:
        """End the thread; no message is shown afterwards."""
        with self._lock:
            self._is_closed = True
        self._reader.close()

    def poll(self) -> None:
        """Do nothing; the page does not change without the user."""

    def show_error(self, error: Exception) -> None:
        """Show an error at the top of the page."""
        self.error = error
        self._show_message(f"**{error}**")

    def create(self, start: StartingDevice) -> None:
        """Create a device of the gallery, named after the folder."""
        try:
            create_starting_device(start, self.folder, safe_name(self.folder.absolute().name + "."))
            self._agree(start)
        except DefsenseError as error:
            self.show_error(error)
            return
        self._on_created()

    def receive(self, name: str, content: bytes) -> None:
        """Read an uploaded file on a thread, then show the form or an error."""
        self.error = None
        self._show_message(f"Reading `{safe_name(name)}` ...")
        self._reader.give((name, content))

    def refuse(self, name: str, reason: str) -> None:
        """Show why an upload was refused, and replace viser's button, which waits for the file."""
        with self._lock:
            if not self._is_closed:
                self._show_message(f"**`{safe_name(name)}` was refused: {reason}.**")
                self.upload.remove()
                self.upload = self._add_upload()

    def wait(self, timeout_s: float) -> bool:
        """Wait until all uploads are read; return False after `timeout_s`."""
        return self._reader.wait(timeout_s)

    def _read(self, file: tuple[str, bytes]) -> None:
        body = load_body_content(*file)
        self._show_message("")
        self.form.show(body)

    def _show_message(self, text: str) -> None:
        with self._lock:
            if not self._is_closed:  # viser raises for the controls of a closed page
                self.message.content = text

    def _agree(self, start: StartingDevice) -> None:
        """Agree to the package's own script.

        The user is still asked if other files of the folder would run with it.
        """
        script = self._agreement.script_to_confirm(load_device(self.folder, complete=False).body)
        if script is None:
            return
        contents = [content for _, content in script.files]
        if contents == [start.script]:
            self._agreement.confirm(script)

    def _add_upload(self) -> Any:
        button = self.server.gui.add_upload_button(
            "Upload a body", hint=_UPLOAD_HINT, color="gray", order=2.5
        )
        button.on_upload(
            lambda event: self.receive(event.target.value.name, event.target.value.content)
        )
        return button

    def _add_start(self, start: StartingDevice) -> Any:
        gui = self.server.gui
        data = base64.b64encode(start.picture).decode()
        gui.add_html(_PICTURE_HTML.format(title=html.escape(start.title), data=data))
        gui.add_markdown(start.about)
        button = gui.add_button(f"Start with the {start.title.lower()}", hint=start.about)
        button.on_click(lambda _: self.create(start))
        return button
