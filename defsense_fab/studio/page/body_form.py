"""The form that turns an uploaded body into a device."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import DefsenseError
from ...core.storage.package_data import read_rows
from ...runtime.view.camera import look_at_body
from ...workflow.starts.dropped_body import DroppedBody, notable_repairs
from ...workflow.starts.first_device import FirstDevice, create_first_device
from ...workflow.starts.units import UNITS

_BODY_COLOR = (230, 159, 0)
_DEFAULT_MATERIAL = "tango-black-plus"


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
        unit: Unit of the file.
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
        self.body: DroppedBody | None = None
        gui = server.gui
        self.panel = gui.add_folder("Uploaded body", visible=False)
        with self.panel:
            self.size_text = gui.add_markdown("")
            self.unit = gui.add_dropdown(
                "Unit", tuple(UNITS), hint="Set the unit of lengths in the file"
            )
            self.name = gui.add_text("Name", "", hint="Name the device")
            self.material = gui.add_dropdown(
                "Material", tuple(read_rows("materials.csv")), initial_value=_DEFAULT_MATERIAL
            )
            self.edge = gui.add_number(
                "Edge length (mm)", 1.0, min=0.0, step=0.1,
                hint="Set the edge length of the mesh; a fifth of the body's thickness is enough",
            )  # fmt: skip
            gui.add_button("Create the device", color="blue").on_click(lambda _: self.create())
        self.unit.on_update(self._on_unit)

    def show(self, body: DroppedBody) -> None:
        """Show the form for a body."""
        self.body = body
        self.name.value = body.name
        self.unit.visible = body.key == "mesh"
        self.panel.visible = True
        self.choose_unit(body.unit)

    def choose_unit(self, unit: str) -> None:
        """Interpret the file in a unit, and show the body."""
        body = self.body
        if body is None:
            return
        if self.unit.value != unit:
            self.unit.value = unit
        self.edge.value = body.edge_length(unit)
        self.size_text.content = _describe(body, unit)
        vertices = body.in_mm(unit).vertices
        scene = self._server.scene
        scene.add_mesh_simple(
            "/dropped",
            vertices.astype(np.float32),
            body.surface.faces.astype(np.uint32),
            color=_BODY_COLOR,
            flat_shading=True,
        )
        scene.set_up_direction("+z")
        look_at_body(self._server, vertices)

    def create(self) -> None:
        """Write the device."""
        if self.body is None:
            return
        try:
            first = FirstDevice(
                self.name.value.strip(),
                self.unit.value,
                self.material.value,
                float(self.edge.value),
            )
            create_first_device(self.body, self._folder, first)
        except DefsenseError as error:
            self._on_error(error)
            return
        self._on_created()

    def _on_unit(self, event: Any) -> None:
        if event.client is not None:  # otherwise the page itself has set the value
            self.choose_unit(self.unit.value)


def _describe(body: DroppedBody, unit: str) -> str:
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
