"""The device live on the page: which model, from which port, where its poses go."""

from __future__ import annotations

from typing import Any

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...runtime.live.run_choices import known_models, KnownModel
from ...runtime.live.run_choices import known_ports, KnownPort
from ...runtime.live.live_run import RunOptions
from ...runtime.live.run_choices import changed_since
from ...runtime.outputs.live_file import LiveSettings, parse_output, read_live_file
from ...runtime.view.live_view import PagePlace
from ...store.layout import LAYOUT, load_layout
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .live_session import LiveSession
from .result_texts import notes_list, test_words

_NONE = "none"
_NO_MODEL = (
    "There is no model in this folder yet. Under *Training*, record a session and train on it, or"
    " take a model of the simulation alone."
)
_NOT_BUILT = "**The device is not built: build it under *Make*.**"
_LIVE = "live.toml"


class LivePart:
    """A folder of the panel. Outputs are sent only where they are chosen."""

    def __init__(self, bench: Workbench, label: str) -> None:
        """Of the mode with that label."""
        self._bench, self._label = bench, label
        self.session = LiveSession(self._tell, self._changed)
        self._looking = LatestWorker(self._look, self._failed)
        self._models: list[KnownModel] = []
        self._ports: list[KnownPort] = []
        self._hidden = False  # the workbench's body, by this

    def add_panel(self) -> None:
        gui, bench = self._bench.server.gui, self._bench
        self._folder = gui.add_folder("Live")
        with self._folder:
            self._model = gui.add_dropdown("Model", (_NONE,), hint="Of the device's folder")
            self._model.on_update(lambda _: self._about())
            self._known = gui.add_markdown("")
            self._port = gui.add_dropdown(
                "From", (_NONE,), hint="The simulated twin, a serial port, or what was recorded"
            )
            with gui.add_folder("More", expand_by_default=False):
                self._other = gui.add_text(
                    "Other port", "",
                    hint="In place of the one above: socket://host:port, replay:board.csv,"
                    " twin:unit=2,cut=left@20-30",
                )  # fmt: skip
                self._outputs = gui.add_text(
                    "Outputs", "", hint="None, unless written here: osc,port=9000; websocket"
                )
                self._file = gui.add_checkbox(
                    _LIVE, False, hint="Send the outputs of the folder's live.toml, too"
                )
                self._keep = gui.add_checkbox(
                    "Keep readings", True, hint="In live/ of the device's folder"
                )
                bench.button("Look again", "For models, ports and sessions", self.refresh)
            self._start = bench.button("Start", "Run the device here", self.start, color="green")
            self._stop = bench.button("Stop", "End the live loop", self.stop, visible=False)
            self._told = gui.add_markdown("")

    def enter(self) -> None:
        """Its mode is shown."""
        if self.session.busy:
            self._bench.show_message("")  # that it goes on is seen
        self.refresh()
        self._show()

    def leave(self) -> None:
        """Another mode is shown: the loop goes on."""
        self._show(shown=False)
        if self.session.busy:
            self._bench.show_message(f"The live loop goes on; *Stop* in {self._label} ends it.")

    def refresh(self) -> None:
        """Look for models and ports; on a thread."""
        self._looking.give(self._bench.project.device)

    def looked(self, seconds: float) -> bool:
        """Whether that is done within so many s."""
        return self._looking.wait(seconds)

    def start(self) -> None:
        """Run the chosen model. Raises DefsenseError for outputs that are none."""
        known = self._chosen()
        if known is None:
            self._tell(f"**{_NO_MODEL}**")
            return
        if known.problem is not None:
            self._tell(f"**{known.problem}**")
            return
        try:
            options = self._options()
        except DefsenseError as error:
            self._tell(f"**{error}**")
            return
        if not self.session.start(known.path, self._bench.project.folder, options):
            self._tell("The live loop runs, or is just ending; stop it first.")
            return
        self._buttons(busy=True)

    def stop(self) -> None:
        """End it; the body comes back once it has ended."""
        self._tell("Stopping ...")
        self.session.stop()

    def close(self) -> None:
        self.session.close()
        self._looking.close()

    def _options(self) -> RunOptions:
        folder = self._bench.project.folder
        path = folder / _LIVE
        said = read_live_file(path) if path.exists() else LiveSettings()
        words = [word.strip() for word in self._outputs.value.split(";")]
        outputs = tuple(parse_output(word) for word in words if word)
        if self._file.value:
            if not path.exists():
                read_live_file(path)  # says that it is not there
            outputs = (*said.outputs, *outputs)
        by = {p.label: p.port for p in self._ports}
        port = self._other.value.strip() or by.get(self._port.value, "twin")
        return RunOptions(
            port=port, view=PagePlace(self._bench.server, self._folder), outputs=outputs,
            controls=said.controls, keep=self._keep.value,
            live_file=path if path.exists() else None,
        )  # fmt: skip

    def _chosen(self) -> KnownModel | None:
        return next((m for m in self._models if m.path.name == self._model.value), None)

    def _tell(self, told: str) -> None:
        self._told.content = told

    def _failed(self, error: Exception) -> None:
        self._tell(f"**{error}**")

    def _changed(self) -> None:
        """It runs, or has ended."""
        with self._bench.drawing_lock:
            running = self.session.run is not None
            self._buttons(busy=running)
            self._show()
        if not running:
            self.refresh()  # the readings that were kept can be played

    def _buttons(self, *, busy: bool) -> None:
        self._start.visible, self._stop.visible = not busy, busy

    def _show(self, *, shown: bool = True) -> None:
        """The device as it moves in place of the body, in this mode and while it runs."""
        shown = shown and self._bench.mode == self._label
        run, body = self.session.run, self._bench.body
        if run is not None and run.view is not None:
            run.view.scene.visible = shown
        hide = shown and run is not None
        if body is not None and hide != self._hidden:
            body.visible = not hide
        self._hidden = hide

    def _look(self, device: Device) -> None:
        models, ports = known_models(device), known_ports(device)
        with self._bench.drawing_lock:
            self._models, self._ports = models, ports
            _offer(self._model, tuple(m.path.name for m in models) or (_NONE,))
            _offer(self._port, tuple(dict.fromkeys(p.label for p in ports)))
        self._about()

    def _about(self) -> None:
        known = self._chosen()
        if known is None:
            built = build_folder(self._bench.project.device) / LAYOUT
            self._known.content = _NO_MODEL if built.exists() else f"{_NO_MODEL}\n\n{_NOT_BUILT}"
            return
        parts = [known.about, f"**{known.problem}**" if known.problem else ""]
        parts += [self._since_build(), test_words(known.metadata)]
        self._known.content = "\n\n".join(part for part in parts if part)

    def _since_build(self) -> str:
        device = self._bench.project.device
        built = build_folder(device)
        if not (built / LAYOUT).exists():
            return _NOT_BUILT
        try:
            changes = changed_since(device, load_layout(built))
        except DefsenseError as error:
            return f"**{error}**"
        if not changes:
            return ""
        return (
            "The cords have been changed or renamed since the build, and it is the built ones that"
            " run:\n\n" + notes_list(changes)
        )


def _offer(dropdown: Any, options: tuple[str, ...]) -> None:
    """Other options, the chosen one kept where it is still there."""
    if tuple(dropdown.options) == options:
        return
    kept = dropdown.value
    dropdown.options = options
    dropdown.value = kept if kept in options else options[0]
