"""The moving surface, recorded while the loop runs and written as an animation at the end."""

from __future__ import annotations

import errno
import math
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import LiveError, StorageError
from ...core.storage.files import replace_file, storage_errors
from ..frames.live_frame import LiveFrame
from .animation import Animation, AnimationFile, Float32
from .gltf_animation import write_gltf
from .usd_animation import require_usd, write_usd

# Frames of any rate to pictures of a fixed one.

_GAP = 1.0  # s without a frame, after which the surface stood still and then jumped
_SAME = 1e-6  # of a picture's time: a frame this near to it is at the same time


class FrameResampler:
    """Interpolates linearly between frames at the pictures' times, `fps` of them a second from the
    first frame on. Over a gap of more than a second the last shape is held until the picture
    before the next frame. A clock that goes back, as of a board that was restarted, is taken to go
    on from the last frame."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._start = self._time = 0.0
        self._last: Float | None = None
        self._next = 0

    def add(self, time: float, vertices: Float) -> Iterator[tuple[int, Float]]:
        """The pictures up to a frame at a `time` (s): their numbers, which rise, and vertices
        (v, 3) mm. Of a gap there are the first and the last alone."""
        if self._last is None:
            self._start, self._time, self._last = time, time, vertices
        elif time < self._time:
            self._start -= self._time - time
            self._time = time
        last, before = self._last, self._time - self._start
        now = time - self._start
        self._last, self._time = vertices, time
        if now - before > _GAP:
            until = math.ceil(now * self._fps - _SAME) - 1
            yield from ((k, last) for k in sorted({self._next, until}))
            self._next, last, before = until + 1, vertices, now
        while self._next <= now * self._fps + _SAME:
            share = (self._next / self._fps - before) / (now - before) if now > before else 1.0
            yield self._next, last + min(max(share, 0.0), 1.0) * (vertices - last)
            self._next += 1


# Rows of numbers that are added to a file without a name, and read when all are there.


class RowFile:
    """Rows of `width` float32 in a temporary file in `folder`, which no one else sees and which is
    gone when it is closed or the program ends."""

    def __init__(self, folder: Path, width: int) -> None:
        """Raises StorageError where there can be no such file."""
        self.width, self.count = width, 0
        if not folder.is_dir():
            raise StorageError(
                "the folder does not exist",
                code="folder-not-found",
                where=folder,
                action="Create it or choose another folder",
            )
        with storage_errors(folder):
            # Without a buffer: what does not fit on the disk is told with the row that does not.
            self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115

    @property
    def size(self) -> int:
        """Bytes of all rows."""
        return 4 * self.width * self.count

    def add(self, row: Float32) -> None:
        """Raises OSError where the disk takes only a part of it; the rows before it stay."""
        data = memoryview(np.asarray(row, np.float32).tobytes())
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError:
            self._file.seek(self.size)
            self._file.truncate()
            raise
        self.count += 1

    def rows(self) -> Float32:
        """(count, width), read from the disk as it is used."""
        if not self.count:
            return np.empty((0, self.width), np.float32)
        return np.memmap(self._file, np.float32, "r", shape=(self.count, self.width))

    def close(self) -> None:
        self._file.close()


# Animation files by their suffix.

_USD = (".usd", ".usda", ".usdc")
SUFFIXES = (".glb", *_USD, ".npz")


def check_suffix(path: Path) -> None:
    """Raises LiveError where a file of this name could not be written: of an unknown suffix, or
    one whose package is missing."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LiveError(
            f"unknown animation format {suffix!r}",
            code="unknown-format",
            where=path,
            action=f"Use one of {', '.join(SUFFIXES)}",
            suffix=suffix,
        )
    if suffix in _USD:
        require_usd(path)


def write_animation(path: Path, animation: Animation) -> AnimationFile:
    """To the format of its suffix, whole or not at all. Raises StorageError, LiveError."""
    check_suffix(path)
    suffix = path.suffix.lower()
    if suffix == ".glb":
        return write_gltf(path, animation)
    return write_usd(path, animation) if suffix in _USD else _write_npz(path, animation)


def _write_npz(path: Path, animation: Animation) -> AnimationFile:
    """`rest` (v, 3) and `positions` (n, v, 3) mm, `faces` (f, 3), `times` (n,) s."""
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            rest=animation.rest,
            faces=animation.faces,
            positions=animation.positions,
            times=animation.times,
        )
        size = file.tell()
    frames, seconds = len(animation.steps), float(np.ptp(animation.times))
    return AnimationFile(path, size, frames, seconds, 0.0)


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
