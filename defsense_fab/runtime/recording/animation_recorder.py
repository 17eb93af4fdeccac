"""The moving surface, recorded while the loop runs and written as an animation at the end."""

from __future__ import annotations

import errno
import shutil
import threading
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import LiveError
from ..frames.live_frame import LiveFrame
from .animation import Animation, AnimationFile
from .animation_formats import check_suffix, write_animation
from .frame_resampler import FrameResampler
from .row_file import RowFile

_ROOM = 32e6  # bytes left free beside the finished file, which is about as large as the rows


class AnimationRecorder:
    """Keeps the surface of frames as float32 in a temporary file beside `path`, `fps` of them a
    second, and writes the animation there when it is finished.

    A disk that gets full, or a limit, ends the recording: `trouble` says so, what was recorded
    stays and can be finished. Frames may come from one thread and `finish` from another.
    """

    def __init__(
        self,
        path: Path,
        rest: Float,
        faces: Int,
        *,
        fps: float = 30.0,
        seconds: float = 3600.0,
        size: float = 8e9,
    ) -> None:
        """Of a surface with `rest` (v, 3) mm and `faces` (f, 3); at most so many `seconds` and
        bytes (`size`) before the animation is written. Raises LiveError where the suffix or the
        numbers are none that can be, StorageError where nothing can be written beside `path`."""
        check_suffix(path)
        if rest.ndim != 2 or rest.shape[1] != 3 or not np.isfinite(rest).all():
            raise LiveError(
                "rest must be a finite array of shape (v, 3)",
                code="surface-invalid",
                where=path,
                field="rest",
            )
        known = faces.ndim == 2 and faces.shape[1] == 3 and faces.size
        if not known or not 0 <= faces.min() <= faces.max() < len(rest):
            raise LiveError(
                f"faces must be an array (f, 3) of indices into the {len(rest)} vertices",
                code="surface-invalid",
                where=path,
                field="faces",
            )
        if not 1 <= fps <= 1000:
            raise LiveError(
                f"fps must be between 1 and 1000, got {fps:g}",
                code="out-of-range",
                where=path,
                field="fps",
            )
        self.trouble: str | None = None
        self.left_out = 0  # frames without a surface, or of other vertices
        self._path, self._rest, self._faces, self._fps = path, rest, faces, fps
        self._seconds, self._size = seconds, size
        self._resampler, self._steps = FrameResampler(fps), list[int]()
        self._lock, self._ended = threading.Lock(), False
        self._finishing, self._closed = threading.Lock(), False
        self._folder = path.resolve().parent
        self._rows = RowFile(self._folder, rest.size)

    @property
    def about(self) -> str:
        return f"animation: {self.seconds:.1f} s to {self._path}"

    @property
    def frames(self) -> int:
        """Recorded so far."""
        return len(self._steps)

    @property
    def seconds(self) -> float:
        """Recorded so far."""
        return self._steps[-1] / self._fps if self._steps else 0.0

    def add(self, frame: LiveFrame) -> None:
        """Nothing is raised; what goes wrong is `trouble`, and what comes after the end is
        ignored."""
        with self._lock:
            if self._ended:
                return
            vertices = frame.vertices
            if (
                vertices is None
                or vertices.shape != self._rest.shape
                or not np.isfinite(vertices).all()
            ):
                self.left_out += 1
                return
            for step, row in self._resampler.add(frame.time, vertices):
                self._add(step, row)
                if self._ended:
                    return

    def finish(self, path: Path | None = None) -> AnimationFile:
        """End the recording and write it to its path, or to another. Where that fails, what was
        recorded stays, and `finish` can be called again. Raises StorageError, LiveError."""
        path = path or self._path
        with self._lock:
            self._ended = True
        with self._finishing:  # not the lock of `add`: the loop does not wait for this
            if self._closed:
                raise LiveError("the recording is closed", code="recording-closed", where=path)
            positions = self._rows.rows().reshape(-1, *self._rest.shape)
            steps = np.array(self._steps, np.int64)
            written = write_animation(
                path,
                Animation(self._path.stem, self._rest, self._faces, positions, steps, self._fps),
            )
        self.close()
        return written

    def close(self) -> None:
        """End the recording; what was not finished is gone."""
        with self._lock:
            self._ended = True
        with self._finishing:
            self._closed = True
            self._rows.close()

    def __enter__(self) -> AnimationRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, step: int, row: Float) -> None:
        if step > self._seconds * self._fps:
            self._end(f"{self._seconds:g} s, the most that was asked for, are recorded")
            return
        if self._rows.size + 4 * row.size > self._size:
            self._end(f"{self._size / 1e9:g} GB, the most that was asked for, are recorded")
            return
        try:
            if shutil.disk_usage(self._folder).free < self._rows.size + _ROOM:
                raise OSError(errno.ENOSPC, "no room for the finished file")
            self._rows.add(row.astype(np.float32))
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            self._end("the disk is full" if full else error.strerror or str(error))
            return
        self._steps.append(step)

    def _end(self, why: str) -> None:
        self._ended = True
        self.trouble = (
            f"{self._path}: recording stopped after {self.seconds:.1f} s: {why};"
            " what was recorded is kept"
        )
