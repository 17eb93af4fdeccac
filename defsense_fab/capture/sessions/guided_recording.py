"""Record a device in front of cameras, with guidance on which pose to show next.

Recorders write what the cameras see, and the read-out board's reader writes its samples, each to
its own file. This module only looks at the newest data of both, several times a second, and gives
advice.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...core.arrays import Bool, Float
from ...sensing.response import relative_change
from ...sensing.voltage_divider import Dividers
from ..cameras.image_sources import ImageSource, one_thread_per_call
from ..readout.recording import Recorder
from ..readout.source import Source, StampedSample
from ..tags.detection import Image
from ..tags.tag_patterns import dictionary
from ..tracking.reconstruction import reconstruct
from .camera_recorder import CameraFrame, CameraRecorder
from .pose_coverage import PoseCoverage
from .session import BOARD, LOG, REST, CaptureSession, Log, covered_parts, finished_steps

UPDATE_INTERVAL_S = 0.1
FIRST_IMAGE_TIMEOUT_S = 15.0
MAX_AGE_S = 0.5  # of an image or a sample
REST_SHARE = 0.8  # last part of a rest, from which rest resistances are measured
#: Makes a twin show a pose for so many s.
Hands = Callable[[str, float], None]


@dataclass(frozen=True)
class CameraView:
    """What a camera sees now.

    Attributes:
        name: Name of the camera.
        image: The image; None without a recent one.
        outlines: Outlines of the tags (k, 4, 2), px.
        ids: Their numbers (k,).
        shared: Which of them another camera sees too (k,).
        rate: Frames per second.
        late: Number of frames that were late or lost.
    """

    name: str
    image: Image | None
    outlines: Float
    ids: tuple[int, ...]
    shared: Bool
    rate: float
    late: int


@dataclass(frozen=True)
class CaptureView:
    """The state of a recording, for a screen.

    Attributes:
        phase: `ready`, `showing`, `paused` or `done`.
        step: Number of the step.
        steps: Names and durations of the steps, s.
        left: Remaining time of the step, s.
        cameras: What each camera sees.
        channels: Names of the channels (c,).
        signals: Relative changes (R - R0)/R0 (c,).
        history: Recent resistances (t, c), ohm.
        reached: By pose: how far it was shown, 0 to 1, and which parts of its way were seen
            (BINS,).
        several: Number of markers located by several cameras.
        single: Number of markers located by one camera.
        tags: Number of markers of the device.
        residual: Residual, px.
        samples: Number of recorded samples.
        frames: Number of recorded frames.
        notes: Warnings.
        next: Advice on what to do next.
    """

    phase: str
    step: int
    steps: tuple[tuple[str, float], ...]
    left: float
    cameras: tuple[CameraView, ...]
    channels: tuple[str, ...]
    signals: Float
    history: Float
    reached: dict[str, tuple[float, Bool]]
    several: int
    single: int
    tags: int
    residual: float
    samples: int
    frames: int
    notes: tuple[str, ...]
    next: str


class CaptureScreen(Protocol):
    """Shows a recording, and reads keys: an interface."""

    def show(self, view: CaptureView) -> None: ...

    def key(self, timeout: float) -> str | None: ...


class GuidedRecording:
    """One run of a session.

    Args:
        session: The session.
        openers: Open the cameras.
        board: Source of samples; None for none.
        screen: Screen for the user.
        levels: Coverage of the poses; None for none.
        auto: Whether to start each step without a key.
        video: Whether to record videos too.
        hands: Makes a twin show poses.
    """

    def __init__(
        self,
        session: CaptureSession,
        openers: Sequence[Callable[[], ImageSource]],
        board: Source | None,
        screen: CaptureScreen,
        levels: PoseCoverage | None,
        *,
        auto: bool = False,
        video: bool = False,
        hands: Hands | None = None,
    ) -> None:
        self._session, self._openers, self._board = session, openers, board
        self._screen, self._coverage, self._auto, self._video = screen, levels, auto, video
        self._hands = hands
        self._rest = np.full(len(session.channels), np.nan)
        self._rest_samples: list[Float] = []
        self._history: list[Float] = []
        self._dividers: Dividers | None = None
        self._samples = 0
        self._last_sample_at = 0.0
        self._notes: list[str] = []

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
        tags = dictionary(session.markers.dictionary)
        with ExitStack() as stack:
            log = Log(folder / LOG)
            stack.callback(log.close)
            self._log = log
            reason = "stopped by the user"
            try:
                if self._board is not None:
                    recorder = stack.enter_context(Recorder(folder / BOARD, len(session.channels)))
                    self._board.sink = recorder.add
                    info = self._board.start()
                    stack.callback(self._board.close)
                    self._dividers = Dividers(np.array(session.reference), float(info.full_scale))
                    log.event("board", full_scale=info.full_scale, rate=info.rate)
                stack.enter_context(one_thread_per_call(len(self._openers) > 1))
                self._recorders = []
                for camera, opener in zip(session.rig.cameras, self._openers, strict=True):
                    camera_recorder = CameraRecorder(
                        opener, camera, tags, folder, log, video=self._video
                    )
                    stack.callback(camera_recorder.close)
                    self._recorders.append(camera_recorder)
                for camera_recorder in self._recorders:  # together, once all are ready
                    camera_recorder.start()
                self._wait_for_images()
                log.event("start", device=session.device)
                is_complete = self._steps()
                reason = "all steps were shown" if is_complete else reason
            except KeyboardInterrupt:
                is_complete = False
            except Exception as error:
                reason = f"error: {error}"
                raise
            finally:
                log.event("end", why=reason)
        return is_complete

    def _wait_for_images(self) -> None:
        """Wait for the first images: a step that started before would have none."""
        begun = time.monotonic()
        while time.monotonic() - begun < FIRST_IMAGE_TIMEOUT_S:
            self._check()
            if all(w.latest is not None or w.is_disconnected for w in self._recorders):
                return
            time.sleep(UPDATE_INTERVAL_S)

    def _steps(self) -> bool:
        remaining = [
            step
            for step in range(len(self._session.steps))
            if step not in finished_steps(self._session)
        ]
        position = 0
        while position < len(remaining):
            step = remaining[position]
            if self._auto:
                key: str | None = "enter"
            else:
                key = self._wait(step)
            if key == "q":
                return False
            if key == "b":
                position = max(position - 1, 0)
                continue
            if key == "s":
                position += 1
                continue
            shown = self._show(step)
            if shown == "q":
                return False
            if shown == "done":
                position += 1
        self._update("done", max(len(self._session.steps) - 1, 0), 0.0)
        return not [
            step
            for step in range(len(self._session.steps))
            if step not in finished_steps(self._session)
        ]

    def _wait(self, k: int) -> str:
        """Until a key says what to do with a step."""
        while True:
            pressed = self._update("ready", k, self._session.steps[k].seconds)
            if pressed in ("enter", "q", "b", "s"):
                return pressed

    def _show(self, k: int) -> str:
        """Record a step to its end; return `done`, `q`, or `again`."""
        step = self._session.steps[k]
        self._log.event("step", step=k, name=step.name, seconds=step.seconds)
        if step.name == REST:
            self._rest_samples = []
        if self._hands is not None:
            self._hands(step.name, step.seconds)
        started_at = time.monotonic()
        while (remaining := started_at + step.seconds - time.monotonic()) > 0:
            key = self._update("showing", k, remaining, resting=step.name == REST)
            if key == "q":
                self._log.event("stopped", step=k)
                return "q"
            if key in ("r", "b"):
                self._log.event("again", step=k)
                return "again"
            if key in ("enter", "s") and step.seconds - remaining > 1:
                break
        self._log.event("done", step=k)
        return "done"

    def _update(self, phase: str, k: int, left: float, *, resting: bool = False) -> str | None:
        pressed = self._screen.key(UPDATE_INTERVAL_S)
        self._check()
        self._read_samples(resting=resting)
        step = self._session.steps[k]
        glances = [w.fresh(MAX_AGE_S) for w in self._recorders]
        points, several, single, residual = self._locate(glances)
        if self._coverage is not None and points is not None:
            new = self._coverage.add(points)
            if new is not None:  # logged at once, so that a killed run has it
                self._log.event("covered", pose=new[0], part=new[1])
        self._screen.show(
            CaptureView(
                phase,
                k,
                tuple((s.name, s.seconds) for s in self._session.steps),
                max(left, 0.0),
                tuple(
                    self._camera_view(w, g, glances)
                    for w, g in zip(self._recorders, glances, strict=True)
                ),
                self._session.channels,
                self._signals(),
                np.array(self._history[-240:]),
                self._coverage.reached() if self._coverage is not None else {},
                several,
                single,
                len(self._session.markers.ids),
                residual,
                self._samples,
                sum(w.frames for w in self._recorders),
                tuple(self._warnings(glances)),
                self._advice(step.name, phase),
            )
        )
        return pressed

    def _check(self) -> None:
        for recorder in self._recorders:
            if recorder.failure is not None:
                raise recorder.failure

    def _read_samples(self, *, resting: bool) -> None:
        if self._board is None or self._dividers is None:
            return
        for item in self._board.drain():
            if not isinstance(item, StampedSample):
                continue
            self._samples += 1
            self._last_sample_at = time.monotonic()
            ohm = self._dividers.resistance(item.sample.counts)
            self._history.append(ohm)
            if resting:
                self._rest_samples.append(ohm)
        del self._history[:-2000]
        if resting and self._rest_samples:
            late = self._rest_samples[int((1 - REST_SHARE) * len(self._rest_samples)) :]
            self._rest = np.median(np.array(late), axis=0)

    def _signals(self) -> Float:
        if not self._history:
            return np.full(len(self._session.channels), np.nan)
        rest = self._rest
        if not np.isfinite(rest).all():  # a resumed session before its next rest
            rest = np.median(np.array(self._history), axis=0)
        return relative_change(self._history[-1], rest)

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

    def _camera_view(
        self, w: CameraRecorder, glance: CameraFrame | None, glances: Sequence[CameraFrame | None]
    ) -> CameraView:
        if glance is None:
            return CameraView(
                w.camera.name, None, np.zeros((0, 4, 2)), (), np.zeros(0, bool), 0, w.late
            )
        others = [g for g in glances if g is not None and g is not glance]
        ids = tuple(int(n) for n in glance.view.ids)
        shared = np.array([any(n in g.view.ids for g in others) for n in ids], bool)
        return CameraView(
            w.camera.name, glance.image, glance.view.image_corners, ids, shared, w.rate, w.late
        )

    def _warnings(self, frames: Sequence[CameraFrame | None]) -> list[str]:
        warnings = list(self._notes)
        for recorder, frame in zip(self._recorders, frames, strict=True):
            if recorder.is_disconnected:
                warnings.append(f"Camera {recorder.camera.name} is disconnected. Plug it in again.")
            elif frame is None:
                warnings.append(f"Camera {recorder.camera.name} gives no recent image.")
            elif recorder.frames > 50 and recorder.late > 0.05 * recorder.frames:
                warnings.append(
                    f"Camera {recorder.camera.name}: {recorder.late} frames were late or lost."
                )
        if self._board is not None:
            statistics = self._board.statistics
            if self._last_sample_at and time.monotonic() - self._last_sample_at > 1.5:
                warnings.append("The read-out board is silent. Check that it is plugged in.")
            if statistics.lost + statistics.gaps:
                warnings.append(
                    f"The read-out board lost {statistics.lost} samples, with"
                    f" {statistics.gaps} gaps."
                )
        return warnings

    def _advice(self, name: str, phase: str) -> str:
        if phase == "done":
            return "Done."
        if name == REST:
            return "Leave the device at rest and still, in view of the cameras."
        if self._coverage is not None:
            least = self._coverage.least_covered()
            if name == "free" and least:
                return f"Move freely and mix poses. Least shown so far: {least}."
        if name == "free":
            return "Move freely and mix the poses, slowly and fast."
        return f"Show {name} slowly and repeatedly, from rest to its full extent and back."
