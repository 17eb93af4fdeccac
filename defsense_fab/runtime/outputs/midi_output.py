"""Send controls as MIDI control changes and notes, to a port or into a file."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterable
from pathlib import Path

from ...core.errors import OutputError, StorageError
from ...core.storage.files import storage_errors, unused_path, write_text
from ..frames.live_frame import LiveFrame, Note
from .midi_mapping import MidiLearn, MidiMapper, default_mapping, mapping_toml, merge_mapping
from .midi_ports import MidiPort, SystemPorts, find_port
from .output import has_all_controls, unknown_controls_note
from .settings import MidiMapping, MidiSettings

_TICKS_PER_QUARTER = 480  # a quarter note takes half a second if no tempo is given
_TICKS_PER_SECOND = 2 * _TICKS_PER_QUARTER
_END_OF_TRACK = b"\x00\xff\x2f\x00"
_LENGTH_OFFSET = 18  # of the track's length in the file
_PROGRAM_CHANGE = 0xC0

_CHECK_INTERVAL_S = 1.0  # for a device that was unplugged, which its driver does not report
_FLUSH_INTERVAL_S = 1.0  # between writes to the file


class MidiFile:
    """A Standard MIDI File of format 0 that is complete after each flush.

    Nothing is lost when the program ends.

    Args:
        path: The file; if it exists, the name gets a number.
        title: Name of the track.

    Attributes:
        path: The file that is written.

    Raises:
        StorageError: The file cannot be created.
    """

    def __init__(self, path: Path, title: str) -> None:
        self.path = unused_path(path)
        with storage_errors(self.path):
            self._file = self.path.open("xb")
            self._file.write(b"MThd" + struct.pack(">IHHH", 6, 0, 1, _TICKS_PER_QUARTER))
            self._file.write(b"MTrk" + struct.pack(">I", 0))
        name = title.encode("utf-8")[:100]
        self._pending = b"\x00\xff\x03" + _variable_length(len(name)) + name
        self._start: float | None = None
        self._length = self._tick = 0
        self.flush()

    def add(self, message: bytes, time: float) -> None:
        """Add a message.

        Args:
            message: The message.
            time: Its time, s, counted from the first message; a time before the last message
                counts as that of the last.
        """
        if self._start is None:
            self._start = time
        tick = max(self._tick, round((time - self._start) * _TICKS_PER_SECOND))
        self._pending += _variable_length(tick - self._tick) + message
        self._tick = tick

    def flush(self) -> None:
        """Write the added messages and the end of the track; may raise StorageError."""
        with storage_errors(self.path):
            self._file.seek(_LENGTH_OFFSET + 4 + self._length)
            self._file.write(self._pending + _END_OF_TRACK)
            self._length += len(self._pending)
            self._pending = b""
            self._file.seek(_LENGTH_OFFSET)
            self._file.write(struct.pack(">I", self._length + len(_END_OF_TRACK)))
            self._file.flush()

    def close(self) -> None:
        """Flush and close the file."""
        try:
            self.flush()
        finally:
            self._file.close()


def _variable_length(value: int) -> bytes:
    """Encode a number in groups of seven bits; all but the last have the high bit set."""
    groups = [value & 0x7F]
    while value := value >> 7:
        groups.append(0x80 | value & 0x7F)
    return bytes(reversed(groups))


class MidiOutput:
    """An `Output` to a MIDI port, or into a file.

    Args:
        settings: Port or file, and mapping.
        ports: The ports of the machine.

    Attributes:
        trouble: A note on mapped controls that the device does not have, or None.

    Raises:
        OutputError: There is no such port.
        StorageError: The file cannot be created.
    """

    name = "midi"

    def __init__(self, settings: MidiSettings, ports: SystemPorts | None = None) -> None:
        self._settings, self._ports = settings, ports or SystemPorts()
        self._port: MidiPort | None = None
        self._port_name, self._checked_at = "", 0.0
        self._file: MidiFile | None = None
        self._flushed_at, self._time = time.monotonic(), 0.0
        self._mapping: list[MidiMapping] = list(settings.mapping)
        self._mapper = MidiMapper(self._mapping)
        self._needs_mapping = settings.has_default_mapping
        self._must_restart = False  # notes that may sound must end, and all values be sent again
        self._learn: MidiLearn | None = None
        self._last_learned: MidiMapping | None = None
        self._learned_path, self._has_written = unused_path(Path(settings.learned)), False
        self._channels_with_program = set[int]()
        self.trouble: Note | None = None
        try:
            self._check_ports()
            if settings.file:  # last, so that retries of the ports leave no files behind
                self._file = MidiFile(Path(settings.file), "defsense")
        except (OutputError, StorageError):
            self.close()
            raise

    @property
    def about(self) -> str:
        """Description of what is sent where, and of the mapping that was learned last."""
        text = f"sends to {self._port_name!r}"
        if self._file is not None:
            text = f"writes to {self._file.path}"
        if self._learn is not None:
            text += f", learns from {self._learn.port_name!r} into {self._learned_path}"
        if self._last_learned is not None:
            text += f"; {self._last_learned.control} now plays {self._last_learned.place}"
        return f"midi: {text}"

    def send(self, frame: LiveFrame) -> None:
        """Send the changes of a frame.

        What could not be sent is sent with the next frame, after the end of all notes that may
        sound.

        Raises:
            OutputError: The device is not plugged in.
        """
        self._check_ports()
        self._time = frame.time
        if self._learn is not None:
            self._apply_learned(self._learn.watch(frame))
        if has_all_controls(frame):
            if self._needs_mapping:
                self._mapping = default_mapping(frame, self._settings.channel)
                self._mapper, self._needs_mapping = MidiMapper(self._mapping), False
            controls = (entry.control for entry in self._mapping)
            self.trouble = unknown_controls_note("midi", controls, frame)
        try:
            if self._must_restart:
                self._put(self._mapper.silence())
                self._mapper, self._must_restart = MidiMapper(self._mapping), False
            self._choose_programs()
            self._put(self._mapper.messages(frame))
        except Exception:  # of any library: the device may have received any part of it
            self._must_restart = True
            raise
        if self._file is not None and time.monotonic() - self._flushed_at > _FLUSH_INTERVAL_S:
            self._flushed_at = time.monotonic()
            self._file.flush()

    def close(self) -> None:
        """End all notes, and close the ports and the file."""
        try:
            self._put(self._mapper.silence())
        finally:
            if self._port is not None:
                self._port.close()
            if self._learn is not None:
                self._learn.close()
            if self._file is not None:
                self._file.close()

    def _choose_programs(self) -> None:
        """Send a program change, once for each channel in use."""
        program = self._settings.program
        if program is not None:
            channels = {entry.channel for entry in self._mapping} - self._channels_with_program
            for channel in sorted(channels):
                self._put([bytes([_PROGRAM_CHANGE | channel - 1, program])])
                self._channels_with_program.add(channel)

    def _put(self, messages: Iterable[bytes]) -> None:
        """Send messages one by one: after a failure, no further message is requested."""
        for message in messages:
            if self._file is not None:
                self._file.add(message, self._time)
            elif self._port is not None:
                self._port.send(message)

    def _open(self) -> None:
        s = self._settings
        name = s.virtual or find_port(self._ports, s.device, inputs=False)
        self._port = self._ports.open(name, inputs=False, virtual=bool(s.virtual))
        self._port_name, self._checked_at = name, time.monotonic()
        self._channels_with_program.clear()
        self._must_restart = True  # it may be another device, which needs all values

    def _check_ports(self) -> None:
        """Open ports that are not open, and close those whose device was unplugged."""
        s = self._settings
        if self._port is None and not s.file:
            self._open()
        if self._learn is None and s.learn:
            self._learn = MidiLearn(s.learn, self._ports)
        if time.monotonic() - self._checked_at <= _CHECK_INTERVAL_S:
            return
        self._checked_at = time.monotonic()
        port, learn = self._port, self._learn
        if port is not None and not s.virtual and not self._exists(self._port_name, inputs=False):
            self._port = None
            port.close()
            raise _disconnected(self._port_name)
        if learn is not None and not self._exists(learn.port_name, inputs=True):
            self._learn = None
            learn.close()
            raise _disconnected(learn.port_name)

    def _exists(self, name: str, inputs: bool) -> bool:
        return name in self._ports.names(inputs)

    def _apply_learned(self, new: MidiMapping | None) -> None:
        """Use a learned mapping, and write it next to the files of earlier runs."""
        if new is None:
            return
        self._mapping, self._last_learned = merge_mapping(self._mapping, new), new
        self._must_restart = True
        if not self._has_written:
            self._learned_path = unused_path(self._learned_path)
        write_text(self._learned_path, mapping_toml(self._mapping))
        self._has_written = True


def _disconnected(port: str) -> OutputError:
    return OutputError(
        f"port {port!r} was disconnected",
        code="port-disconnected",
        where="midi",
        action="Plug the device in again",
        port=port,
    )
