"""A Standard MIDI File that is whole at any time, so that nothing is lost when a program ends."""

from __future__ import annotations

import struct
from pathlib import Path

from ....core.storage.files import free_path, storage_errors

_TICKS = 480  # of a quarter note, which takes half a second where no tempo is given
_PER_SECOND = 2 * _TICKS
_END = b"\x00\xff\x2f\x00"
_LENGTH_AT = 18  # of the track's length


class MidiFile:
    """Writes messages with their times; format 0, one track."""

    def __init__(self, path: Path, title: str) -> None:
        """A file that is there stays: the name gets a number. Raises StorageError."""
        self.path = free_path(path)
        with storage_errors(self.path):
            self._file = self.path.open("xb")
            self._file.write(b"MThd" + struct.pack(">IHHH", 6, 0, 1, _TICKS))
            self._file.write(b"MTrk" + struct.pack(">I", 0))
        name = title.encode("utf-8")[:100]
        self._pending = b"\x00\xff\x03" + _length(len(name)) + name
        self._begin: float | None = None
        self._length = self._tick = 0
        self.flush()

    def add(self, message: bytes, time: float) -> None:
        """At `time` (s), which begins with that of the first message; an earlier one than the last
        counts as the last."""
        if self._begin is None:
            self._begin = time
        tick = max(self._tick, round((time - self._begin) * _PER_SECOND))
        self._pending += _length(tick - self._tick) + message
        self._tick = tick

    def flush(self) -> None:
        """Write what was added, and the end behind it. Raises StorageError."""
        with storage_errors(self.path):
            self._file.seek(_LENGTH_AT + 4 + self._length)
            self._file.write(self._pending + _END)
            self._length += len(self._pending)
            self._pending = b""
            self._file.seek(_LENGTH_AT)
            self._file.write(struct.pack(">I", self._length + len(_END)))
            self._file.flush()

    def close(self) -> None:
        try:
            self.flush()
        finally:
            self._file.close()


def _length(value: int) -> bytes:
    """A number in groups of seven bits, the last group without the high bit."""
    out = [value & 0x7F]
    while value := value >> 7:
        out.append(0x80 | value & 0x7F)
    return bytes(reversed(out))
