"""Animations of a live run: one from its beginning, by a flag, or some, by the view's button."""

from __future__ import annotations

import threading
from pathlib import Path

from ...core.arrays import Float, Int
from ...core.errors import DefsenseError
from ...runtime.frames.live_frame import LiveFrame
from ...runtime.recording.animation import AnimationFile
from ...runtime.recording.animation_recorder import AnimationRecorder


class Animations:
    """Takes frames with their surfaces while one is being recorded. `written` are the sentences on
    those that were finished."""

    name = "animation"

    def __init__(self, rest: Float, faces: Int) -> None:
        self._rest, self._faces = rest, faces
        self._lock = threading.Lock()
        self._recorder: AnimationRecorder | None = None
        self.written: list[str] = []
        self.trouble: str | None = None
        self.news: str | None = None

    def start(self, path: Path) -> None:
        """Raises DefsenseError for a path that no animation can be written to."""
        recorder = AnimationRecorder(path, self._rest, self._faces)
        with self._lock:
            self._recorder = recorder

    def send(self, frame: LiveFrame) -> None:
        recorder = self._recorder
        if recorder is not None:
            recorder.add(frame)
            self.trouble = recorder.trouble

    def stop(self) -> str:
        """Write what was recorded; a sentence on what came of it."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        if recorder is None:
            return "no animation was being recorded"
        try:
            with recorder:
                told = _told(recorder.finish())
        except DefsenseError as error:
            told = f"the animation was not written: {error}"
        self.written.append(told)
        return told

    def close(self) -> None:
        if self._recorder is not None:
            self.stop()


def _told(file: AnimationFile) -> str:
    return (
        f"{file.path}: {file.frames} frames, {file.seconds:.1f} s, {file.size / 1e6:.1f} MB; every"
        f" vertex within {file.error:.3f} mm"
    )
