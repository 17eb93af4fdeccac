"""The controls of the live loop: the model, the source of signals and the outputs."""

from __future__ import annotations

from typing import Any

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...runtime.live.live_run import RunOptions
from ...runtime.live.run_choices import (
    KnownModel,
    KnownPort,
    changed_since,
    known_models,
    known_ports,
)
from ...runtime.outputs.live_file import LiveSettings, parse_output, read_live_file
from ...runtime.view.live_view import PagePlace
from ...store.layout import LAYOUT, load_layout
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .live_session import LiveSession
from .result_texts import StatusText, bullet_list, decoder_error_text

_NONE = "none"
_NO_MODEL = (
    "No model in this folder yet. Under *Training*, record a session and train on it, or train on"
    " the simulation alone."
)
_NOT_BUILT = "**The device is not built yet. Build it in *Make*.**"
_LIVE_FILE = "live.toml"


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
    status: StatusText

    def __init__(self, bench: Workbench, mode_label: str) -> None:
        self._bench, self._mode_label = bench, mode_label
        self.session = LiveSession(self._show_status, self._follow_run)
        self.is_built, self.changes = False, list[str]()
        self._search = LatestWorker(self._find_choices, self._show_error)
        self._models: list[KnownModel] = []
        self._ports: list[KnownPort] = []
        self._hides_body = False

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, bench = self._bench.server.gui, self._bench
        self.folder = gui.add_folder("Live")
        with self.folder:
            self._model = gui.add_dropdown(
                "Model", (_NONE,), hint="Choose a model of the device's folder"
            )
            self._model.on_update(lambda _: self._describe_model())
            self._model_text = gui.add_markdown("")
            self._port = gui.add_dropdown(
                "Source",
                (_NONE,),
                hint="Choose the simulated twin, a serial port or a recording",
            )
            with gui.add_folder("More", expand_by_default=False):
                self._other_port = gui.add_text(
                    "Other source",
                    "",
                    hint="Replace the source above, for example by socket://host:port,"
                    " replay:board.csv or twin:unit=2,cut=left@20-30",
                )
                self._outputs = gui.add_text(
                    "Outputs",
                    "",
                    hint="List the outputs, for example osc,port=9000; websocket. Default: none",
                )
                self._uses_file = gui.add_checkbox(
                    _LIVE_FILE, False, hint="Also send the outputs of live.toml in the folder"
                )
                self._keeps_readings = gui.add_checkbox(
                    "Keep readings", True, hint="Save the readings in live/ of the device's folder"
                )
                bench.button("Refresh", "Search for models, ports and sessions again", self.refresh)
            self._start = bench.button("Start", "Run the device here", self.start, color="green")
            self._stop = bench.button("Stop", "End the live loop", self.stop, visible=False)
            self.status = StatusText(gui)

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
        if self.session.busy:
            self._bench.show_message("")  # the mode shows that it continues
        self.refresh()
        self._show_run()

    def leave(self) -> None:
        """Follow the activation of another mode; the run continues."""
        self._show_run(is_active=False)
        if self.session.busy:
            self._bench.show_message(
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
            options = self._options()
        except DefsenseError as error:
            self.status.show_error(error)
            return
        if not self.session.start(model.path, self._bench.project.folder, options):
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

    def _options(self) -> RunOptions:
        path = self._bench.project.folder / _LIVE_FILE
        settings = read_live_file(path) if path.exists() else LiveSettings()
        words = [word.strip() for word in self._outputs.value.split(";")]
        outputs = tuple(parse_output(word) for word in words if word)
        if self._uses_file.value:
            if not path.exists():
                read_live_file(path)  # raises the error of a missing file
            outputs = (*settings.outputs, *outputs)
        ports = {p.label: p.port for p in self._ports}
        return RunOptions(
            port=self._other_port.value.strip() or ports.get(self._port.value, "twin"),
            view=PagePlace(self._bench.server, self.folder),
            outputs=outputs,
            controls=settings.controls,
            keep=self._keeps_readings.value,
            live_file=path if path.exists() else None,
        )

    def _show_status(self, text: str, error: Exception | None) -> None:
        code = error.code if isinstance(error, DefsenseError) else ""
        self.status.show(text, code)
        self.status.error = error

    def _show_error(self, error: Exception) -> None:
        self.status.show_error(error)

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
        if run is not None and run.view is not None:
            run.view.scene.visible = is_active
        hides_body = is_active and run is not None
        if body is not None and hides_body != self._hides_body:
            body.visible = not hides_body
        self._hides_body = hides_body

    def _find_choices(self, device: Device) -> None:
        models, ports = known_models(device), known_ports(device)
        with self._bench.drawing_lock:
            self._models, self._ports = models, ports
            _offer(self._model, tuple(m.path.name for m in models) or (_NONE,))
            _offer(self._port, tuple(dict.fromkeys(p.label for p in ports)))
        self._describe_model()

    def _describe_model(self) -> None:
        device, model = self._bench.project.device, self.model
        self.is_built = (build_folder(device) / LAYOUT).exists()
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
            self.changes = changed_since(device, load_layout(build_folder(device)))
        except DefsenseError as error:
            return f"**{error}**"
        if not self.changes:
            return ""
        return (
            "The cords have changed since the build. The built cords are used:\n\n"
            + bullet_list(self.changes)
        )


def _offer(dropdown: Any, options: tuple[str, ...]) -> None:
    """Offer other options, and keep the chosen one if it still exists."""
    if tuple(dropdown.options) == options:
        return
    chosen = dropdown.value
    dropdown.options = options
    dropdown.value = chosen if chosen in options else options[0]
