"""A pose's ramp: at any share by a slider, or played."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Pose
from ...core.errors import DefsenseError
from ...optimize.prediction.pose_preview import (
    RAMP_SHARES,
    PosePreview,
    PreviewedPose,
    Ramp,
    follow_ramp,
    load_ramp,
)
from .poses_scene import PosesScene
from .preview_work import Wanted

_SECONDS, _FRAMES = 2.0, 40  # of a ramp that is played
_PLAY, _STOP = "Play the ramp", "Stop"


class RampPart:
    """Of the pose that is shown; `seek` asks the solver for a share while no ramp is known."""

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.seek: Callable[[float], None] = lambda _: None
        self.pose: Callable[[], Pose | None] = lambda: None
        self.ramp: Ramp | None = None
        self._rest: Float = np.zeros((0, 3))
        self._full: Float | None = None
        self._over = threading.Event()
        self._over.set()

    @property
    def playing(self) -> bool:
        """Whether it is being played, or solved to be played."""
        return not self._over.is_set()

    def add_panel(self) -> None:
        """In the folder that is open."""
        gui = self._bench.server.gui
        self._slider = gui.add_slider(
            "Ramp", 0.0, 1.0, 0.01, 1.0, hint="Share of the pose: 0 is rest, 1 the whole pose"
        )
        self._slider.on_update(lambda event: self._slid(event))
        self._button = self._bench.button(_PLAY, "From rest to the whole pose", self.play)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self.words = gui.add_markdown("")

    def reset(self) -> None:
        """The pose has changed: what is known of its ramp is no more."""
        self.stop()
        self.ramp = self._full = None
        if self._slider.value != 1.0:
            self._slider.value = 1.0
        if self.words.content:
            self.words.content = ""

    def solved(self, preview: PosePreview, wanted: Wanted, found: PreviewedPose) -> None:
        """The whole pose has been solved and no hand moves it: what a build has of its ramp."""
        if found.moved is None or wanted.share != 1.0 or not wanted.check:
            return
        ramp = load_ramp(self._scene.folder, preview, wanted.pose, found.moved)
        with self._bench.drawing_lock:
            self._rest, self._full = preview.surface.vertices, found.moved
            self._know(ramp)

    def show(self, share: float) -> None:
        """The pose at a share."""
        if self.ramp is None:
            self.seek(share)
            return
        if share > self.ramp.shares[-1]:
            share = float(self.ramp.shares[-1])
        if self._scene.body is not None:
            self._scene.body.move(self._rest + self.ramp.at(share))

    def play(self) -> None:
        """From rest on; what is not known of the ramp is solved first. Stops where it is played."""
        if self.playing:
            self.stop()
            return
        pose = self.pose()
        if pose is None or self._scene.body is None:
            self._bench.show_message("Choose a pose of a meshed body first.", "no-pose-chosen")
            return
        self._over = over = threading.Event()
        self._button.label = _STOP
        if self.ramp is None:
            self._bar.visible, self._bar.value = True, 0.0
            self._scene.work.call(lambda preview: self._solve(preview, pose, over))
        else:
            self._start(over)

    def stop(self) -> None:
        """The body stays as it is."""
        if not self.playing:
            return
        self._over.set()
        self._button.label = _PLAY
        self._bar.visible = False

    def _slid(self, event: Any) -> None:
        if event.client is not None:
            with self._bench.drawing_lock:
                self.stop()
                self.show(float(self._slider.value))

    def _know(self, ramp: Ramp | None) -> None:
        self.ramp = ramp
        if ramp is None:
            return
        where = "the build's fields" if ramp.simulated else "the solver"
        shares = ", ".join(f"{s:g}" for s in ramp.shares)
        remark = f" **{ramp.remark}.**" if ramp.remark else ""
        self.words.content = f"at {shares} from {where}, between them by splines{remark}"

    def _solve(self, preview: PosePreview, pose: Pose, over: threading.Event) -> None:
        """On the solver's thread."""
        begun = time.perf_counter()
        rest = preview.surface.vertices

        def frame(share: float, moved: Float) -> None:
            with self._bench.drawing_lock:
                if not over.is_set() and self._scene.body is not None:
                    self._scene.body.move(rest + moved)
                    self._bar.value = 100 * share
                    self._bar.visible = share < RAMP_SHARES[-1]

        def stopped() -> bool:
            return over.is_set() or self._scene.work.cancelled_since(begun)

        try:
            ramp = follow_ramp(preview, pose, self._full, stopped, frame)
        except DefsenseError as error:
            self.stop()
            self.words.content = f"**{error}**"
            return
        if ramp is None or over.is_set():
            self.stop()
            return
        with self._bench.drawing_lock:
            self._rest = rest
            self._know(ramp)
            self._start(over)

    def _start(self, over: threading.Event) -> None:
        self._bar.visible = False
        threading.Thread(target=self._go_on, args=(over,), daemon=True).start()

    def _go_on(self, over: threading.Event) -> None:
        for share in np.linspace(0.0, 1.0, _FRAMES + 1).tolist():
            with self._bench.drawing_lock:
                if over.is_set() or self.ramp is None:
                    return
                self._slider.value = round(share, 2)
                self.show(share)
            if over.wait(_SECONDS / _FRAMES):
                return
        with self._bench.drawing_lock:
            self.stop()
