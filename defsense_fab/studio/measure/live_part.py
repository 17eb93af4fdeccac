"""The controls of the live loop: the model, the source of signals and the outputs."""

from __future__ import annotations

from typing import Any

from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...workflow.run.choices import (
    TWIN,
    KnownModel,
    KnownPort,
    changed_since,
    is_built,
    known_models,
    known_ports,
)
from ...workflow.run.outputs import LIVE_FILE, read_settings
from ...workflow.run.run import LiveSettings
from ...workflow.view import LiveView, PagePlace
from ..workbench.controls import NONE
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText, bullet_list
from ..workbench.workbench import Workbench
from .live_session import LiveRequest, LiveSession
from .result_texts import decoder_error_text

_NO_MODEL = (
    "No model in this folder yet. Under *Training*, record a session and train on it, or train on"
    " the simulation alone."
)
_NOT_BUILT = "**The device is not built yet. Build it in *Make*.**"


class LivePart:
    """Folder of the panel that runs the device live.

    Outputs are sent only if the user chooses them.

    Args:
        bench: The workbench.
        mode_label: Label of the mode that has this part.

    Attributes:
        session: The run.
        folder: Folder of the panel that holds the controls.
        status: What the run does.
        model: The chosen model, or None.
        is_built: Whether the device has been built.
        changes: Sentences on the cords that differ from the build.
    """

    folder: Any

    def __init__(self, bench: Workbench, mode_label: str) -> None:
        self._bench, self._mode_label, self.status = bench, mode_label, StatusText()
        self.session = LiveSession(self.status, self._follow_run)
        self.is_built, self.changes = False, list[str]()
        self._search = LatestWorker(self._find_choices, self.status.show_error)
        self._models: list[KnownModel] = []
        self._ports: list[KnownPort] = []
        self._hides_body = False

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, bench = self._bench.server.gui, self._bench
        self.folder = gui.add_folder("Live")
        with self.folder:
            self._model = gui.add_dropdown(
                "Model", (NONE,), hint="Choose a model of the device's folder"
            )
            self._model.on_update(lambda _: self._describe_model())
            self._model_text = gui.add_markdown("")
            self._port = gui.add_dropdown(
                "Source",
                (NONE,),
                hint="Choose the simulated twin, a serial port or a recording",
            )
            with gui.add_folder("More", expand_by_default=False):
                self._other_port = gui.add_text(
                    "Other source",
                    "",
                    hint="Replace the source above, for example by udp://192.168.1.20,"
                    " replay:board.csv or twin:unit=2,cut=left@20-30",
                )
                self._outputs = gui.add_text(
                    "Outputs",
                    "",
                    hint="List the outputs, for example osc,port=9000; websocket. Default: none",
                )
                self._uses_file = gui.add_checkbox(
                    LIVE_FILE, False, hint="Also send the outputs of live.toml in the folder"
                )
                self._keeps_readings = gui.add_checkbox(
                    "Keep readings", True, hint="Save the readings in live/ of the device's folder"
                )
                bench.button("Refresh", "Search for models, ports and sessions again", self.refresh)
            self._start = bench.button("Start", "Run the device here", self.start, color="green")
            self._stop = bench.button("Stop", "End the live loop", self.stop, visible=False)
            self.status.add_panel(gui)

    @property
    def model(self) -> KnownModel | None:
        """The chosen model, or None."""
        return next((m for m in self._models if m.path.name == self._model.value), None)

    @property
    def model_names(self) -> tuple[str, ...]:
        """File names of the offered models."""
        return tuple(self._model.options)

    @property
    def source_names(self) -> tuple[str, ...]:
        """Labels of the offered sources of signals."""
        return tuple(self._port.options)

    @property
    def can_start(self) -> bool:
        """Whether the button that starts the run is visible."""
        return bool(self._start.visible)

    def set_source(self, port: str, *, keeps_readings: bool = True) -> None:
        """Use a source that is not offered, and choose whether its readings are saved."""
        self._other_port.value, self._keeps_readings.value = port, keeps_readings

    def set_outputs(self, outputs: str, *, uses_file: bool = False) -> None:
        """Set the outputs, and choose whether those of live.toml are sent too."""
        self._outputs.value, self._uses_file.value = outputs, uses_file

    def enter(self) -> None:
        """Follow the activation of the mode."""
        if self.session.is_busy:
            self._bench.status.show("")  # the mode shows that it continues
        self.refresh()
        self._show_run()

    def leave(self) -> None:
        """Follow the activation of another mode; the run continues."""
        self._show_run(is_active=False)
        if self.session.is_busy:
            self._bench.status.show(
                f"The live loop continues. Press *Stop* in {self._mode_label} to end it.",
                "live-continues",
            )

    def refresh(self) -> None:
        """Search for models and ports on a thread."""
        self._search.give(self._bench.project.device)

    def wait_for_choices(self, timeout_s: float) -> bool:
        """Wait until the search has ended; return False after `timeout_s`."""
        return self._search.wait(timeout_s)

    def start(self) -> None:
        """Run the chosen model, or show why it cannot run."""
        model = self.model
        if model is None:
            self.status.show_problem(_NO_MODEL, "no-model")
            return
        if model.problem is not None:
            self.status.show_problem(model.problem, "model-unusable")
            return
        try:
            settings = self._settings()
        except DefsenseError as error:
            self.status.show_error(error)
            return
        request = LiveRequest(
            model.path,
            self._bench.project.folder,
            self._chosen_port(),
            settings,
            PagePlace(self._bench.server, self.folder),
            self._keeps_readings.value,
        )
        if not self.session.start(request):
            self.status.show("The live loop is running or ending. Stop it first.", "busy")
            return
        self._show_buttons(is_running=True)

    def stop(self) -> None:
        """Stop the run; the body reappears once it has ended."""
        self.status.show("Stopping ...")
        self.session.stop()

    def close(self) -> None:
        """End the run and the threads."""
        self.session.close()
        self._search.close()

    def _settings(self) -> LiveSettings:
        folder = self._bench.project.folder
        words = [word.strip() for word in self._outputs.value.split(";")]
        return read_settings(
            folder,
            folder / LIVE_FILE if self._uses_file.value else None,
            [word for word in words if word],
            sends_to_file_outputs=self._uses_file.value,
        )

    def _chosen_port(self) -> str:
        ports = {p.label: p.port for p in self._ports}
        return self._other_port.value.strip() or ports.get(self._port.value, TWIN)

    def _follow_run(self) -> None:
        """Follow the start or the end of a run."""
        with self._bench.drawing_lock:
            is_running = self.session.run is not None
            self._show_buttons(is_running=is_running)
            self._show_run()
        if not is_running:
            self.refresh()  # the saved readings can be replayed

    def _show_buttons(self, *, is_running: bool) -> None:
        self._start.visible, self._stop.visible = not is_running, is_running

    def _show_run(self, *, is_active: bool = True) -> None:
        """Show the moving device in place of the body, in this mode and while it runs."""
        is_active = is_active and self._bench.mode == self._mode_label
        run, body = self.session.run, self._bench.body
        if run is not None and isinstance(run.view, LiveView):
            run.view.scene.visible = is_active
        hides_body = is_active and run is not None
        if body is not None and hides_body != self._hides_body:
            body.visible = not hides_body
        self._hides_body = hides_body

    def _find_choices(self, device: Device) -> None:
        models, ports = known_models(device), known_ports(device)
        with self._bench.drawing_lock:
            self._models, self._ports = models, ports
            self._model.options = tuple(m.path.name for m in models) or (NONE,)
            self._port.options = tuple(dict.fromkeys(p.label for p in ports))
        self._describe_model()

    def _describe_model(self) -> None:
        device, model = self._bench.project.device, self.model
        self.is_built = is_built(device)
        self.changes = []
        if model is None:
            text = _NO_MODEL if self.is_built else f"{_NO_MODEL}\n\n{_NOT_BUILT}"
            self._model_text.content = text
            return
        parts = [model.about, f"**{model.problem}**" if model.problem else ""]
        parts += [self._compare_with_build(device), decoder_error_text(model.metadata)]
        self._model_text.content = "\n\n".join(part for part in parts if part)

    def _compare_with_build(self, device: Device) -> str:
        """Return how the cords differ from the build in markdown."""
        if not self.is_built:
            return _NOT_BUILT
        try:
            self.changes = changed_since(device)
        except DefsenseError as error:
            return f"**{error}**"
        if not self.changes:
            return ""
        return (
            "The cords have changed since the build. The built cords are used:\n\n"
            + bullet_list(self.changes)
        )
