"""Control changes and notes, to a MIDI port or into a file."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterable
from pathlib import Path

from ...core.errors import OutputError, StorageError
from ...core.storage.files import unused_path, storage_errors, write_text
from ..frames.live_frame import LiveFrame
from .midi_mapping import MidiLearn, MidiMapper, as_toml, default_mapping, merged
from .midi_ports import MidiPort, MidiPorts, SystemPorts, find_port
from .output import controls_known, unknown_controls
from .settings import MidiMapping, MidiSettings

# A Standard MIDI File that is whole at any time, so that nothing is lost when a program ends.

_TICKS = 480  # of a quarter note, which takes half a second where no tempo is given
_PER_SECOND = 2 * _TICKS
_END = b"\x00\xff\x2f\x00"
_LENGTH_AT = 18  # of the track's length


class MidiFile:
    """Writes messages with their times; format 0, one track."""

    def __init__(self, path: Path, title: str) -> None:
        """A file that is there stays: the name gets a number. Raises StorageError."""
        self.path = unused_path(path)
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


_LOOK = 1.0  # s between looks whether the device is still there: its driver does not tell
_FLUSH = 1.0  # s between writes to the file


class MidiOutput:
    """An `Output` to a port, or into a file."""

    name = "midi"

    def __init__(self, settings: MidiSettings, ports: MidiPorts | None = None) -> None:
        """Raises OutputError where there is no such port, StorageError for the file."""
        self._settings, self._ports = settings, ports or SystemPorts()
        self._port: MidiPort | None = None
        self._port_name, self._looked = "", 0.0
        self._file: MidiFile | None = None
        self._flushed, self._time = time.monotonic(), 0.0
        self._mapping: list[MidiMapping] = list(settings.mapping)
        self._mapper = MidiMapper(self._mapping)
        self._choose = not (
            settings.mapping or settings.learn
        )  # a mapping, once there are controls
        self._anew = False  # notes that may sound shall end, and all be sent again
        self._learn: MidiLearn | None = None
        self._new: MidiMapping | None = None  # that was learned last
        self._learned_into, self._wrote = unused_path(Path(settings.learned)), False
        self._told = set[int]()  # channels whose instrument was chosen
        self.trouble: str | None = None
        try:
            self._look()
            if settings.file:  # at last: what raises is tried again, and would leave a file behind
                self._file = MidiFile(Path(settings.file), "defsense")
        except (OutputError, StorageError):
            self.close()
            raise

    @property
    def about(self) -> str:
        where = f"sends to {self._port_name!r}"
        if self._file is not None:
            where = f"writes to {self._file.path}"
        if self._learn is not None:
            where += f", learns from {self._learn.port_name!r} into {self._learned_into}"
        if self._new is not None:
            where += f"; {self._new.control} plays {self._new.place} from now on"
        return f"midi: {where}"

    def send(self, frame: LiveFrame) -> None:
        """Raises OutputError while the device is not plugged in; what could not be sent is sent
        with the next frame, after the end of all notes that may sound."""
        self._look()
        self._time = frame.time
        if self._learn is not None:
            self._learned(self._learn.watch(frame))
        if controls_known(frame):
            if self._choose:
                self._mapping, self._choose = default_mapping(frame, self._settings.channel), False
                self._mapper = MidiMapper(self._mapping)
            wanted = (one.control for one in self._mapping)
            self.trouble = unknown_controls("midi", wanted, frame)
        try:
            if self._anew:
                self._put(self._mapper.silence())
                self._mapper, self._anew = MidiMapper(self._mapping), False
            self._tell_instruments()
            self._put(self._mapper.messages(frame))
        except Exception:  # of whatever library: the device may have got any part of it
            self._anew = True
            raise
        self._flush()

    def close(self) -> None:
        """Notes that sound end."""
        try:
            self._put(self._mapper.silence())
        finally:
            if self._port is not None:
                self._port.close()
            if self._learn is not None:
                self._learn.close()
            if self._file is not None:
                self._file.close()

    def _tell_instruments(self) -> None:
        """Program changes, once for each channel in use."""
        program = self._settings.program
        if program is not None:
            for channel in sorted({one.channel for one in self._mapping} - self._told):
                self._put([bytes([0xC0 | channel - 1, program])])
                self._told.add(channel)

    def _put(self, messages: Iterable[bytes]) -> None:
        """One after the other: where one fails, the rest is not asked for."""
        for message in messages:
            if self._file is not None:
                self._file.add(message, self._time)
            elif self._port is not None:
                self._port.send(message)

    def _flush(self) -> None:
        if self._file is not None and time.monotonic() - self._flushed > _FLUSH:
            self._flushed = time.monotonic()
            self._file.flush()

    def _open(self) -> None:
        s = self._settings
        name = s.virtual or find_port(self._ports, s.device, inputs=False)
        self._port = self._ports.open(name, inputs=False, virtual=bool(s.virtual))
        self._port_name, self._looked = name, time.monotonic()
        self._told.clear()
        self._anew = True  # another device, perhaps: it gets all values

    def _look(self) -> None:
        """Open the ports that are not open; close those whose device was pulled out."""
        s = self._settings
        if self._port is None and not s.file:
            self._open()
        if self._learn is None and s.learn:
            self._learn = MidiLearn(s.learn, self._ports)
        if time.monotonic() - self._looked <= _LOOK:
            return
        self._looked = time.monotonic()
        port, learn = self._port, self._learn
        if port is not None and not s.virtual and not self._there(self._port_name, inputs=False):
            self._port = None
            port.close()
            raise OutputError(
                f"port {self._port_name!r} was disconnected",
                code="port-disconnected",
                where="midi",
                action="Plug the device in again",
                port=self._port_name,
            )
        if learn is not None and not self._there(learn.port_name, inputs=True):
            self._learn = None
            learn.close()
            raise OutputError(
                f"port {learn.port_name!r} was disconnected",
                code="port-disconnected",
                where="midi",
                action="Plug the device in again",
                port=learn.port_name,
            )

    def _there(self, name: str, inputs: bool) -> bool:
        return name in self._ports.names(inputs)

    def _learned(self, new: MidiMapping | None) -> None:
        """Play it from now on, and keep it, beside what an earlier run learned."""
        if new is None:
            return
        self._mapping, self._new = merged(self._mapping, new), new
        self._anew = True
        if not self._wrote:
            self._learned_into = unused_path(self._learned_into)
        write_text(self._learned_into, as_toml(self._mapping))
        self._wrote = True
