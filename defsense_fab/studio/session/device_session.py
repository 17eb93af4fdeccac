"""The device that is being edited: its project, its build, and the work in the background."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.device.device import Device, Sensor
from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, DeviceError, StorageError
from ...core.mesh import Surface
from ...workflow.build.build import freshness
from ...workflow.build.renamed_poses import carry_over_rename, is_rename
from ...workflow.build.results import Build, has_poses, last_build
from ...workflow.design.layout_judge import LayoutJudge
from ...workflow.starts.body_scripts import ScriptText
from ...workflow.view import Arrays, Problem, WebServer
from ..background.build_job import CandidateLayout, run_build
from ..background.latest_worker import LatestWorker
from ..edits.edit import Edit
from ..messages.shell import Notice, Question, ScriptFile, Stage
from ..project.agreement import Agreement
from ..project.project import Project
from .body_arrays import surface_arrays
from .cord_colors import CordColors
from .job_strip import JobStrip, Work

_TITLES: dict[str, str] = {
    "mesh": "Mesh the body",
    "simulate": "Simulate the poses",
    "optimize": "Optimize the {noun}s",
    "report": "Build the parts",
}
_DEFAULT_SIZE_MM = 100.0  # of the scene while there is no body
_MAX_SHOWN_CHARACTERS = 100_000  # of a script in the question


class DeviceSession:
    """Shared state of the steps of one device.

    Its methods may be called from any thread. Callbacks are called on the thread of what caused
    them.

    Args:
        server: Sends events and arrays to the browsers.
        project: The folder of the device.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        jobs: The work in the background.
        results: Results of the last build, each read when it is first used.
        surface: The body at rest, or None until it has been made.
        is_built: Whether `surface` belongs to a build.
        preview: The body of the present device where it differs from the built one, or None.
        judge: Predicts the error of cords; None until the poses are simulated.
        freshness: State of each stage of the build: "current", "old" or "missing".
        build_error: Error of the last build, or None.
        taken_layouts: Cords of layouts of a search that were drawn in this session.
        on_device_changed: Called after a change of `device.toml`.
        on_build_loaded: Called after a build, successful or not, and after a change of the body
            or the judge.
        on_build_started: Called when a build starts.
        on_layout_found: Called with each layout that the build's search tries, on the build's
            thread: return quickly.
        on_body_changed: Called after a change of `preview`.
        on_freshness: Called after `freshness` was determined.
    """

    def __init__(
        self, server: WebServer, project: Project, agreement: Agreement | None = None
    ) -> None:
        self.server, self.project = server, project
        self.agreement = agreement or Agreement()
        self.jobs = JobStrip(server.publish)
        self.results: Build = last_build(project.device)
        self.surface: Surface | None = None
        self.is_built = False
        self.preview: Surface | None = None
        self.judge: LayoutJudge | None = None
        self.freshness: dict[str, str] = {}
        self.build_error: DefsenseError | None = None
        self.taken_layouts: list[tuple[Sensor, ...]] = []
        self.on_device_changed: list[Callable[[], None]] = []
        self.on_build_loaded: list[Callable[[], None]] = []
        self.on_build_started: list[Callable[[], None]] = []
        self.on_layout_found: list[Callable[[CandidateLayout], None]] = []
        self.on_body_changed: list[Callable[[], None]] = []
        self.on_freshness: list[Callable[[], None]] = []
        self._cord_colors = CordColors()
        self._former = project.device
        self._is_closed = False
        self._rename_lock = threading.Lock()
        self._renames: list[tuple[Device, Device]] = []  # that the simulation does not have yet
        self._judge_settings = ""
        self._judge_worker = LatestWorker(self._update_judge, self.show_error)
        self._freshness_worker = LatestWorker(self._check_freshness, self.show_error)
        self._load_worker = LatestWorker[None](lambda _: self.load(), self.show_error)
        self._question_lock = threading.Lock()
        self._question: tuple[ScriptText, Callable[[], Any]] | None = None
        project.watchers.append(self._follow_device)

    @property
    def device(self) -> Device:
        """The device as of the last valid file."""
        return self.project.device

    @property
    def newest_surface(self) -> Surface | None:
        """The body of the present device as far as it is made, or None before the first one."""
        return self.preview or self.surface

    @property
    def size(self) -> float:
        """Largest extent of the body in mm; 100 while there is no body."""
        if self.surface is None:
            return _DEFAULT_SIZE_MM
        return float(np.ptp(self.surface.vertices, axis=0).max())

    def cord_colors(self) -> dict[str, str]:
        """Return the color of each drawn cord."""
        return self._cord_colors.of([sensor.name for sensor in self.device.sensors])

    def apply(self, edit: Edit) -> None:
        """Change `device.toml`. Raises DefsenseError."""
        self.require_open()
        self.project.apply(edit)

    def require_open(self) -> None:
        """Raise a DeviceError if the device was closed."""
        if self._is_closed:
            raise DeviceError(
                "the device was closed meanwhile",
                code="device-closed",
                where=DEVICE,
                action="Open it again",
            )

    def edit_and_lock(self, edit: Edit) -> None:
        """Change `device.toml` by an edit that locks all cords, and report it."""
        had_free_cords = any(sensor.free for sensor in self.device.sensors)
        self.apply(edit)
        if had_free_cords:
            noun = self.device.cord.noun
            self.notify(
                f"The {noun}s are locked now: builds keep them as drawn. Unlock them in Sensors."
            )

    def notify(self, text: str) -> None:
        """Show a short message in all browsers."""
        self.server.publish(Notice(text=text))

    def show_error(self, error: Exception) -> None:
        """Show an error in all browsers; the studio continues."""
        problem = Problem.of(error)
        self.server.publish(Notice(text=problem.text, problem=problem))

    # The script of the body

    def may_run_script(self, on_agreed: Callable[[], Any]) -> bool:
        """Return whether the body's script may run, and ask the user if necessary.

        Every action that makes the body must call this first.

        Args:
            on_agreed: Called once the user agrees, if the user has to be asked.

        Raises:
            BodyError: The script cannot be read.
        """
        script = self.agreement.script_to_confirm(self.device.body)
        if script is None:
            return True
        with self._question_lock:
            self._question = script, on_agreed
        self.server.publish(
            Question(
                path=str(script.path), files=[_script_file(name, c) for name, c in script.files]
            )
        )
        return False

    def answer(self, *, run: bool) -> None:
        """Answer the question; of two browsers that answer at once the first one counts."""
        with self._question_lock:
            question, self._question = self._question, None
        self.server.publish(Question(path="", files=[]))
        if question is None:
            return
        script, on_agreed = question
        if run:
            self.agreement.confirm(script)
            on_agreed()
        else:
            self.notify(f"{script.path.name} was not run")

    # Builds

    def build(self, stage: Stage) -> None:
        """Build up to a stage in the background, after asking whether the script may run.

        Raises:
            DefsenseError: Another job is running, or the script cannot be read.
        """
        if not self.may_run_script(lambda: self.build(stage)):
            return
        self.jobs.start(
            Work(
                name="build",
                title=_TITLES[stage].format(noun=self.device.cord.noun),
                job=run_build,
                arguments=(self.project.folder, stage),
                on_end=self._end_build,
                on_item=self._report_layout,
                can_pause=True,
                gives_way=stage == "mesh",  # all other stages mesh the body, too
            )
        )
        for callback in self.on_build_started:
            callback()

    def check_freshness(self) -> None:
        """Determine in the background which results belong to the present device."""
        self._freshness_worker.give(self.device)

    def load(self) -> None:
        """Load the body and the fields of the poses from the last build."""
        self._carry_over_renames()  # that a build has put off
        self.results = last_build(self.device)
        try:
            self.surface = self.results.surface
            self.is_built = True
        except OSError:
            self.is_built = False  # a body may have been made without a build
        except Exception as error:  # files of other programs, or truncated: readers raise anything
            self.is_built = False
            self._show_damage(error)
        self._load_judge(self.device)
        if self.surface is not None:
            self._publish_body(self.surface)
        self._call(self.on_build_loaded)
        self.check_freshness()

    def show_surface(self, surface: Surface) -> None:
        """Show a body that no build has made."""
        self.surface = surface
        self._publish_body(surface)
        self._call(self.on_build_loaded)

    def show_preview(self, surface: Surface | None) -> None:
        """Show a body that differs from the built one, or the built one again."""
        if surface is None and self.preview is None:
            return
        self.preview = surface
        self.server.publish_arrays(
            Arrays(
                name="body-preview",
                arrays={} if surface is None else surface_arrays(surface),
                facts={"isBuilt": False},
            )
        )
        self._call(self.on_body_changed)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the judge and the freshness are up to date; return False after a time."""
        workers = (self._load_worker, self._judge_worker, self._freshness_worker)
        return all(worker.wait(timeout_s) for worker in workers)

    def close(self) -> None:
        """End all running work; edits are refused from now on."""
        self._is_closed = True
        self.project.watchers.remove(self._follow_device)
        for worker in (self._load_worker, self._judge_worker, self._freshness_worker):
            worker.close()
        self.jobs.close()

    def _follow_device(self, _: str) -> None:
        is_renamed = self._carry_over_renames()
        if self.judge is not None and judge_settings(self.device) != self._judge_settings:
            self._judge_worker.give(self.device)
        self.build_error = None  # of the device as it was
        self.jobs.forget_problem()
        self._call(self.on_device_changed)
        if is_renamed:
            self._load_worker.give(None)  # the fields have other names now
        else:
            self.check_freshness()

    def _carry_over_renames(self) -> bool:
        """Rename poses in the simulation as in the device, unless a build is running.

        Returns:
            Whether the simulation has changed.
        """
        with self._rename_lock:
            former, self._former = self._former, self.device
            if is_rename(former, self._former):
                self._renames.append((former, self._former))
            has_changed = False
            while self._renames:
                try:
                    has_changed |= carry_over_rename(*self._renames[0])
                except StorageError:
                    break  # the end of the build loads its results
                del self._renames[0]
        return has_changed

    def _call(self, callbacks: list[Callable[[], None]]) -> None:
        for callback in callbacks:
            try:
                callback()
            except Exception as error:  # shown on the page: the others are called
                self.show_error(error)

    def _publish_body(self, surface: Surface) -> None:
        low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
        self.server.publish_arrays(
            Arrays(
                name="body",
                arrays=surface_arrays(surface),
                facts={
                    "low": low.tolist(),
                    "high": high.tolist(),
                    "volume": float(surface.volume),
                    "isBuilt": self.is_built,
                },
            )
        )

    def _check_freshness(self, device: Device) -> None:
        self.freshness = dict(freshness(device))
        self._call(self.on_freshness)

    def _load_judge(self, device: Device) -> None:
        self.judge, self._judge_settings = None, judge_settings(device)
        try:
            self.judge = LayoutJudge(device, self.results)
        except StorageError as error:
            if has_poses(self.results):
                self._show_damage(error)
        except (DefsenseError, OSError):
            return  # nothing is simulated yet
        except Exception as error:  # as in `load`
            self._show_damage(error)

    def _update_judge(self, device: Device) -> None:
        if judge_settings(device) != self._judge_settings:
            self._load_judge(device)
            self._call(self.on_build_loaded)

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
        self.show_error(error)

    def _end_build(self, error: DefsenseError | None, _: None) -> None:
        self.build_error = error
        self.load()

    def _report_layout(self, layout: CandidateLayout) -> None:
        for callback in self.on_layout_found:
            callback(layout)


def judge_settings(device: Device) -> str:
    """Return the settings that decide how cords are judged, besides the body and the poses."""
    return repr((device.cord, device.fabrication, device.decoder, device.channel_diameter))


def _script_file(name: str, content: bytes) -> ScriptFile:
    if not name.endswith(".py"):
        return ScriptFile(name=name, text="", size=len(content))
    text = content.decode("utf-8", errors="replace")
    return ScriptFile(name=name, text=text[:_MAX_SHOWN_CHARACTERS], size=len(content))
