"""Record the moving surface while the loop runs, and write it as an animation at the end."""

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
from ..frames.live_frame import LiveFrame, Note
from .animation import Animation, AnimationFile, Float32
from .gltf_animation import write_gltf
from .usd_animation import require_usd, write_usd

_USD_SUFFIXES = (".usd", ".usda", ".usdc")
#: Suffixes of the formats that can be written.
SUFFIXES = (".glb", *_USD_SUFFIXES, ".npz")
_MAX_GAP_S = 1.0  # without a frame; after a longer gap the surface held still and then jumped
_SAME_TIME = 1e-6  # of the time between two steps: a frame so near to a step is at its time
_RESERVE_BYTES = 32e6  # left free besides the finished file, which is about as large as the rows


def check_suffix(path: Path) -> None:
    """Raise LiveError if the suffix is unknown or the package for its format is missing."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LiveError(
            f"unknown animation format {suffix!r}",
            code="unknown-format",
            where=path,
            action=f"Use one of {', '.join(SUFFIXES)}",
            suffix=suffix,
        )
    if suffix in _USD_SUFFIXES:
        require_usd(path)


def write_animation(path: Path, animation: Animation) -> AnimationFile:
    """Write an animation in the format of the suffix, whole or not at all.

    Raises:
        StorageError: The file cannot be written.
        LiveError: The format is unknown, its package is missing, or a position is not finite.
    """
    check_suffix(path)
    suffix = path.suffix.lower()
    if suffix == ".glb":
        return write_gltf(path, animation)
    return write_usd(path, animation) if suffix in _USD_SUFFIXES else _write_npz(path, animation)


def _write_npz(path: Path, animation: Animation) -> AnimationFile:
    """Write `rest` (v, 3) and `positions` (n, v, 3), mm, `faces` (f, 3) and `times` (n,), s."""
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


class FrameResampler:
    """Interpolate linearly from frames at any rate to steps at a fixed rate.

    Over a gap of more than a second the last shape is held until the step before the next frame.
    After a clock goes back, as that of a restarted board, time continues from the last frame.

    Args:
        fps: Steps per second, counted from the first frame.
    """

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._start = self._time = 0.0
        self._last: Float | None = None
        self._next = 0

    def add(self, time: float, vertices: Float) -> Iterator[tuple[int, Float]]:
        """Yield the steps up to a frame: their increasing numbers, and vertices (v, 3), mm.

        Of a gap only the first and the last step are returned.

        Args:
            time: Time of the frame, s.
            vertices: Vertices of the frame (v, 3), mm.
        """
        if self._last is None:
            self._start, self._time, self._last = time, time, vertices
        elif time < self._time:
            self._start -= self._time - time
            self._time = time
        last, before = self._last, self._time - self._start
        now = time - self._start
        self._last, self._time = vertices, time
        if now - before > _MAX_GAP_S:
            end = math.ceil(now * self._fps - _SAME_TIME) - 1
            yield from ((k, last) for k in sorted({self._next, end}))
            self._next, last, before = end + 1, vertices, now
        while self._next <= now * self._fps + _SAME_TIME:
            share = (self._next / self._fps - before) / (now - before) if now > before else 1.0
            yield self._next, last + min(max(share, 0.0), 1.0) * (vertices - last)
            self._next += 1


class RowFile:
    """Rows of float32 in a temporary file without a name.

    The file disappears when it is closed or the program ends.

    Args:
        folder: Folder whose disk holds the file.
        width: Numbers per row.

    Attributes:
        count: Number of rows.

    Raises:
        StorageError: The folder does not exist, or the file cannot be created.
    """

    def __init__(self, folder: Path, width: int) -> None:
        self.width, self.count = width, 0
        if not folder.is_dir():
            raise StorageError(
                "the folder does not exist",
                code="folder-not-found",
                where=folder,
                action="Create it or choose another folder",
            )
        with storage_errors(folder):
            # Unbuffered, so that a full disk is reported with the row that does not fit.
            self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115

    @property
    def size(self) -> int:
        """Size of all rows, bytes."""
        return 4 * self.width * self.count

    def add(self, row: Float32) -> None:
        """Add a row; if the disk takes only a part of it, drop it and raise OSError."""
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
        """Return all rows (count, width), read from the disk as they are used."""
        if not self.count:
            return np.empty((0, self.width), np.float32)
        return np.memmap(self._file, np.float32, "r", shape=(self.count, self.width))

    def close(self) -> None:
        """Delete the file."""
        self._file.close()


class AnimationRecorder:
    """Record the surface of frames, and write it as an animation.

    Frames are kept as float32 in a temporary file next to `path`. A full disk or a limit stops the
    recording: `trouble` reports it, and the recorded frames can still be written. Frames may come
    from one thread and `finish` from another.

    Args:
        path: File of the animation; its suffix chooses the format.
        rest: Vertices at rest (v, 3), mm.
        faces: Triangles (f, 3).
        fps: Frames per second of the animation, 1 to 1000.
        max_seconds: Largest duration, s.
        max_bytes: Largest size of the recorded frames.

    Attributes:
        trouble: Why the recording has stopped, or None.
        skipped: Number of frames without a surface or with another number of vertices.

    Raises:
        LiveError: The suffix is unknown, or an argument is invalid.
        StorageError: Nothing can be written next to `path`.
    """

    def __init__(
        self,
        path: Path,
        rest: Float,
        faces: Int,
        *,
        fps: float = 30.0,
        max_seconds: float = 3600.0,
        max_bytes: float = 8e9,
    ) -> None:
        check_suffix(path)
        if rest.ndim != 2 or rest.shape[1] != 3 or not np.isfinite(rest).all():
            raise LiveError(
                "rest must be a finite array of shape (v, 3)",
                code="surface-invalid",
                where=path,
                field="rest",
            )
        has_faces = faces.ndim == 2 and faces.shape[1] == 3 and faces.size
        if not has_faces or not 0 <= faces.min() <= faces.max() < len(rest):
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
        self.trouble: Note | None = None
        self.skipped = 0
        self._path, self._rest, self._faces, self._fps = path, rest, faces, fps
        self._max_seconds, self._max_bytes = max_seconds, max_bytes
        self._resampler, self._steps = FrameResampler(fps), list[int]()
        self._lock, self._has_ended = threading.Lock(), False
        self._finishing, self._is_closed = threading.Lock(), False
        self._folder = path.resolve().parent
        self._rows = RowFile(self._folder, rest.size)

    @property
    def about(self) -> str:
        """Description of what is recorded where."""
        return f"animation: {self.seconds:.1f} s to {self._path}"

    @property
    def frames(self) -> int:
        """Number of frames recorded so far."""
        return len(self._steps)

    @property
    def seconds(self) -> float:
        """Duration recorded so far, s."""
        return self._steps[-1] / self._fps if self._steps else 0.0

    def add(self, frame: LiveFrame) -> None:
        """Record a frame; problems become `trouble`, and frames after the end are ignored."""
        with self._lock:
            if self._has_ended:
                return
            vertices = frame.vertices
            if (
                vertices is None
                or vertices.shape != self._rest.shape
                or not np.isfinite(vertices).all()
            ):
                self.skipped += 1
                return
            for step, row in self._resampler.add(frame.time, vertices):
                self._add(step, row)
                if self._has_ended:
                    return

    def finish(self, path: Path | None = None) -> AnimationFile:
        """End the recording and write it; may be called again if that fails.

        Args:
            path: Another file to write to.

        Raises:
            StorageError: The file cannot be written; the recorded frames are kept.
            LiveError: There is no frame, or the recording is closed.
        """
        path = path or self._path
        with self._lock:
            self._has_ended = True
        with self._finishing:  # not the lock of `add`: the loop must not wait for this
            if self._is_closed:
                raise LiveError("the recording is closed", code="recording-closed", where=path)
            positions = self._rows.rows().reshape(-1, *self._rest.shape)
            steps = np.array(self._steps, np.int64)
            name = self._path.stem
            animation = Animation(name, self._rest, self._faces, positions, steps, self._fps)
            file = write_animation(path, animation)
        self.close()
        return file

    def close(self) -> None:
        """End the recording and discard frames that were not written."""
        with self._lock:
            self._has_ended = True
        with self._finishing:
            self._is_closed = True
            self._rows.close()

    def __enter__(self) -> AnimationRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, step: int, row: Float) -> None:
        if step > self._max_seconds * self._fps:
            self._end("limit-reached", f"the limit of {self._max_seconds:g} s is reached")
            return
        if self._rows.size + 4 * row.size > self._max_bytes:
            self._end("limit-reached", f"the limit of {self._max_bytes / 1e9:g} GB is reached")
            return
        try:
            if shutil.disk_usage(self._folder).free < self._rows.size + _RESERVE_BYTES:
                raise OSError(errno.ENOSPC, "no room for the finished file")
            self._rows.add(row.astype(np.float32))
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                self._end("disk-full", "the disk is full")
            else:
                self._end("write-failed", error.strerror or str(error))
            return
        self._steps.append(step)

    def _end(self, code: str, reason: str) -> None:
        self._has_ended = True
        text = (
            f"{self._path}: recording stopped after {self.seconds:.1f} s: {reason}; the recorded"
            " frames are kept"
        )
        self.trouble = Note(code, text, {"seconds": self.seconds})
