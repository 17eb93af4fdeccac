"""Record a device in front of cameras, with guidance on which pose to show next.

Recorders write what the cameras see, and the read-out board's reader writes its samples, each to
its own file. This module only looks at the newest data of both, several times a second, and gives
advice.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float
from ...core.guided_parts import Bars, Part, Picture
from ...core.guided_run import (
    STOP,
    Action,
    Ending,
    GuidedRun,
    GuidedView,
    GuidedWork,
    Key,
    Phase,
    RunState,
    Screen,
)
from ...core.progress import Notice
from ..cameras.image_sources import ImageSource, one_thread_per_call
from ..readout.recording import Recorder
from ..readout.source import Source
from ..tags.tag_patterns import dictionary
from ..tracking.reconstruction import reconstruct
from .camera_recorder import CameraFrame, CameraRecorder
from .pose_coverage import PoseCoverage
from .recent_signals import RecentSignals
from .session import BOARD, FREE, LOG, REST, CaptureSession, Log, covered_parts, finished_steps

CHECK_INTERVAL_S = 0.1  # while the first images are awaited
FIRST_IMAGE_TIMEOUT_S = 15.0
MAX_IMAGE_AGE_S = 0.5
MIN_STEP_S = 1.0  # before a key can complete a step
MAX_LATE_SHARE, MIN_FRAMES_FOR_LATE = 0.05, 50  # of a camera's frames, before it is reported
RECORDING_KEYS: Mapping[Phase, tuple[Key, ...]] = {
    "ready": (
        Key("enter", "start", "start"),
        Key("b", "back", "back"),
        Key("s", "skip", "skip"),
        STOP,
    ),
    "active": (
        Key("r", "repeat", "back"),  # the user has to get ready again
        Key("b", "", "back"),
        Key("s", "next", "complete"),
        Key("enter", "", "complete"),
        STOP,
    ),
}
#: Makes a twin show a pose for so many s.
Hands = Callable[[str, float], None]


class GuidedRecording(GuidedWork):
    """One run of a session.

    Args:
        session: The session.
        openers: Open the cameras.
        board: Source of samples; None for none.
        screen: Screen for the user.
        coverage: Coverage of the poses; None for none.
        auto: Whether to start each step without a key.
        video: Whether to record videos too.
        hands: Makes a twin show poses.
    """

    def __init__(
        self,
        session: CaptureSession,
        openers: Sequence[Callable[[], ImageSource]],
        board: Source | None,
        screen: Screen,
        coverage: PoseCoverage | None,
        *,
        auto: bool = False,
        video: bool = False,
        hands: Hands | None = None,
    ) -> None:
        self._session, self._openers, self._board = session, openers, board
        self._screen, self._coverage, self._auto, self._video = screen, coverage, auto, video
        self._hands = hands
        self.keys, self.step_count = RECORDING_KEYS, len(session.steps)
        self._recorders: list[CameraRecorder] = []
        self._glances: list[CameraFrame | None] = []
        self._tag_status = ""
        self._signals = RecentSignals(session.channels, session.reference)
        self._started_at = self._step_duration_s = 0.0

    def run(self) -> bool:
        """Record until all steps were shown or the user stops.

        Returns:
            Whether all steps were shown.

        Raises:
            CaptureError: If a camera or the read-out board fails; recorded data stay.
            StorageError: If data cannot be written; recorded data stay.
        """
        session = self._session
        if self._coverage is not None:
            for pose, part in covered_parts(session):
                self._coverage.restore(pose, part)
        number = 1 + max((int(p.name[4:]) for p in session.runs), default=0)
        folder = session.folder / f"run-{number}"
        folder.mkdir(parents=True)
        done = finished_steps(session)
        is_complete = False
        with ExitStack() as stack:
            self._log = log = Log(folder / LOG)
            stack.callback(log.close)
            reason = "stopped by the user"
            try:
                self._open_sources(folder, stack)
                log.event("start", device=session.device)
                guided = GuidedRun(self, self._screen, done, auto=self._auto)
                guided.run()
                is_complete = (
                    not guided.is_stopped and len(finished_steps(session)) == self.step_count
                )
                reason = "all steps were shown" if is_complete else reason
            except KeyboardInterrupt:
                pass
            except Exception as error:
                reason = f"error: {error}"
                raise
            finally:
                log.event("end", why=reason)
        return is_complete

    def _open_sources(self, folder: Path, stack: ExitStack) -> None:
        """Open the read-out board and the cameras, and wait for the first images.

        A step that started before them would have none.
        """
        session, log = self._session, self._log
        tags = dictionary(session.markers.dictionary)
        if self._board is not None:
            recorder = stack.enter_context(Recorder(folder / BOARD, len(session.channels)))
            self._board.sink = recorder.add
            info = self._board.start()
            stack.callback(self._board.close)
            self._signals.set_full_scale(float(info.full_scale))
            log.event("board", full_scale=info.full_scale, rate=info.rate)
        stack.enter_context(one_thread_per_call(len(self._openers) > 1))
        for camera, opener in zip(session.rig.cameras, self._openers, strict=True):
            camera_recorder = CameraRecorder(opener, camera, tags, folder, log, video=self._video)
            stack.callback(camera_recorder.close)
            self._recorders.append(camera_recorder)
        for camera_recorder in self._recorders:  # together, once all are ready
            camera_recorder.start()
        end = time.monotonic() + FIRST_IMAGE_TIMEOUT_S
        while time.monotonic() < end:
            self._check_cameras()
            if all(r.latest is not None or r.is_disconnected for r in self._recorders):
                return
            time.sleep(CHECK_INTERVAL_S)

    def _check_cameras(self) -> None:
        for recorder in self._recorders:
            if recorder.failure is not None:
                raise recorder.failure

    def start(self, step: int) -> None:
        plan = self._session.steps[step]
        self._log.event("step", step=step, name=plan.name, seconds=plan.seconds)
        if plan.name == REST:
            self._signals.start_rest()
        if self._hands is not None:
            self._hands(plan.name, plan.seconds)
        self._started_at, self._step_duration_s = time.monotonic(), plan.seconds

    def receive(self) -> None:
        self._check_cameras()
        if self._board is not None:
            self._signals.add(self._board)
        self._glances = [r.fresh(MAX_IMAGE_AGE_S) for r in self._recorders]
        points, by_several, by_one, residual = self._locate(self._glances)
        self._tag_status = (
            f"{by_several} of {len(self._session.markers.ids)} tags in several cameras, {by_one} in"
            " one camera" + (f"; residual {residual:.2f} px" if np.isfinite(residual) else "")
        )
        if self._coverage is not None and points is not None:
            new = self._coverage.add(points)
            if new is not None:  # logged at once, so that a killed run has it
                self._log.event("covered", pose=new[0], part=new[1])

    def check(self, *, is_requested: bool) -> Ending | None:
        elapsed = time.monotonic() - self._started_at
        is_over = elapsed >= self._step_duration_s
        return "done" if is_over or (is_requested and elapsed > MIN_STEP_S) else None

    def leave(self, step: int, ending: Ending | Action) -> None:
        events = {"done": "done", "back": "again", "stop": "stopped"}
        if ending in events:
            self._log.event(events[ending], step=step)
            self._signals.end_rest()

    def view(self, state: RunState) -> GuidedView:
        plan = self._session.steps[state.step]
        elapsed = time.monotonic() - self._started_at if state.phase == "active" else 0.0
        remaining = max(plan.seconds - elapsed, 0.0)
        status = []
        if self._recorders:
            status.append(self._tag_status)
        frames = sum(r.frames for r in self._recorders)
        status.append(f"{self._signals.count} samples, {frames} frames recorded")
        if reached := self._reached():
            share = float(np.mean([covered for _, covered in reached.values()]))
            status.append(f"{share:.0%} of the motions to the poses recorded")
        return GuidedView(
            state,
            title="recording ended"
            if state.phase == "done"
            else f"step {state.step + 1} of {self.step_count}: {plan.name}, {remaining:.0f} s",
            instruction=self._instruction(plan.name, state.phase),
            status=tuple(status),
            progress=1 - remaining / plan.seconds if plan.seconds > 0 else 1.0,
            parts=tuple(self._parts()),
            notes=tuple(self._notes()),
        )

    def _reached(self) -> dict[str, tuple[float, Bool]]:
        return {} if self._coverage is None else self._coverage.reached()

    def _parts(self) -> list[Part]:
        parts: list[Part] = []
        for recorder, glance in zip(self._recorders, self._glances, strict=True):
            parts.append(_camera_picture(recorder, glance, self._glances))
        parts += self._signals.parts()
        reached = self._reached()
        if reached:
            values = np.array([covered for _, covered in reached.values()], float)
            texts = tuple(f"up to {extent:.0%}" for extent, _ in reached.values())
            title = "Recorded parts of the motion from rest to each pose"
            parts.append(Bars(values, tuple(reached), texts, title))
        return parts

    def _locate(self, frames: Sequence[CameraFrame | None]) -> tuple[Float | None, int, int, float]:
        """Return markers (m, 3), mm, or None; counts by several cameras and by one; and the
        residual, px.
        """
        markers = self._session.markers
        v = len(frames)
        corners = np.full((1, len(markers.ids), v, 4, 2), np.nan)
        covariance = np.full((1, len(markers.ids), v, 5, 2, 2), np.nan)
        order = {int(n): i for i, n in enumerate(markers.ids)}
        for c, frame in enumerate(frames):
            if frame is None:
                continue
            for n, number in enumerate(frame.view.ids):
                if int(number) in order:
                    corners[0, order[int(number)], c] = frame.view.corners[n]
                    covariance[0, order[int(number)], c] = frame.view.covariance[n]
        if not np.isfinite(corners[..., 0, 0]).any():
            return None, 0, 0, float("nan")
        located = reconstruct(self._session.rig.cameras, corners, covariance, markers.size)
        by_several, by_one = int((located.cameras >= 2).sum()), int((located.cameras == 1).sum())
        residuals = located.miss[(located.cameras >= 2)]
        residual = float(np.median(residuals)) if len(residuals) else float("nan")
        return located.points[0], by_several, by_one, residual

    def _notes(self) -> list[Notice]:
        notes = []
        for recorder, frame in zip(self._recorders, self._glances, strict=True):
            name = recorder.camera.name
            if recorder.is_disconnected:
                text = f"Camera {name} is disconnected. Plug it in again."
                notes.append(Notice("camera-disconnected", text, name))
            elif frame is None:
                text = f"Camera {name} gives no recent image."
                notes.append(Notice("no-recent-image", text, name))
            elif (
                recorder.frames > MIN_FRAMES_FOR_LATE
                and recorder.late > MAX_LATE_SHARE * recorder.frames
            ):
                text = f"Camera {name}: {recorder.late} frames were late or lost."
                notes.append(Notice("frames-late", text, name))
        if self._board is not None:
            statistics = self._board.statistics
            if self._signals.is_silent():
                text = "The read-out board is silent. Check that it is plugged in."
                notes.append(Notice("board-silent", text))
            if statistics.lost + statistics.gaps:
                text = (
                    f"The read-out board lost {statistics.lost} samples, with"
                    f" {statistics.gaps} gaps."
                )
                notes.append(Notice("samples-lost", text))
        return notes

    def _instruction(self, name: str, phase: Phase) -> str:
        if phase == "done":
            return "The recording has ended."
        return self._advice(name) + (" Start when you are ready." if phase == "ready" else "")

    def _advice(self, name: str) -> str:
        if name == REST:
            return "Leave the device **at rest** and still, in view of the cameras."
        rarest = self._coverage.least_covered() if self._coverage is not None else ""
        if name == FREE and rarest:
            return f"**Move freely** and mix poses. Least covered so far: {rarest}."
        if name == FREE:
            return "**Move freely** and mix the poses, slowly and fast."
        return f"Show **{name}** slowly and repeatedly, from rest to its full extent and back."


def _camera_picture(
    recorder: CameraRecorder, glance: CameraFrame | None, glances: Sequence[CameraFrame | None]
) -> Picture:
    """Return what a camera sees; tags that another camera sees too are highlighted."""
    name = recorder.camera.name
    if glance is None:
        return Picture(name, "no picture", None, np.zeros((0, 4, 2)), (), np.zeros(0, bool))
    others = [g for g in glances if g is not None and g is not glance]
    ids = [int(n) for n in glance.view.ids]
    return Picture(
        name,
        f"{len(ids)} tags, {recorder.rate:.0f} frames/s",
        glance.image,
        glance.view.image_corners,
        tuple(map(str, ids)),
        np.array([any(n in g.view.ids for g in others) for n in ids], bool),
    )
