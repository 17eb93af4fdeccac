"""The page on which a device is begun: from one that comes along, or from a file of a body."""

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
from ...workflow.starts.dropped_body import look_at_file
from ...workflow.starts.starting_devices import STARTS, StartingDevice, begin_with
from ..project.agreement import Agreement
from ..workbench.latest import Latest
from .body_form import BodyForm

_PICTURE = (
    '<img alt="{title}" src="data:image/png;base64,{data}" style="display: block; width: 70%;'
    ' margin: 0.6em auto 0.3em; border-radius: 4px">'
)
_UPLOAD = f"Your own body (STEP or a mesh: {FORMAT_NAMES}; up to {MAX_UPLOAD_BYTES // 2**20} MB)"


class StartPage:
    """Of a `folder`; `begun` is called once it has a device."""

    def __init__(
        self, server: Any, folder: Path, agreement: Agreement, begun: Callable[[], None]
    ) -> None:
        self.server, self.folder = server, folder
        self._agreement, self._begun = agreement, begun
        self._lock, self._over = threading.RLock(), False
        self._read = Latest(self._look_at, self.fail)
        gui = server.gui
        gui.add_markdown(
            f"## A new device\nin the folder `{folder.absolute()}`. Choose one to begin with, and"
            " change it as you like; or bring a body of your own."
        )
        self.message = gui.add_markdown("")
        self._add_upload()
        self.form = BodyForm(server, folder, self._finish, self.fail)
        self.buttons = {start.name: self._add_start(start) for start in STARTS}

    def close(self) -> None:
        """End its thread; nothing is told any more."""
        with self._lock:
            self._over = True
        self._read.close()

    def look(self) -> None:
        """Nothing of it changes by itself."""

    def fail(self, error: Exception) -> None:
        """What went wrong, at the top of the page."""
        self._tell(f"**{error}**")

    def begin(self, start: StartingDevice) -> None:
        """The device, with a name after the folder's."""
        try:
            begin_with(start, self.folder, safe_name(self.folder.absolute().name + "."))
            self._agree(start)
        except DefsenseError as error:
            self.fail(error)
            return
        self._finish()

    def dropped(self, name: str, content: bytes) -> None:
        """A file has come whole; it is looked at on a thread."""
        self._tell(f"`{safe_name(name)}` is being read ...")
        self._read.give((name, content))

    def refuse(self, name: str, why: str) -> None:
        """An upload that is not taken; viser's button waits for it, so there is a new one."""
        with self._lock:
            if not self._over:
                self._tell(f"**`{safe_name(name)}` is not taken: {why}.**")
                self._upload.remove()
                self._add_upload()

    def wait(self, seconds: float) -> bool:
        """Whether all that was dropped is looked at within so many s."""
        return self._read.wait(seconds)

    def _look_at(self, file: tuple[str, bytes]) -> None:
        found = look_at_file(*file)
        self._tell("")
        self.form.show(found)

    def _tell(self, words: str) -> None:
        with self._lock:
            if not self._over:  # its handles are gone then, and refuse all
                self.message.content = words

    def _finish(self) -> None:
        self._begun()

    def _agree(self, start: StartingDevice) -> None:
        """Whoever takes a device of the package need not be asked for its script; for what else
        would run with it, as it lay in the folder already, a person is asked."""
        script = self._agreement.asked(load_device(self.folder, complete=False).body)
        if script is None:
            return
        contents = [content for _, content in script.files]
        if contents == [start.script]:
            self._agreement.give(script)

    def _add_upload(self) -> None:
        self._upload = self.server.gui.add_upload_button(
            "Upload a body", hint=_UPLOAD, color="gray", order=2.5
        )
        self._upload.on_upload(
            lambda event: self.dropped(event.target.value.name, event.target.value.content)
        )

    def _add_start(self, start: StartingDevice) -> Any:
        gui = self.server.gui
        data = base64.b64encode(start.picture).decode()
        gui.add_html(_PICTURE.format(title=html.escape(start.title), data=data))
        gui.add_markdown(start.about)
        button = gui.add_button(f"Begin with the {start.title.lower()}", hint=start.about)
        button.on_click(lambda _: self.begin(start))
        return button
