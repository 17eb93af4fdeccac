"""The mode in which the device is described: its body, of what it is made, and how finely it is
computed."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...runtime.view.camera import look_at_body
from ...workflow.build.build import freshness
from ..edits.body import set_parameter
from ..workbench.latest import Latest
from ..workbench.mode import Mode
from ..workbench.settled import Settled
from ..workbench.workbench import Workbench
from .body_preview import BodyPreview, body_of
from .catalogue_controls import CatalogueControls
from .device_words import body_words, build_words, material_words
from .parameter_controls import ParameterControls

_COLOR = (230, 159, 0)  # another than the body's that is built
_PARAMETER = "parameter:"
_ABOUT = 1.3  # between sizes that are seen from one place


class DeviceMode(Mode):
    """The body follows its parameters; what was simulated for another is told."""

    label = "Device"
    hint = "Set what the body is, and what it is made of; every step can be undone."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self._settled = Settled(self._take, bench.fail)
        self._states = Latest(self._look_at_build, bench.fail)
        self.preview = BodyPreview(self._making, self._made, self._failed)
        self._shown: Any = None  # the body that is not built yet, in the scene
        self._of: object = None  # what the last body was made from, or was to be
        self._script: object = None  # when its script was written
        self._wanted = False  # whether the body has changed, and is not made anew yet
        self._size: float | None = None  # mm, of the body at which the camera looks
        self._tried = False  # whether a body was to be made since the page began

    def add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        self._build = gui.add_markdown("")
        folder = gui.add_folder("Body")
        self._parameters = ParameterControls(
            gui, folder, lambda name, value: self._settled.give(_PARAMETER + name, value)
        )
        self._body = gui.add_markdown("")
        bench.button("Make the body", "Of its parameters as they are now", self.make_body)
        self._stop = bench.button(
            "Stop", "The script is ended; the body before stays", self.stop, visible=False
        )
        self.catalogue = CatalogueControls(gui, self._do, self._settled.give)
        self._facts = gui.add_markdown("")

    def enter(self) -> None:
        self._show_body()
        device = self.bench.project.device
        if self.bench.surface is None and not self._tried and not self._must_ask(device):
            self.make_body()

    def leave(self) -> None:
        if self._shown is not None:
            self._shown.visible = False
        if self.bench.body is not None:
            self.bench.body.visible = True

    def close(self) -> None:
        self._settled.close()
        self._states.close()
        self.preview.close()

    def built(self) -> None:
        self._body.content = body_words(self.bench.surface)
        if self.bench.surface is not None and self._size is None:
            self._size = self.bench.size

    def device_changed(self) -> None:
        device = self.bench.project.device
        self._show(device)
        before, self._of = self._of, body_of(device)
        self._wanted |= before is not None and before != self._of
        self._states.give(device)

    def look(self) -> None:
        """The script may have been written by another program."""
        device = self.bench.project.device
        before, self._script = self._script, _written(device)
        if before is None or before == self._script:
            return
        with self.bench.drawing:
            self._show(device)
        self._wanted = True
        self._states.give(device)

    def make_body(self) -> None:
        """Make the body as it is now, beside the page; a person is asked first whether its script
        may run."""
        self._tried, self._wanted = True, False
        if self.bench.may_run(self.make_body):
            self._body.content = "The body is being made ..."
            self._stop.visible = True
            self.preview.start(self.bench.project.folder)

    def stop(self) -> None:
        """End the script, which may never end by itself."""
        self.preview.cancel()
        self._stop.visible = False
        self._body.content = "Stopped: the body has not been made as it is now."

    def flush(self) -> None:
        """Take up what hands have changed, without waiting for them to rest."""
        self._settled.flush()

    def _follow(self, device: Device) -> None:
        """The body has changed."""
        self._wanted = False
        if self._must_ask(device):
            self._body.content = (
                f"`{device.body.path.name}` is not agreed to: *Make the body* asks whether it may"
                " run."
            )
        else:
            self.make_body()

    def _must_ask(self, device: Device) -> bool:
        try:
            return self.bench.agreement.asked(device.body) is not None
        except DefsenseError:
            return True

    def _do(self, edit: Any) -> None:
        if not self.bench.do(edit):
            with self.bench.drawing:
                self._show(self.bench.project.device)  # as it still is

    def _take(self, values: dict[str, Any]) -> None:
        """What hands have changed."""
        for key, value in values.items():
            if key.startswith(_PARAMETER):
                self._do(set_parameter(key.removeprefix(_PARAMETER), value))
            elif (edit := self.catalogue.settled(key, value)) is not None:
                self._do(edit)

    def _show(self, device: Device) -> None:
        self._parameters.show(device.body, lambda n: self._settled.pending(_PARAMETER + n))
        self.catalogue.show(device, self._settled.pending)
        self._facts.content = material_words(device)

    def _look_at_build(self, device: Device) -> None:
        states = freshness(device)
        self._build.content = build_words(states)
        if states["body"] == "current":
            self._wanted = False
            self.preview.cancel()
            self._stop.visible = False
            self._take_away()
        elif self._wanted:
            self._follow(device)

    def _take_away(self) -> None:
        """Back to the body that is built."""
        with self.bench.drawing:
            if self._shown is not None:
                self._shown.remove()
                self._shown = None
            self._body.content = body_words(self.bench.surface)
            self._show_body()

    def _making(self, _share: float, told: str) -> None:
        self._body.content = f"The body is being made ({told}) ..."

    def _made(self, surface: Surface) -> None:
        """There is a body; where nothing was built, it is the one of all modes."""
        self._stop.visible = False
        with self.bench.drawing:
            if self.bench.built:
                self._shown = self.bench.server.scene.add_mesh_simple(
                    "/device/body", surface.vertices.astype(np.float32),
                    surface.faces.astype(np.uint32), color=_COLOR, opacity=0.6,
                    flat_shading=True, visible=False,
                )  # fmt: skip
            else:
                self.bench.take_surface(surface)
            self._body.content = body_words(surface)
            self._show_body()
            self._look_at(surface)
        self._states.give(self.bench.project.device)

    def _look_at(self, surface: Surface) -> None:
        """From where it is all seen, unless it is about as large as the body that was looked at."""
        size = float(np.ptp(surface.vertices, axis=0).max())
        if self._size is None or not 1 / _ABOUT < size / self._size < _ABOUT:
            look_at_body(self.bench.server, surface.vertices)
            self._size = size

    def _failed(self, problem: str) -> None:
        self._stop.visible = False
        self._body.content = f"**{problem}**"

    def _show_body(self) -> None:
        """The newest body, where this mode is entered."""
        if self.bench.mode != self.label:
            return
        if self._shown is not None:
            self._shown.visible = True
        if self.bench.body is not None:
            self.bench.body.visible = self._shown is None


def _written(device: Device) -> object:
    try:
        found = device.body.path.stat()
    except OSError:
        return ()
    return (found.st_mtime_ns, found.st_size)
