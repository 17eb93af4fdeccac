"""Text files that are only added to, line by line: recordings, and the logs of sessions.

Each line is one write at the file's end, so a program that dies leaves all but the line that it was
at. What goes on with such a file ends that line with a ~, which marks it as cut for good, even
where what is left of it would read like a line. A reader leaves out what was cut, and what a disk's
damaged block left of lines.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

from ..errors import CaptureError, StorageError
from .files import claim, storage_errors, unreadable_code

_CUT = b"~"
_FLAGS = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)


class AppendLog:
    """Adds lines to a file, from any thread; the file is this object's alone where the system and
    the file system have locks."""

    def __init__(self, path: Path, head: str = "", kind: str = "log") -> None:
        """Begin the file with the line or lines `head`, or go on with one that begins so. Raises
        CaptureError where it begins otherwise (it is no `kind`) or another program writes to it;
        StorageError where it cannot be written."""
        self._path, self._lock, self._whole = path, threading.Lock(), True
        with storage_errors(path):
            self._file = os.open(path, _FLAGS, 0o644)
        try:
            self._claim()
            self._begin(f"{head}\n".encode() if head else b"", kind)
        except BaseException:
            os.close(self._file)
            self._file = -1
            raise

    def line(self, text: str) -> None:
        """Add a line, or several that belong together, without the last one's end. Raises
        StorageError, as when the disk is full; what came of the line then is marked as cut."""
        with self._lock:
            if self._file < 0:
                raise StorageError(
                    f"{self._path}: is closed; nothing more can be written to it",
                    code="log-closed",
                    path=self._path,
                )
            with storage_errors(self._path):
                self._write((b"" if self._whole else _CUT + b"\n") + f"{text}\n".encode())

    def close(self) -> None:
        """Wait until all of it is on the disk; nothing is written from then on. Raises
        StorageError."""
        with self._lock:
            file, self._file = self._file, -1
        if file < 0:
            return
        with storage_errors(self._path):
            try:
                os.fsync(file)
            finally:
                os.close(file)

    def __enter__(self) -> AppendLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _claim(self) -> None:
        with storage_errors(self._path):
            if not claim(self._file):
                raise CaptureError(
                    f"{self._path}: another program is recording to it; stop that first",
                    code="file-in-use",
                    path=self._path,
                )

    def _begin(self, head: bytes, kind: str) -> None:
        with storage_errors(self._path):
            size = os.fstat(self._file).st_size
            begins = os.read(self._file, len(head)) if size else b""
            if not (head.startswith(begins) if size < len(head) else begins == head):
                raise CaptureError(
                    f"{self._path}: is no {kind}; choose another file",
                    code="wrong-file-kind",
                    path=self._path,
                    file_kind=kind,
                )
            if size < len(head):  # new, or cut off while it was begun
                self._write(head[size:])
            elif size:
                os.lseek(self._file, -1, os.SEEK_END)
                self._whole = os.read(self._file, 1) == b"\n"

    def _write(self, data: bytes) -> None:
        while data:
            count = os.write(self._file, data)
            self._whole = data[count - 1 : count] == b"\n"
            data = data[count:]


def was_cut(line: str) -> bool:
    """Whether a line, without its end, is marked as cut."""
    return line.endswith(_CUT.decode())


def is_damaged(line: str) -> bool:
    """Whether a line is what a disk's damaged block left."""
    return "\0" in line or "\ufffd" in line


class LogLines:
    """Iterates over the whole lines of a file, with their numbers from 1 on and without their ends;
    `cut` and `damaged` count those that were left out so far."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.cut = self.damaged = 0

    def __iter__(self) -> Iterator[tuple[int, str]]:
        """Raises CaptureError where the file cannot be read."""
        self.cut = self.damaged = 0
        try:
            with self._path.open("rb") as file:
                for number, data in enumerate(file, 1):
                    text = data.rstrip(b"\r\n").decode("utf-8", errors="replace")
                    if not data.endswith(b"\n") or was_cut(text):
                        self.cut += 1
                        continue
                    if is_damaged(text):
                        self.damaged += 1
                        continue
                    yield number, text
        except OSError as error:
            raise CaptureError(
                f"{self._path}: cannot be read: {error.strerror}",
                code=unreadable_code(error),
                path=self._path,
            ) from None

    @property
    def left_out(self) -> int:
        """Lines that were cut or damaged."""
        return self.cut + self.damaged
