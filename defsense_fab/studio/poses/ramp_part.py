"""The ramp of a pose: any share of it by a slider, or all of it as a film."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Pose
from ...core.errors import DefsenseError
from ...workflow.design.pose_preview import PosePreview, PreviewedPose
from ...workflow.design.pose_ramp import RAMP_SHARES, Ramp, follow_ramp, load_ramp
from ..workbench.controls import on_user
from ..workbench.page_texts import StatusText
from .poses_scene import PosesScene
from .preview_work import PreviewRequest

_FILM_S, _FILM_FRAMES = 2.0, 40
_PLAY_LABEL, _STOP_LABEL = "Play the ramp", "Stop"


class RampPart:
    """The controls of the ramp of the pose that is shown.

    Args:
        scene: The body and its gizmos.

    Attributes:
        solve_share: Called to solve a share of the pose while the ramp is not known.
        pose: Called for the pose that is shown, or None.
        ramp: The ramp of the pose, or None until it is loaded or solved.
        status: Origin of the ramp and remarks on it, with their code; empty if it is not known.
    """

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.solve_share: Callable[[float], None] = lambda _: None
        self.pose: Callable[[], Pose | None] = lambda: None
        self.ramp: Ramp | None = None
        self.status = StatusText()
        self._rest: Float = np.zeros((0, 3))
        self._full: Float | None = None  # displacements (v, 3) mm of the full pose
        self._has_stopped = threading.Event()
        self._has_stopped.set()

    @property
    def is_playing(self) -> bool:
        """Whether the ramp is being played, or solved to be played."""
        return not self._has_stopped.is_set()

    def wait(self, timeout_s: float) -> bool:
        """Wait until the ramp is not played; return False after `timeout_s`."""
        return self._has_stopped.wait(timeout_s)

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui = self._bench.server.gui
        self._slider = gui.add_slider(
            "Share of the pose", 0.0, 1.0, 0.01, 1.0, hint="0: at rest; 1: the full pose"
        )
        on_user(self._slider, self._follow_slider)
        self._button = self._bench.button(
            _PLAY_LABEL, "Show the body from rest to the full pose", self.play
        )
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self.status.add_panel(gui)

    def reset(self) -> None:
        """Forget the ramp, because the pose has changed."""
        self.stop()
        self.ramp = self._full = None
        self._slider.value = 1.0
        if self.status.text:
            self.status.show("")

    def follow(self, preview: PosePreview, request: PreviewRequest, solved: PreviewedPose) -> None:
        """Load the ramp from the build once the full pose is solved and no gizmo is dragged."""
        if solved.moved is None or request.share != 1.0 or not request.is_final:
            return
        ramp = load_ramp(self._bench.results.folder, preview, request.pose, solved.moved)
        with self._bench.drawing_lock:
            self._rest, self._full = preview.surface.vertices, solved.moved
            self._set_ramp(ramp)

    def show(self, share: float) -> None:
        """Show a share of the pose."""
        if self.ramp is None:
            self.solve_share(share)
            return
        share = min(share, float(self.ramp.shares[-1]))
        if self._scene.body is not None:
            self._scene.body.move(self._rest + self.ramp.at(share))

    def play(self) -> None:
        """Play the ramp from rest, and solve it first if necessary; stop it if it is played."""
        if self.is_playing:
            self.stop()
            return
        pose = self.pose()
        if pose is None or self._scene.body is None:
            self._bench.status.show("Choose a pose of a meshed body first.", "no-pose-chosen")
            return
        self._has_stopped = has_stopped = threading.Event()
        self._button.label = _STOP_LABEL
        if self.ramp is None:
            self._bar.visible, self._bar.value = True, 0.0
            self._scene.work.call(lambda preview: self._solve(preview, pose, has_stopped))
        else:
            self._start(has_stopped)

    def stop(self) -> None:
        """Stop the film; the body stays as it is shown."""
        if not self.is_playing:
            return
        self._has_stopped.set()
        self._button.label = _PLAY_LABEL
        self._bar.visible = False

    def _follow_slider(self, share: float) -> None:
        with self._bench.drawing_lock:
            self.stop()
            self.show(float(share))

    def _set_ramp(self, ramp: Ramp | None) -> None:
        self.ramp = ramp
        if ramp is None:
            return
        origin = "the build" if ramp.is_simulated else "the solver"
        shares = ", ".join(f"{share:g}" for share in ramp.shares)
        remark = f" **{ramp.remark}.**" if ramp.remark else ""
        self.status.show(
            f"Shapes at {shares} from {origin}, splines in between.{remark}", ramp.code
        )

    def _solve(self, preview: PosePreview, pose: Pose, has_stopped: threading.Event) -> None:
        """Solve the ramp and play it; called on the thread that solves poses."""
        started_at = time.perf_counter()
        rest = preview.surface.vertices

        def show_frame(share: float, displacements: Float) -> None:
            with self._bench.drawing_lock:
                if not has_stopped.is_set() and self._scene.body is not None:
                    self._scene.body.move(rest + displacements)
                    self._bar.value = 100 * share
                    self._bar.visible = share < RAMP_SHARES[-1]

        def should_stop() -> bool:
            return has_stopped.is_set() or self._scene.work.is_cancelled_since(started_at)

        try:
            ramp = follow_ramp(preview, pose, self._full, should_stop, show_frame)
        except DefsenseError as error:
            self.stop()
            self.status.show_error(error)
            return
        if ramp is None or has_stopped.is_set():
            self.stop()
            return
        with self._bench.drawing_lock:
            self._rest = rest
            self._set_ramp(ramp)
            self._start(has_stopped)

    def _start(self, has_stopped: threading.Event) -> None:
        self._bar.visible = False
        threading.Thread(target=self._play_frames, args=(has_stopped,), daemon=True).start()

    def _play_frames(self, has_stopped: threading.Event) -> None:
        for share in np.linspace(0.0, 1.0, _FILM_FRAMES + 1).tolist():
            with self._bench.drawing_lock:
                if has_stopped.is_set() or self.ramp is None:
                    return
                self._slider.value = round(share, 2)
                self.show(share)
            if has_stopped.wait(_FILM_S / _FILM_FRAMES):
                return
        with self._bench.drawing_lock:
            self.stop()
