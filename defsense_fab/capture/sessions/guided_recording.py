"""The guided recording of a device before cameras: which pose is next, what is seen, what is there.

Watchers write what the cameras see, the read-out board's reader writes its samples, each to a file
of its own; this only looks at the latest of both, several times a second, and says what to do."""

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
from .session import BOARD, LOG, REST, CaptureSession, Log, covered, finished

_TICK = 0.1  # s between looks
_PATIENCE = 15.0  # s, for the first pictures
_STALE = 0.5  # s after which a picture or a sample is old
_REST_WITHIN = 0.8  # of the rest's time: frames that rest resistances are taken from
#: Tells a twin's hands which pose to show, and for how many s.
Hands = Callable[[str, float], None]


@dataclass(frozen=True)
class CameraView:
    """What a camera sees now: its name and picture, outlines (k, 4, 2) px of the tags and their
    numbers, which of them another camera sees, too; frames per second, frames that were late."""

    name: str
    image: Image | None
    outlines: Float
    ids: tuple[int, ...]
    shared: Bool
    rate: float
    late: int


@dataclass(frozen=True)
class CaptureView:
    """What the screen shows. `phase` is ready, showing, paused or done; `step` of `steps`; `left` s
    of it; (R - R0)/R0 by channel, `signals` (c,), and lately (t, c) in `history`; `reached`, of
    each pose how far it was shown, 0 to 1, and how much of its way was seen, (BINS,) bool; the
    markers located now, by several cameras and by one; `residual` px; rows written; notes."""

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
    """Shows, and reads keys."""

    def show(self, view: CaptureView) -> None: ...

    def key(self, timeout: float) -> str | None: ...


class GuidedRecording:
    """One run of a session: `run` it."""

    def __init__(
        self, session: CaptureSession, openers: Sequence[Callable[[], ImageSource]],
        board: Source | None, screen: CaptureScreen, levels: PoseCoverage | None, *,
        auto: bool = False, video: bool = False, hands: Hands | None = None,
    ) -> None:  # fmt: skip
        self._session, self._openers, self._board = session, openers, board
        self._screen, self._levels, self._auto, self._video = screen, levels, auto, video
        self._hands = hands
        self._rest = np.full(len(session.channels), np.nan)
        self._resting: list[Float] = []
        self._history: list[Float] = []
        self._dividers: Dividers | None = None
        self._samples = 0
        self._heard = 0.0
        self._notes: list[str] = []

    def run(self) -> bool:
        """Whether all steps were shown. Raises CaptureError and StorageError for what cannot go on;
        what was recorded stays."""
        session = self._session
        if self._levels is not None:
            for pose, part in covered(session):
                self._levels.restore(pose, part)
        number = 1 + max((int(p.name[4:]) for p in session.runs), default=0)
        folder = session.folder / f"run-{number}"
        folder.mkdir(parents=True)
        tags = dictionary(session.markers.dictionary)
        with ExitStack() as stack:
            log = Log(folder / LOG)
            stack.callback(log.close)
            self._log = log
            why = "stopped by the user"
            try:
                if self._board is not None:
                    recorder = stack.enter_context(Recorder(folder / BOARD, len(session.channels)))
                    self._board.sink = recorder.add
                    info = self._board.start()
                    stack.callback(self._board.close)
                    self._dividers = Dividers(np.array(session.reference), float(info.full_scale))
                    log.event("board", full_scale=info.full_scale, rate=info.rate)
                stack.enter_context(one_thread_per_call(len(self._openers) > 1))
                self._watchers = []
                for camera, opener in zip(session.rig.cameras, self._openers, strict=True):
                    watcher = CameraRecorder(opener, camera, tags, folder, log, video=self._video)
                    stack.callback(watcher.close)
                    self._watchers.append(watcher)
                for watcher in self._watchers:  # together: all of them are ready
                    watcher.start()
                self._first_pictures()
                log.event("start", device=session.device)
                complete = self._steps()
                why = "all steps were shown" if complete else why
            except KeyboardInterrupt:
                complete = False
            except Exception as error:
                why = f"error: {error}"
                raise
            finally:
                log.event("end", why=why)
        return complete

    def _first_pictures(self) -> None:
        """Wait for them: a step that begins before has none."""
        begun = time.monotonic()
        while time.monotonic() - begun < _PATIENCE:
            self._check()
            if all(w.latest is not None or w.gone for w in self._watchers):
                return
            time.sleep(_TICK)

    def _steps(self) -> bool:
        todo = [k for k in range(len(self._session.steps)) if k not in finished(self._session)]
        position = 0
        while position < len(todo):
            k = todo[position]
            if self._auto:
                told: str | None = "enter"
            else:
                told = self._wait(k)
            if told == "q":
                return False
            if told == "b":
                position = max(position - 1, 0)
                continue
            if told == "s":
                position += 1
                continue
            shown = self._show(k)
            if shown == "q":
                return False
            if shown == "done":
                position += 1
        self._look("done", max(len(self._session.steps) - 1, 0), 0.0)
        return not [k for k in range(len(self._session.steps)) if k not in finished(self._session)]

    def _wait(self, k: int) -> str:
        """Until a key says what to do with a step."""
        while True:
            pressed = self._look("ready", k, self._session.steps[k].seconds)
            if pressed in ("enter", "q", "b", "s"):
                return pressed

    def _show(self, k: int) -> str:
        """A step from its beginning to its end, a key before that, or `again`."""
        step = self._session.steps[k]
        self._log.event("step", step=k, name=step.name, seconds=step.seconds)
        if step.name == REST:
            self._resting = []
        if self._hands is not None:
            self._hands(step.name, step.seconds)
        begun = time.monotonic()
        while (left := begun + step.seconds - time.monotonic()) > 0:
            pressed = self._look("showing", k, left, resting=step.name == REST)
            if pressed == "q":
                self._log.event("stopped", step=k)
                return "q"
            if pressed in ("r", "b"):
                self._log.event("again", step=k)
                return "again"
            if pressed in ("enter", "s") and step.seconds - left > 1:
                break
        self._log.event("done", step=k)
        return "done"

    def _look(self, phase: str, k: int, left: float, *, resting: bool = False) -> str | None:
        pressed = self._screen.key(_TICK)
        self._check()
        self._hear(resting=resting)
        step = self._session.steps[k]
        glances = [w.fresh(_STALE) for w in self._watchers]
        points, several, single, residual = self._locate(glances)
        if self._levels is not None and points is not None:
            new = self._levels.add(points)
            if new is not None:  # told at once: a run that is killed has it in its log
                self._log.event("covered", pose=new[0], part=new[1])
        self._screen.show(
            CaptureView(
                phase, k, tuple((s.name, s.seconds) for s in self._session.steps), max(left, 0.0),
                tuple(self._shown(w, g, glances)
                      for w, g in zip(self._watchers, glances, strict=True)),
                self._session.channels, self._signals(), np.array(self._history[-240:]),
                self._levels.reached() if self._levels is not None else {}, several, single,
                len(self._session.markers.ids), residual, self._samples,
                sum(w.frames for w in self._watchers), tuple(self._warnings(glances)),
                self._advice(step.name, phase),
            )
        )  # fmt: skip
        return pressed

    def _check(self) -> None:
        for w in self._watchers:
            if w.failure is not None:
                raise w.failure

    def _hear(self, *, resting: bool) -> None:
        if self._board is None or self._dividers is None:
            return
        for item in self._board.drain():
            if not isinstance(item, StampedSample):
                continue
            self._samples += 1
            self._heard = time.monotonic()
            ohm = self._dividers.resistance(item.sample.counts)
            self._history.append(ohm)
            if resting:
                self._resting.append(ohm)
        del self._history[:-2000]
        if resting and self._resting:
            late = self._resting[int((1 - _REST_WITHIN) * len(self._resting)) :]
            self._rest = np.median(np.array(late), axis=0)

    def _signals(self) -> Float:
        if not self._history:
            return np.full(len(self._session.channels), np.nan)
        rest = self._rest
        if not np.isfinite(rest).all():  # a session that is gone on with, before its next rest
            rest = np.median(np.array(self._history), axis=0)
        return relative_change(self._history[-1], rest)

    def _locate(
        self, glances: Sequence[CameraFrame | None]
    ) -> tuple[Float | None, int, int, float]:
        """Markers (m, 3) mm, or None for none; how many by several cameras, by one; px."""
        m = self._session.markers
        v = len(glances)
        corners = np.full((1, len(m.ids), v, 4, 2), np.nan)
        covariance = np.full((1, len(m.ids), v, 5, 2, 2), np.nan)
        order = {int(n): i for i, n in enumerate(m.ids)}
        for c, glance in enumerate(glances):
            if glance is None:
                continue
            for n, number in enumerate(glance.view.ids):
                if int(number) in order:
                    corners[0, order[int(number)], c] = glance.view.corners[n]
                    covariance[0, order[int(number)], c] = glance.view.covariance[n]
        if not np.isfinite(corners[..., 0, 0]).any():
            return None, 0, 0, float("nan")
        found = reconstruct(self._session.rig.cameras, corners, covariance, m.size)
        several, single = int((found.cameras >= 2).sum()), int((found.cameras == 1).sum())
        miss = found.miss[(found.cameras >= 2)]
        residual = float(np.median(miss)) if len(miss) else float("nan")
        return found.points[0], several, single, residual

    def _shown(
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

    def _warnings(self, glances: Sequence[CameraFrame | None]) -> list[str]:
        out = list(self._notes)
        for w, g in zip(self._watchers, glances, strict=True):
            if w.gone:
                out.append(f"camera {w.camera.name} is gone: plug it in again")
            elif g is None:
                out.append(f"camera {w.camera.name}: no fresh picture")
            elif w.frames > 50 and w.late > 0.05 * w.frames:
                out.append(f"camera {w.camera.name}: {w.late} frames late or lost")
        if self._board is not None:
            s = self._board.statistics
            if self._heard and time.monotonic() - self._heard > 1.5:
                out.append("the read-out board is silent: is it still plugged in?")
            if s.lost + s.gaps:
                out.append(f"board: {s.lost} samples lost, {s.gaps} gaps")
        return out

    def _advice(self, name: str, phase: str) -> str:
        if phase == "done":
            return "Done."
        if name == REST:
            return "Leave the device at rest; hold it still, in view of the cameras."
        if self._levels is not None:
            todo = self._levels.todo()
            if name == "free" and todo:
                return f"Move freely, and mix poses; seen least so far: {todo}."
        if name == "free":
            return "Move freely: mix the poses, slowly and fast."
        return f"Show {name}: from rest to its full extent and back, again and again, slowly."
