"""Animations of a live run: one from its beginning, by a flag, or some, by the view's button."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.arrays import Float, Int
from ...core.errors import LiveError, StorageError
from ...core.storage.files import unused_path
from ..frames.live_frame import LiveFrame
from ..recording.animation import AnimationFile
from ..recording.animation_recorder import AnimationRecorder


@dataclass(frozen=True)
class Written:
    """A `file` that was written; why it is not where it was asked for (`instead`), if it is not."""

    file: AnimationFile
    instead: str | None = None

    @property
    def told(self) -> str:
        f = self.file
        elsewhere = f"; it is there since it could not be written to {self.instead}"
        return (
            f"{f.path}: {f.frames} frames, {f.seconds:.1f} s, {f.size / 1e6:.1f} MB; every vertex"
            f" within {f.error:.3f} mm{elsewhere if self.instead else ''}"
        )


class Animations:
    """Takes frames with their surfaces while one is being recorded, `written` are those that were
    finished. One whose folder is gone or full goes to the first of the `spare` folders that takes
    it; each is asked for when it is needed, and may raise StorageError."""

    name = "animation"
    news: str | None = None

    def __init__(self, rest: Float, faces: Int, spare: Sequence[Callable[[], Path]] = ()) -> None:
        """Of a surface with `rest` (v, 3) mm and `faces` (f, 3)."""
        self._rest, self._faces, self._spare = rest, faces, tuple(spare)
        self._lock, self._finishing = threading.Lock(), threading.Lock()
        self._recorder: AnimationRecorder | None = None
        self._path = Path()
        self.written: list[Written] = []

    @property
    def recording(self) -> Path | None:
        """The file of the one that is being recorded, or that is not written yet."""
        return None if self._recorder is None else self._path

    @property
    def trouble(self) -> str | None:
        """Of the one that is being recorded."""
        recorder = self._recorder
        return None if recorder is None else recorder.trouble

    def start(self, path: Path) -> Path:
        """Begin one, and say which file it will be: one that is there stays, and the name gets a
        number. Raises LiveError while another is being recorded, DefsenseError for a path that
        none can be written to."""
        with self._lock:
            if self._recorder is not None:
                raise LiveError(f"{self._path} is being recorded; stop that first")
            path = unused_path(path)
            self._recorder = AnimationRecorder(path, self._rest, self._faces)
            self._path = path
        return path

    def send(self, frame: LiveFrame) -> None:
        recorder = self._recorder
        if recorder is not None:
            recorder.add(frame)

    def finish(self) -> Written | None:
        """Write what was recorded; None where nothing is. Raises StorageError where no folder
        takes it: it is kept then, so that this can be called again; LiveError without frames."""
        with self._finishing:
            recorder = self._recorder
            if recorder is None:
                return None
            if self.empty:
                self.discard()
                raise LiveError(
                    f"{self._path}: no frame with a surface was recorded; let the device lie at"
                    " rest first, and then record for longer"
                )
            written = self._write(recorder)
            self._recorder = None
            self.written.append(written)
            return written

    def discard(self) -> None:
        """End the one that is being recorded without a file."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def close(self) -> None:
        """Nothing: `finish` takes its time, and is called when all that is live has been closed."""

    @property
    def empty(self) -> bool:
        """Whether the one that is being recorded has no frames."""
        recorder = self._recorder
        return recorder is not None and not recorder.frames

    def _write(self, recorder: AnimationRecorder) -> Written:
        try:
            return Written(recorder.finish(unused_path(self._path)))
        except StorageError as error:
            failed = [str(error)]
        for folder in self._spare:
            try:
                return Written(recorder.finish(unused_path(folder() / self._path.name)), failed[0])
            except StorageError as error:
                failed += [str(error)] if str(error) not in failed else []
        raise StorageError("the animation is not written: " + "; nor elsewhere: ".join(failed))
