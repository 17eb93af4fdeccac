"""The page of an empty folder: start from a device of the gallery or from an uploaded body."""

from __future__ import annotations

import base64
import html
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core.device.device_file import load_device
from ...core.errors import DefsenseError
from ...core.storage.file_names import safe_name
from ...core.storage.package_data import read_rows
from ...workflow.starts.body_file import (
    FORMAT_NAMES,
    BodyFile,
    load_body_content,
    notable_repairs,
    scale_to_size,
)
from ...workflow.starts.first_device import create_first_device, default_material
from ...workflow.starts.options import DEFAULT_PROCESS, UNITS, NewOptions
from ...workflow.starts.starting_devices import (
    STARTING_DEVICES,
    StartingDevice,
    create_starting_device,
)
from ...workflow.upload_limit import MAX_UPLOAD_BYTES
from ...workflow.view import look_at_body
from ..project.agreement import Agreement
from ..workbench.controls import add_field, add_option, on_user
from ..workbench.latest_worker import LatestWorker

_PICTURE_HTML = (
    '<img alt="{title}" src="data:image/png;base64,{data}" style="display: block; width: 70%;'
    ' margin: 0.6em auto 0.3em; border-radius: 4px">'
)
_UPLOAD_HINT = (
    f"Upload a body: a STEP file or a mesh ({FORMAT_NAMES}) of up to {MAX_UPLOAD_BYTES // 2**20} MB"
)

#: Choice of the unit for a file whose size is given instead.
UNKNOWN_UNIT = "unknown"
_BODY_COLOR = (230, 159, 0)


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


class BodyForm:
    """A form in the panel, hidden until a body is uploaded.

    Args:
        server: The viser server.
        folder: Folder of the new device.
        on_created: Called once the device is written.
        on_error: Called with an error that prevents it.

    Attributes:
        panel: Folder of the panel that holds the form.
        size_text: Text on the size of the body.
        unit: Unit of the file; `UNKNOWN_UNIT` if the size determines the scale of a mesh.
        size: Longest side of the body, mm.
        name: Name of the device.
        material: Material of the body.
        edge: Edge length of the mesh, mm.
    """

    def __init__(
        self,
        server: Any,
        folder: Path,
        on_created: Callable[[], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._server, self._folder = server, folder
        self._on_created, self._on_error = on_created, on_error
        self.body: BodyFile | None = None
        self._options = NewOptions()
        gui = server.gui
        self.panel = gui.add_folder("Uploaded body", visible=False)
        with self.panel:
            self.size_text = gui.add_markdown("")
            self.unit = gui.add_dropdown(
                "Unit",
                (*UNITS, UNKNOWN_UNIT),
                hint=f"Set the unit of lengths in the file; if it is {UNKNOWN_UNIT}, set the"
                " longest side",
            )
            self.size = add_option(gui, NewOptions, "size", "Longest side (mm)", 1.0, 100.0)
            self.name = add_field(gui, "name", "")
            self.material = gui.add_dropdown(
                "Material",
                tuple(read_rows("materials.csv")),
                initial_value=default_material(DEFAULT_PROCESS),
                hint="Choose the material of the body",
            )
            self.edge = add_field(gui, "mesh.edge_length", 1.0, step=0.1)
            gui.add_button("Create the device", color="blue").on_click(lambda _: self.create())
        on_user(self.unit, self.choose_unit)
        on_user(self.size, self.choose_size)

    def show(self, body: BodyFile) -> None:
        """Show the form for a body."""
        self.body = body
        self.name.value = body.name
        self.unit.visible = self.size.visible = body.key == "mesh"
        self.panel.visible = True
        self.choose_unit(body.unit)

    def choose_unit(self, unit: str) -> None:
        """Interpret the file in a unit, and show the body; keep its size if that is unknown."""
        if self.body is None:
            return
        if unit == UNKNOWN_UNIT:
            self.choose_size(float(self.size.value))
            return
        self._options = NewOptions(units=unit)
        self.size.value = float(f"{self.body.size(unit).max():.4g}")
        self.unit.value = unit
        self._show_body(self.body, unit)

    def choose_size(self, size: float) -> None:
        """Scale a mesh so that its longest side has a size in mm, and show the body."""
        if self.body is None:
            return
        try:
            self._options = NewOptions(size=size)
            body = scale_to_size(self.body, size)
        except DefsenseError as error:
            self._on_error(error)
            return
        self.size.value = size
        self.unit.value = UNKNOWN_UNIT
        self._show_body(body, body.unit)

    def create(self) -> None:
        """Write the device."""
        if self.body is None:
            return
        try:
            options = replace(
                self._options,
                name=self.name.value.strip(),
                material=self.material.value,
                edge_length=float(self.edge.value),
            )
            create_first_device(self.body, self._folder, options, is_draft=True)
        except DefsenseError as error:
            self._on_error(error)
            return
        self._on_created()

    def _show_body(self, body: BodyFile, unit: str) -> None:
        """Show the body in a unit, and the default edge length for it."""
        self.edge.value = body.edge_length(unit)
        self.size_text.content = _describe(body, unit)
        vertices = body.in_mm(unit).vertices
        scene = self._server.scene
        scene.add_mesh_simple(
            "/dropped",
            vertices,
            body.surface.faces,
            color=_BODY_COLOR,
            flat_shading=True,
        )
        scene.set_up_direction("+z")
        look_at_body(self._server, vertices)


def _describe(body: BodyFile, unit: str) -> str:
    """Return the size of the body, doubts about its unit, and repairs."""
    size = " × ".join(f"{x:.4g}" for x in body.size(unit))
    lines = [f"**{size} mm**"]
    if body.is_doubtful:
        lines.append("The file does not state its unit, and this size is a guess. Check it.")
    repairs = notable_repairs(body.repairs(unit))
    if repairs:
        lines.append(f"Repairs: {', '.join(repairs)}.")
    lines.append("One end of the body is held and the other is moved. You can change this later.")
    return "\n\n".join(lines)
