"""What is asked of a body that was dropped, before it becomes a device."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import DefsenseError
from ...core.storage.package_data import read_rows
from ...runtime.view.camera import look_at_body
from ...workflow.starts.dropped_body import DroppedBody, worth_telling
from ...workflow.starts.first_device import FirstDevice, begin_from
from ...workflow.starts.units import UNITS

_COLOR = (230, 159, 0)
_MATERIAL = "tango-black-plus"


class BodyForm:
    """Unseen until a body is there. `begun` is called once the device is written, `failed` with
    what was refused."""

    def __init__(
        self,
        server: Any,
        folder: Path,
        begun: Callable[[], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._server, self._folder = server, folder
        self._begun, self._failed = begun, failed
        self._body: DroppedBody | None = None
        gui = server.gui
        self.panel = gui.add_folder("Your body", visible=False)
        with self.panel:
            self.words = gui.add_markdown("")
            self.unit = gui.add_dropdown("Unit", tuple(UNITS), hint="Of the file's lengths")
            self.name = gui.add_text("Name", "", hint="Of the device")
            self.material = gui.add_dropdown(
                "Material", tuple(read_rows("materials.csv")), initial_value=_MATERIAL
            )
            self.edge = gui.add_number("Edge length, mm", 1.0, min=0.0, step=0.1,
                                       hint="Of the mesh; a fifth of the thickness")  # fmt: skip
            gui.add_button("Begin with it", color="blue").on_click(lambda _: self.begin())
        self.unit.on_update(self._chosen)

    def show(self, body: DroppedBody) -> None:
        """A body that can be read."""
        self._body = body
        self.name.value = body.name
        self.unit.visible = body.key == "mesh"
        self.panel.visible = True
        self.choose(body.unit)

    def choose(self, unit: str) -> None:
        """The file is in this unit."""
        body = self._body
        if body is None:
            return
        if self.unit.value != unit:
            self.unit.value = unit
        self.edge.value = body.edge_length(unit)
        size = " × ".join(f"{x:.4g}" for x in body.size(unit))
        words = [f"**{size} mm**"]
        if body.doubtful:
            words.append("The file does not say its unit, and this is a guess: is it so large?")
        mended = worth_telling(body.repairs(unit))
        if mended:
            words.append(f"Mended: {', '.join(mended)}.")
        words.append("It is held at one end and moved at the other, until you say otherwise.")
        self.words.content = "\n\n".join(words)
        vertices = body.in_mm(unit).vertices
        scene = self._server.scene
        scene.add_mesh_simple(
            "/dropped", vertices.astype(np.float32), body.surface.faces.astype(np.uint32),
            color=_COLOR, flat_shading=True,
        )  # fmt: skip
        scene.set_up_direction("+z")
        look_at_body(self._server, vertices)

    def _chosen(self, event: Any) -> None:
        if event.client is not None:  # not set by the page itself
            self.choose(self.unit.value)

    def begin(self) -> None:
        """Write the device."""
        if self._body is None:
            return
        try:
            first = FirstDevice(
                self.name.value.strip(), self.unit.value, self.material.value,
                float(self.edge.value),
            )  # fmt: skip
            begin_from(self._body, self._folder, first)
        except DefsenseError as error:
            self._failed(error)
            return
        self._begun()
