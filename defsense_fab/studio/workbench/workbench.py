"""The device, its build and the page's server, which the modes work on."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...core.device.device import Device
from ...core.errors import DefsenseError, StorageError
from ...core.mesh import Surface
from ...workflow.build.results import Build, has_poses, last_build
from ...workflow.design.layout_judge import LayoutJudge
from ...workflow.view import look_at_body
from ..edits.edit import Edit
from ..project.agreement import Agreement
from ..project.project import Project
from .background_job import BackgroundJob
from .build_job import CandidateLayout, run_build
from .latest_worker import LatestWorker
from .page_texts import StatusText
from .script_question import ScriptQuestion

_BODY_COLOR = (150, 180, 205)
_DEFAULT_SIZE_MM = 100.0  # of the scene while there is no body
_MODIFIER_LABELS = {None: "", "cmd/ctrl": "Ctrl+", "cmd/ctrl+shift": "Ctrl+Shift+"}


class Workbench:
    """Shared state of the modes of one project, on a viser server; all browsers see the same.

    Args:
        server: The viser server.
        project: The folder of the device.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        question: Dialog that asks whether the body's script may run.
        drawing_lock: Held while the scene or the panel changes; buttons, gizmos and builds have
            threads of their own.
        mode: Label of the active mode.
        results: Results of the last build, each read when it is first used.
        surface: The body at rest, or None until it has been made.
        is_built: Whether `surface` belongs to a build.
        judge: Predicts the error of cords; None until the poses are simulated.
        body: The body's mesh in the scene; the active mode sets its `visible`.
        keys: Keyboard shortcuts and their descriptions.
        builds: The build in the background.
        status: The last message or error.
        build_error: Error of the last build, or None.
        on_build_started: Called when a build starts.
        on_layout_found: Called with each layout that the build's search tries, on the build's
            thread: return quickly.
        on_build_loaded: Called after a build, successful or not, and after a change of the body
            or the judge.
    """

    def __init__(self, server: Any, project: Project, agreement: Agreement | None = None) -> None:
        self.server, self.project = server, project
        self.agreement = agreement or Agreement()
        self.question = ScriptQuestion(server)
        self.drawing_lock = threading.RLock()
        self.mode = ""
        self.results: Build = last_build(project.device)
        self.surface: Surface | None = None
        self.is_built = False
        self.judge: LayoutJudge | None = None
        self.body: Any = None
        self.keys: list[tuple[str, str]] = []
        self.status = StatusText()
        self.builds = BackgroundJob(
            "build", self._show_progress, self._end_build, self._report_layout, self._show_pause
        )
        self.build_error: DefsenseError | None = None
        self.on_build_started: list[Callable[[], None]] = []
        self.on_layout_found: list[Callable[[CandidateLayout], None]] = []
        self.on_build_loaded: list[Callable[[], None]] = []
        self._judge_settings = ""
        self._judge_worker = LatestWorker(self._update_judge, self.status.show_error)
        self._progress_bar: Any = None
        self._progress_text: Any = None

    @property
    def size(self) -> float:
        """Largest extent of the body in mm; 100 while there is no body."""
        if self.surface is None:
            return _DEFAULT_SIZE_MM
        return float(np.ptp(self.surface.vertices, axis=0).max())

    def add_progress(self) -> None:
        """Add the progress of builds at the current position of the panel."""
        self._progress_bar = self.server.gui.add_progress_bar(0.0, visible=False)
        self._progress_text = self.server.gui.add_markdown("")

    def apply(self, edit: Edit) -> bool:
        """Change `device.toml`; on failure show the error and return False."""
        try:
            self.project.apply(edit)
        except DefsenseError as error:
            self.status.show_error(error)
            return False
        return True

    def button(self, label: str, hint: str, action: Callable[[], Any], **options: Any) -> Any:
        """Add a button that shows the errors of its action on the page."""
        button = self.server.gui.add_button(label, hint=hint, **options)
        button.on_click(lambda _: self.run_action(action))
        return button

    def button_row(self, label: str, actions: Mapping[str, Callable[[], Any]], hint: str) -> Any:
        """Add a button for each action side by side, which takes less room than a column."""
        group = self.server.gui.add_button_group(label, tuple(actions), hint=hint)

        def on_click(event: Any) -> None:
            if event.client is not None:
                self.run_action(actions[group.value])

        group.on_click(on_click)
        return group

    def command(
        self,
        label: str,
        text: str,
        action: Callable[[], Any],
        key: str | None = None,
        modifier: str | None = None,
    ) -> None:
        """Add a command to the palette (Ctrl+K), and a keyboard shortcut for it.

        Args:
            label: Name in the palette.
            text: Description in the palette and in the list of keys.
            action: Called by the command; its errors are shown on the page.
            key: A letter or digit, or None for no shortcut.
            modifier: "cmd/ctrl", "cmd/ctrl+shift", or None.
        """
        command = self.server.gui.add_command(
            label, description=text, hotkey=key, modifier=modifier
        )
        command.on_trigger(lambda _: self.run_action(action))
        if key is not None:
            self.keys.append((_MODIFIER_LABELS[modifier] + key, text))

    def run_action(self, action: Callable[[], Any]) -> None:
        """Call an action and show a DefsenseError that it raises on the page."""
        try:
            action()
        except DefsenseError as error:
            self.status.show_error(error)

    def may_run_script(self, on_agreed: Callable[[], Any]) -> bool:
        """Return whether the body's script may run, and ask the user if necessary.

        Every action that makes the body must call this first.

        Args:
            on_agreed: Called once the user agrees, if the user has to be asked.

        Raises:
            BodyError: The script cannot be read.
        """
        script = self.agreement.script_to_confirm(self.project.device.body)
        if script is None:
            return True

        def agree() -> None:
            self.run_action(lambda: self.agreement.confirm(script))
            self.run_action(on_agreed)

        def refuse() -> None:
            self.status.show(
                f"`{script.path.name}` was not run. To be asked again, make the body.",
                "script-refused",
            )

        with self.drawing_lock:
            self.question.ask(script, agree, refuse)
        return False

    def build(self, stage: str) -> bool:
        """Build up to a stage in the background.

        Returns:
            Whether the build started. It does not start while another build runs, or before the
            user has agreed to run the script.
        """
        if not self.may_run_script(lambda: self.build(stage)):
            return False
        if not self.builds.start(run_build, self.project.folder, stage):
            self.status.show(
                "A build is running. Cancel it, or wait until it ends.", "build-running"
            )
            return False
        self._progress_bar.visible, self._progress_bar.value = True, 0.0
        for callback in self.on_build_started:
            callback()
        return True

    def update_judge(self) -> None:
        """Follow a change of the device: update the judge if its settings have changed."""
        if self.judge is not None and judge_settings(self.project.device) != self._judge_settings:
            self._judge_worker.give(self.project.device)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the judge is up to date; return False after `timeout_s`."""
        return self._judge_worker.wait(timeout_s)

    def load(self) -> None:
        """Load the body and the fields of the poses from the last build."""
        self.results = last_build(self.project.device)
        try:
            self.surface = self.results.surface
            self.is_built = True
        except OSError:
            self.is_built = False  # a body may have been made without a build
        except Exception as error:  # files of other programs, or truncated: readers raise anything
            self.is_built = False
            self._show_damage(error)
        self._load_judge(self.project.device)
        if self.surface is not None:
            self._show_body(self.surface)
        for callback in self.on_build_loaded:
            callback()

    def show_surface(self, surface: Surface) -> None:
        """Show a body that no build has made."""
        self.surface = surface
        self._show_body(surface)
        for callback in self.on_build_loaded:
            callback()

    def close(self) -> None:
        """Close the question and end the running build."""
        self.question.close()
        self._judge_worker.close()
        self.builds.close()

    def _load_judge(self, device: Device) -> None:
        self.judge, self._judge_settings = None, judge_settings(device)
        try:
            self.judge = LayoutJudge(device, self.results)
        except StorageError as error:
            if has_poses(self.results):
                self._show_damage(error)
        except (DefsenseError, OSError):
            return  # nothing is simulated yet
        except Exception as error:
            self._show_damage(error)

    def _update_judge(self, device: Device) -> None:
        if judge_settings(device) != self._judge_settings:
            self._load_judge(device)
            for callback in self.on_build_loaded:
                callback()

    def _show_body(self, surface: Surface) -> None:
        is_first = self.body is None
        is_visible = is_first or self.body.visible
        self.body = self.server.scene.add_mesh_simple(
            "/body",
            surface.vertices,
            surface.faces,
            color=_BODY_COLOR,
            opacity=0.35,
            side="double",
            visible=is_visible,
        )
        if is_first:
            self.server.scene.set_up_direction("+z")
            look_at_body(self.server, surface.vertices)

    def _show_damage(self, error: Exception) -> None:
        """Show that the build exists and cannot be read."""
        if not isinstance(error, DefsenseError):
            reason = " ".join(str(error).split())
            error = StorageError(
                f"is damaged ({type(error).__name__}: {reason})",
                code="file-damaged",
                where="the build",
                action="Build again",
            )
        self.status.show_error(error)

    def _show_progress(self, share: float, message: str) -> None:
        self._progress_bar.value = 100 * share
        self._progress_text.content = message

    def _end_build(self, error: DefsenseError | None, _: None) -> None:
        self._progress_bar.visible = False
        self.build_error = error
        self._progress_text.content = "done" if error is None else f"**{error}**"
        self.load()

    def _report_layout(self, layout: CandidateLayout) -> None:
        for callback in self.on_layout_found:
            callback(layout)

    def _show_pause(self, is_paused: bool) -> None:
        self._progress_text.content = "**paused**" if is_paused else "continues"


def judge_settings(device: Device) -> str:
    """Return the settings that decide how cords are judged, besides the body and the poses."""
    return repr((device.cord, device.fabrication, device.decoder, device.channel_diameter))
