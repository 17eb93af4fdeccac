"""The mode in which the user describes the device: body, materials, mesh and decoder."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...workflow.build.build import freshness
from ...workflow.view import look_at_body
from ..edits.body import set_parameter
from ..edits.edit import Edit
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .body_preview import BodyPreview, body_key
from .catalogue_controls import CatalogueControls
from .parameter_controls import ParameterControls

_PREVIEW_COLOR = (230, 159, 0)  # differs from the color of a built body
_MAX_SIZE_RATIO = 1.3  # between bodies for which the camera stays
_REST_S = 0.4  # time without a new value after which a control is taken to rest
#: Kind and name of a value that the user has changed: a parameter of the script, or another value.
_Key = tuple[Literal["parameter", "value"], str]
#: What to do if a stage is the first whose results belong to an earlier device.
_OUTDATED_TEXTS = {
    "body": "The poses were simulated for an earlier body. Simulate them again.",
    "mesh": "The poses were simulated with another mesh or other regions. Simulate them again.",
    "simulate": "The material or the poses have changed. Simulate the poses again.",
    "optimize": "The cords were optimized for other settings. Optimize them again.",
    "fabricate": "The parts belong to an earlier device. Build them again.",
    "report": "The report belongs to an earlier device. Build everything again.",
}
_STAGE_RESULTS = {
    "body": "body",
    "mesh": "mesh",
    "simulate": "poses",
    "optimize": "cords",
    "fabricate": "parts",
    "report": "report",
}


class DeviceMode(Mode):
    """The body follows its parameters; outdated results of the build are named.

    Attributes:
        preview: Makes the body without a build.
        parameters: Controls of the body's parameters.
        catalogue: Controls of the material, cord, printer, mesh and decoder.
        status: The text on the body. Its code is "making" while the body is being made, "stopped"
            or that of the error if it was not made, "not-agreed" if the user has to agree to its
            script, else "idle".
        has_tried_body: Whether a body was requested since the page opened.
        build_states: State of each stage of the build: "current", "old" or "missing".
    """

    label = "Device"
    hint = "Set the body and its materials. Every step can be undone."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self._edits = LatestWorker[dict[_Key, Any]](
            self._apply_values, bench.status.show_error, delay_s=_REST_S, merge=operator.or_
        )
        self._build_checks = LatestWorker(self._check_build, bench.status.show_error)
        self.preview = BodyPreview(self._show_progress, self._show_surface, self._show_failure)
        self.status = StatusText("", "idle")
        self.has_tried_body = False
        self.build_states: dict[str, str] = {}
        self._preview_mesh: Any = None  # the body in the scene that is not built yet
        self._body_key: object = None  # settings of the last body that was made or requested
        self._script_stamp: object = None
        self._is_body_outdated = False
        self._camera_size: float | None = None  # mm, of the body that the camera shows

    @property
    def outdated_stage(self) -> str | None:
        """The first stage of the build whose result belongs to an earlier device."""
        return first_outdated_stage(self.build_states)

    @property
    def is_preview_visible(self) -> bool:
        """Whether a body that is not built yet is shown."""
        return self._preview_mesh is not None and bool(self._preview_mesh.visible)

    def add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        self._build_text = gui.add_markdown("")
        folder = gui.add_folder("Body")
        self.parameters = ParameterControls(
            gui, folder, lambda name, value: self._edits.give({("parameter", name): value})
        )
        self.status.add_panel(gui)
        bench.button("Make the body", "Run the script with the current parameters", self.make_body)
        self._stop = bench.button(
            "Stop", "Stop the script and keep the previous body", self.stop, visible=False
        )
        self.catalogue = CatalogueControls(
            gui, self._apply, lambda key, value: self._edits.give({("value", key): value})
        )
        self._materials_text = gui.add_markdown("")

    def enter(self) -> None:
        self._update_visibility()
        device = self.bench.project.device
        has_body = self.bench.surface is not None or self.has_tried_body
        if not has_body and not self._must_ask(device):
            self.make_body()

    def leave(self) -> None:
        if self._preview_mesh is not None:
            self._preview_mesh.visible = False
        if self.bench.body is not None:
            self.bench.body.visible = True

    def close(self) -> None:
        self._edits.flush()  # no change is lost
        self._edits.close()
        self._build_checks.close()
        self.preview.close()

    def on_build_loaded(self) -> None:
        text = describe_body(self.bench.surface)
        self.status.show(text, self.status.code, self.status.error)
        if self.bench.surface is not None and self._camera_size is None:
            self._camera_size = self.bench.size

    def on_device_changed(self) -> None:
        device = self.bench.project.device
        self._show_device(device)
        before, self._body_key = self._body_key, body_key(device)
        self._is_body_outdated |= before is not None and before != self._body_key
        self._build_checks.give(device)

    def poll(self) -> None:
        """Follow changes of the script by another program."""
        device = self.bench.project.device
        before, self._script_stamp = self._script_stamp, _file_stamp(device)
        if before is None or before == self._script_stamp:
            return
        with self.bench.drawing_lock:
            self._show_device(device)
        self._is_body_outdated = True
        self._build_checks.give(device)

    def make_body(self) -> None:
        """Make the body in the background, after asking whether its script may run."""
        self.has_tried_body, self._is_body_outdated = True, False
        if self.bench.may_run_script(self.make_body):
            self._set_state("making", "The body is being made ...")
            self.preview.start(self.bench.project.folder)

    def stop(self) -> None:
        """Stop the script, which may run forever."""
        self.preview.cancel()
        self._set_state("stopped", "Stopped. The body shown is an earlier one.")

    def flush(self) -> None:
        """Apply the values that the user has changed now."""
        self._edits.flush()

    def wait(self, timeout_s: float) -> bool:
        """Wait until the build has been checked; return False after `timeout_s`."""
        return self._build_checks.wait(timeout_s)

    def _set_state(
        self, state: Literal["idle", "making", "stopped", "not-agreed"], text: str
    ) -> None:
        self._stop.visible = state == "making"
        self.status.show(text, state)

    def _follow_body(self, device: Device) -> None:
        """Make the changed body, if its script may run."""
        self._is_body_outdated = False
        if not self._must_ask(device):
            self.make_body()
            return
        self._set_state(
            "not-agreed",
            f"`{device.body.path.name}` has not run yet. Press *Make the body* to allow it.",
        )

    def _must_ask(self, device: Device) -> bool:
        try:
            return self.bench.agreement.script_to_confirm(device.body) is not None
        except DefsenseError:
            return True

    def _apply(self, edit: Edit) -> None:
        if not self.bench.apply(edit):
            with self.bench.drawing_lock:
                self._show_device(self.bench.project.device)  # restore the controls

    def _apply_values(self, values: dict[_Key, Any]) -> None:
        """Apply the values that the user has changed."""
        for (kind, name), value in values.items():
            if kind == "parameter":
                self._apply(set_parameter(name, value))
            elif (edit := self.catalogue.edit_for(name, value)) is not None:
                self._apply(edit)

    def _is_pending(self, kind: Literal["parameter", "value"], name: str) -> bool:
        return (kind, name) in (self._edits.pending or {})

    def _show_device(self, device: Device) -> None:
        self.parameters.show(device.body, lambda name: self._is_pending("parameter", name))
        self.catalogue.show(device, lambda name: self._is_pending("value", name))
        self._materials_text.content = describe_materials(device)

    def _check_build(self, device: Device) -> None:
        self.build_states = dict(freshness(device))
        self._build_text.content = describe_build(self.build_states)
        if self.build_states["body"] == "current":
            self._is_body_outdated = False
            self.preview.cancel()
            self._stop.visible = False
            self._remove_preview()
        elif self._is_body_outdated:
            self._follow_body(device)

    def _remove_preview(self) -> None:
        """Show the built body again."""
        with self.bench.drawing_lock:
            if self._preview_mesh is not None:
                self._preview_mesh.remove()
                self._preview_mesh = None
            self._set_state("idle", describe_body(self.bench.surface))
            self._update_visibility()

    def _show_progress(self, _share: float, message: str) -> None:
        self.status.show(f"The body is being made ({message}) ...", "making")

    def _show_surface(self, surface: Surface) -> None:
        """Show a new body; without a build it is the body of all modes."""
        self._stop.visible = False
        with self.bench.drawing_lock:
            if self.bench.is_built:
                self._preview_mesh = self.bench.server.scene.add_mesh_simple(
                    "/device/body",
                    surface.vertices,
                    surface.faces,
                    color=_PREVIEW_COLOR,
                    opacity=0.6,
                    flat_shading=True,
                    visible=False,
                )
            else:
                self.bench.show_surface(surface)
            self._set_state("idle", describe_body(surface))
            self._update_visibility()
            self._look_at(surface)
        self._build_checks.give(self.bench.project.device)

    def _look_at(self, surface: Surface) -> None:
        """Move the camera to show the whole body, unless its size has hardly changed."""
        size = float(np.ptp(surface.vertices, axis=0).max())
        previous = self._camera_size
        if previous is None or not 1 / _MAX_SIZE_RATIO < size / previous < _MAX_SIZE_RATIO:
            look_at_body(self.bench.server, surface.vertices)
            self._camera_size = size

    def _show_failure(self, error: DefsenseError) -> None:
        self._stop.visible = False
        self.status.show_error(error)

    def _update_visibility(self) -> None:
        """Show the newest body while this mode is active."""
        if not self.is_active:
            return
        if self._preview_mesh is not None:
            self._preview_mesh.visible = True
        if self.bench.body is not None:
            self.bench.body.visible = self._preview_mesh is None


def first_outdated_stage(states: Mapping[str, str]) -> str | None:
    """Return the first stage whose result belongs to an earlier device.

    Returns:
        The stage's name; None if nothing is outdated, or nothing is simulated yet.
    """
    if all(states.get(name, "missing") == "missing" for name in ("simulate", "optimize")):
        return None
    return next((name for name, state in states.items() if state == "old"), None)


def describe_build(states: Mapping[str, str]) -> str:
    """Return one sentence on outdated results of the build, or else on its current ones."""
    present = [name for name, state in states.items() if state != "missing"]
    if not {"simulate", "optimize"} & set(present):
        return "Nothing is simulated yet."
    outdated = first_outdated_stage(states)
    if outdated is not None:
        return f"**{_OUTDATED_TEXTS[outdated]}**"
    return f"Up to date: {', '.join(_STAGE_RESULTS[name] for name in present)}."


def describe_body(surface: Surface | None) -> str:
    """Return the size and volume of the body as text."""
    if surface is None:
        return "The body has not been made yet. Press *Make the body*."
    size = " × ".join(f"{x:.4g}" for x in np.ptp(surface.vertices, axis=0))
    return f"{size} mm, {surface.volume / 1000:.4g} cm³"


def describe_materials(device: Device) -> str:
    """Return the properties of the material, cord and printer that matter for the design."""
    m, c, f = device.material, device.cord, device.fabrication
    return (
        f"Material: {m.young_modulus:.3g} MPa, Poisson's ratio {m.poisson_ratio:g}."
        f" Cord: diameter {c.diameter:g} mm, {c.ohm_per_mm:g} ohm/mm, bend radius at least"
        f" {c.min_bend_radius:g} mm. Printer: walls of {f.wall:g} mm, channels"
        f" {f.clearance:g} mm wider than the cord."
    )


def _file_stamp(device: Device) -> object:
    """Return the time and size of the script, which differ after a change."""
    try:
        status = device.body.path.stat()
    except OSError:
        return ()
    return (status.st_mtime_ns, status.st_size)
