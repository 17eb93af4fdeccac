"""Control changes and notes, to a MIDI port or into a file."""

from __future__ import annotations

import time
from pathlib import Path

from ....core.errors import OutputError
from ...frames.live_frame import LiveFrame
from ..output import unknown_controls
from ..settings import MidiSettings
from .mapping import MidiMapper, default_mapping
from .midi_file import MidiFile
from .ports import MidiPort, MidiPorts, SystemPorts, find_port

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
        self._mapper = MidiMapper(settings.mapping) if settings.mapping else None
        self.trouble: str | None = None
        if settings.file:
            self._file = MidiFile(Path(settings.file), "defsense")
        else:
            self._open()

    @property
    def about(self) -> str:
        if self._file is not None:
            return f"midi: writes to {self._file.path}"
        return f"midi: sends to {self._port_name!r}"

    def send(self, frame: LiveFrame) -> None:
        """Raises OutputError while the device is not plugged in."""
        if self._file is None:
            self._look()
        if self._mapper is None:
            self._mapper = MidiMapper(default_mapping(frame))
        wanted = (one.control for one in self._settings.mapping)
        self.trouble = unknown_controls("midi", wanted, frame)
        self._time = frame.time
        self._put(self._mapper.messages(frame))

    def close(self) -> None:
        """Notes that sound end."""
        try:
            if self._mapper is not None:
                self._put(self._mapper.silence())
        finally:
            if self._port is not None:
                self._port.close()
            if self._file is not None:
                self._file.close()

    def _put(self, messages: list[bytes]) -> None:
        if self._file is not None:
            for message in messages:
                self._file.add(message, self._time)
            if time.monotonic() - self._flushed > _FLUSH:
                self._flushed = time.monotonic()
                self._file.flush()
        elif self._port is not None:
            for message in messages:
                self._port.send(message)

    def _open(self) -> None:
        s = self._settings
        name = s.virtual or find_port(self._ports, s.device, inputs=False)
        self._port = self._ports.open(name, inputs=False, virtual=bool(s.virtual))
        self._port_name, self._looked = name, time.monotonic()
        if self._mapper is not None:
            self._mapper.silence()  # another device, perhaps: it gets all values

    def _look(self) -> None:
        """Open the port where it is not; close it where its device was pulled out."""
        if self._port is None:
            self._open()
        elif not self._settings.virtual and time.monotonic() - self._looked > _LOOK:
            self._looked = time.monotonic()
            if self._port_name not in self._ports.names(inputs=False):
                port, self._port = self._port, None
                port.close()
                raise OutputError(f"midi: {self._port_name!r} was pulled out; plug it in again")
