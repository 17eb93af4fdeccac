"""The files of a live run: its folder, its raw readings, and its animations."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from ...capture.readout.recording import Recorder
from ...capture.readout.source import Event, StampedSample
from ...core.arrays import Float, Int
from ...core.errors import DefsenseError, LiveError, StorageError
from ...core.storage.files import storage_errors, unused_path
from ..frames.live_frame import LiveFrame, Note
from ..recording.animation import AnimationFile
from ..recording.animation_recorder import AnimationRecorder

#: Name of the file with the raw readings.
BOARD = "board.csv"
_RETRY_DELAY_S = 5.0  # after a failure to record
_MAX_EARLY_EVENTS = 100  # that are kept before the first sample


class RunFolder:
    """A folder that is created with the first file, so that a run that fails to start leaves none.

    Args:
        path: The folder.
        new: Whether it must not exist yet; otherwise the name gets a number.

    Attributes:
        path: The folder, with its number once it was created.
    """

    def __init__(self, path: Path, *, new: bool = False) -> None:
        self.path, self._must_be_new = path, new
        self._lock = threading.Lock()

    def make(self) -> Path:
        """Create the folder if needed, and return it; may raise StorageError."""
        with self._lock, storage_errors(self.path):
            while self._must_be_new:
                path = unused_path(self.path)
                try:
                    path.mkdir(parents=True)
                except FileExistsError:  # created by a run that started at the same moment
                    continue
                self.path, self._must_be_new = path, False
            self.path.mkdir(parents=True, exist_ok=True)
            return self.path

    def check(self) -> None:
        """Raise StorageError if the folder clearly cannot be created."""
        existing = self.path
        with storage_errors(self.path):
            while not existing.exists() and existing != existing.parent:
                existing = existing.parent
        if not existing.is_dir():
            raise StorageError(
                "is not a folder",
                code="not-a-folder",
                where=existing,
                action="Choose another place",
            )
        if not os.access(existing, os.W_OK):
            raise StorageError(
                "files cannot be created there",
                code="folder-not-writable",
                where=existing,
                action="Choose another place",
            )


def new_run_folder(device: Path) -> RunFolder:
    """Return the folder of a new run: live/2026-11-25-14-03-09 in the device's folder."""
    now = datetime.now().astimezone().strftime("%Y-%m-%d-%H-%M-%S")
    return RunFolder(device / "live" / now, new=True)


class RawRecording:
    """Record the raw readings of a run, so that a better model can decode them later.

    The file is created with the first sample. A failure, such as a full disk, is reported as
    `trouble` and never ends the run; the recording resumes after some seconds if it can. Samples
    with another number of channels are left out.

    Args:
        folder: Folder of the run.
        channels: Number of channels.

    Attributes:
        trouble: Why readings are not recorded, or None.

    Raises:
        StorageError: Nothing can be written there.
        CaptureError: The existing file cannot be continued.
    """

    def __init__(self, folder: RunFolder, channels: int) -> None:
        folder.check()
        self.trouble: Note | None = None
        self._folder, self._channels = folder, channels
        self._started, self._is_closed = threading.Event(), False
        self._retry_at = 0.0  # by time.monotonic
        self._early = list[Event]()  # before the first sample
        self._recorder: Recorder | None = None
        if self.path.exists():
            self._recorder = Recorder(self.path, channels)
            self._started.set()

    @property
    def path(self) -> Path:
        """The file."""
        return self._folder.path / BOARD

    @property
    def is_closed(self) -> bool:
        """Whether the recording has ended."""
        return self._is_closed

    def wait_until_started(self, seconds: float) -> bool:
        """Wait for the file.

        Returns:
            Whether it exists within `seconds`; its `path` does not change afterwards.
        """
        return self._started.wait(seconds)

    def add(self, item: StampedSample | Event) -> None:
        """Record a sample or an event."""
        if self._is_closed or time.monotonic() < self._retry_at:
            return
        if self._recorder is None and isinstance(item, Event):
            self._early = [*self._early, item][-_MAX_EARLY_EVENTS:]
            return
        if isinstance(item, StampedSample) and len(item.sample.sums) != self._channels:
            count = len(item.sample.sums)
            text = (
                f"a sample of {count} channels is not recorded among those of {self._channels};"
                " another program changed the read-out board's settings"
            )
            self.trouble = Note("channels-differ", text, {"count": count})
            return
        try:
            if self._recorder is None:
                self._folder.make()
                self._recorder = Recorder(self.path, self._channels)
                self._recorder.extend(self._early)
                self._started.set()
            self._recorder.add(item)
            self.trouble, self._early = None, []
        except DefsenseError as error:
            state = "are no longer" if self._started.is_set() else "cannot be"
            self.trouble = Note.from_error(error, f"the readings {state} recorded: ")
            self._retry_at = time.monotonic() + _RETRY_DELAY_S
            self._close_recorder()

    def close(self) -> None:
        """End the recording."""
        self._is_closed = True
        self._close_recorder()

    def _close_recorder(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except DefsenseError as error:
            prefix = "the end of the readings was not recorded: "
            self.trouble = self.trouble or Note.from_error(error, prefix)


def since_last_run(device: Path) -> float:
    """Return the time since the last recorded run of a device ended, s; infinite without one."""
    ends = [path.stat().st_mtime for path in device.glob(f"live/*/{BOARD}")]
    return time.time() - max(ends) if ends else float("inf")


@dataclass(frozen=True)
class SavedAnimation:
    """An animation that was written.

    Attributes:
        file: The file.
        instead: Why it is not in the requested place, or None.
    """

    file: AnimationFile
    instead: str | None = None

    @property
    def summary(self) -> str:
        """One line on the file."""
        f = self.file
        reason = f"; it could not be written elsewhere: {self.instead}" if self.instead else ""
        return (
            f"{f.path}: {f.frames} frames, {f.seconds:.1f} s, {f.size / 1e6:.1f} MB; every vertex"
            f" within {f.error:.3f} mm{reason}"
        )


class Animations:
    """Record animations of a run, one at a time; a `FrameSink`.

    Args:
        rest: Vertices of the surface at rest (v, 3), mm.
        faces: Triangles (f, 3).
        spare: Functions that return other folders, tried in order if an animation cannot be
            written to its own. They may raise StorageError.

    Attributes:
        written: The animations that were finished.
    """

    name = "animation"
    news: Note | None = None

    def __init__(self, rest: Float, faces: Int, spare: Sequence[Callable[[], Path]] = ()) -> None:
        self._rest, self._faces, self._spare = rest, faces, tuple(spare)
        self._lock, self._finishing = threading.Lock(), threading.Lock()
        self._recorder: AnimationRecorder | None = None
        self._path = Path()
        self.written: list[SavedAnimation] = []

    @property
    def recording(self) -> Path | None:
        """File of the animation that is being recorded, or is not written yet; or None."""
        return None if self._recorder is None else self._path

    @property
    def recorder(self) -> AnimationRecorder | None:
        """Recorder of that animation, or None."""
        return self._recorder

    @property
    def trouble(self) -> Note | None:
        """Why the present recording has stopped, or None."""
        recorder = self._recorder
        return None if recorder is None else recorder.trouble

    @property
    def is_empty(self) -> bool:
        """Whether the present recording has no frames."""
        recorder = self._recorder
        return recorder is not None and not recorder.frames

    def start(self, path: Path) -> Path:
        """Start an animation.

        Args:
            path: The file; if it exists, the name gets a number.

        Returns:
            The file that will be written.

        Raises:
            LiveError: Another animation is being recorded.
            DefsenseError: No animation can be written to the path.
        """
        with self._lock:
            if self._recorder is not None:
                raise LiveError(
                    "is being recorded",
                    code="recording-active",
                    where=self._path,
                    action="Stop that recording first",
                )
            path = unused_path(path)
            self._recorder = AnimationRecorder(path, self._rest, self._faces)
            self._path = path
        return path

    def send(self, frame: LiveFrame) -> None:
        """Record a frame, if an animation is being recorded."""
        recorder = self._recorder
        if recorder is not None:
            recorder.add(frame)

    def finish(self) -> SavedAnimation | None:
        """Write the animation; None if none is being recorded.

        Raises:
            StorageError: No folder takes it; it is kept, so that this can be called again.
            LiveError: It has no frames.
        """
        with self._finishing:
            recorder = self._recorder
            if recorder is None:
                return None
            if self.is_empty:
                self.discard()
                raise LiveError(
                    "no frame with a surface was recorded",
                    code="no-frames",
                    where=self._path,
                    action="Leave the device at rest first, and then record for longer",
                )
            saved = self._save(recorder)
            self._recorder = None
            self.written.append(saved)
            return saved

    def discard(self) -> None:
        """End the animation without writing it."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def close(self) -> None:
        """Release nothing: `finish` is slow, and is called when everything live is closed."""

    def _save(self, recorder: AnimationRecorder) -> SavedAnimation:
        try:
            return SavedAnimation(recorder.finish(unused_path(self._path)))
        except StorageError as error:
            failures = [str(error)]
        for folder in self._spare:
            try:
                file = recorder.finish(unused_path(folder() / self._path.name))
                return SavedAnimation(file, failures[0])
            except StorageError as error:
                failures += [str(error)] if str(error) not in failures else []
        raise StorageError(
            "the animation cannot be written: " + "; nor elsewhere: ".join(failures),
            code="animation-not-written",
            failures=failures,
        )
