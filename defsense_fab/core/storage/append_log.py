"""Text files to which lines are only appended: recordings, and the logs of sessions.

Each line is one write at the file's end, so a program that dies loses at most the line that it was
writing. A program that continues such a file ends the incomplete line with a ~, which marks it as
cut for good, even where the rest reads like a complete line. Readers skip lines that are cut, and
lines that a damaged block of the disk has garbled.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

from ..errors import CaptureError, StorageError
from .files import storage_errors, try_lock, unreadable_code

_CUT_MARK = b"~"
_FLAGS = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)


class AppendLog:
    """Appends lines to a file, from any thread.

    No other program can append to it meanwhile, where the file system has locks.

    Args:
        path: File to create or to continue.
        head: First line or lines of the file.
        kind: What the file is called in errors.

    Raises:
        CaptureError: The file starts with other lines, or another program writes to it.
        StorageError: The file cannot be written.
    """

    def __init__(self, path: Path, head: str = "", kind: str = "log") -> None:
        self._path, self._lock = path, threading.Lock()
        self._ends_with_newline = True
        with storage_errors(path):
            self._file = os.open(path, _FLAGS, 0o644)
        try:
            self._claim()
            self._start(f"{head}\n".encode() if head else b"", kind)
        except BaseException:
            os.close(self._file)
            self._file = -1
            raise

    def line(self, text: str) -> None:
        """Append a line, or several that belong together.

        Args:
            text: The line, without the end of the last line.

        Raises:
            StorageError: The log is closed, or the system refused, as when the disk is full. A
                line that was written in part is then marked as cut.
        """
        with self._lock:
            if self._file < 0:
                raise StorageError(
                    "is closed; nothing more can be written to it",
                    code="log-closed",
                    where=self._path,
                    path=self._path,
                )
            with storage_errors(self._path):
                mark = b"" if self._ends_with_newline else _CUT_MARK + b"\n"
                self._write(mark + f"{text}\n".encode())

    def close(self) -> None:
        """Wait until everything is on the disk, and close the file. Idempotent.

        Raises:
            StorageError: The system refused.
        """
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
            if not try_lock(self._file):
                raise CaptureError(
                    "another program is recording to it",
                    code="file-in-use",
                    where=self._path,
                    action="Stop that program first",
                    path=self._path,
                )

    def _start(self, head: bytes, kind: str) -> None:
        with storage_errors(self._path):
            size = os.fstat(self._file).st_size
            start = os.read(self._file, len(head)) if size else b""
            if not (head.startswith(start) if size < len(head) else start == head):
                raise CaptureError(
                    f"is not a {kind}",
                    code="wrong-file-format",
                    where=self._path,
                    action="Choose another file",
                    path=self._path,
                    file_kind=kind,
                )
            if size < len(head):  # new, or cut off within its head
                self._write(head[size:])
            elif size:
                os.lseek(self._file, -1, os.SEEK_END)
                self._ends_with_newline = os.read(self._file, 1) == b"\n"

    def _write(self, data: bytes) -> None:
        while data:
            count = os.write(self._file, data)
            self._ends_with_newline = data[count - 1 : count] == b"\n"
            data = data[count:]


def was_cut(line: str) -> bool:
    """Return whether a line, without its end, is marked as cut."""
    return line.endswith(_CUT_MARK.decode())


def is_damaged(line: str) -> bool:
    """Return whether a line comes from a damaged block of the disk."""
    return "\0" in line or "\ufffd" in line


class LogLines:
    """Iterates over the complete lines of a log, with their numbers from 1 and without their ends.

    Args:
        path: File to read.

    Attributes:
        cut: Lines skipped so far because they are cut.
        damaged: Lines skipped so far because they are damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.cut = self.damaged = 0

    def __iter__(self) -> Iterator[tuple[int, str]]:
        """Iterate from the start.

        Raises:
            CaptureError: The file cannot be read.
        """
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
                f"cannot be read: {error.strerror}",
                code=unreadable_code(error),
                where=self._path,
                action="Check the path and its permissions",
                path=self._path,
            ) from None

    @property
    def skipped(self) -> int:
        """Lines skipped so far because they are cut or damaged."""
        return self.cut + self.damaged
