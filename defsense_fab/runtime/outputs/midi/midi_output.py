"""Control changes and notes, to a MIDI port or into a file."""

from __future__ import annotations

import time
from pathlib import Path

from ....core.errors import OutputError
from ....core.files import write_text
from ...frames.live_frame import LiveFrame
from ..output import unknown_controls
from ..settings import MidiMapping, MidiSettings
from .mapping import MidiMapper, default_mapping
from .midi_file import MidiFile
from .midi_learn import MidiLearn, as_toml, merged
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
        self._mapping: list[MidiMapping] = list(settings.mapping)
        known = bool(settings.mapping or settings.learn)
        self._mapper = MidiMapper(settings.mapping) if known else None
        self._learn: MidiLearn | None = None
        self._new: MidiMapping | None = None  # that was learned last
        self._told = False  # which instruments play
        self.trouble: str | None = None
        if settings.file:
            self._file = MidiFile(Path(settings.file), "defsense")
        self._look()

    @property
    def about(self) -> str:
        where = f"sends to {self._port_name!r}"
        if self._file is not None:
            where = f"writes to {self._file.path}"
        if self._learn is not None:
            where += f", learns from {self._learn.port_name!r} into {self._settings.learned}"
        if self._new is not None:
            where += f"; {self._new.control} plays {self._new.place} from now on"
        return f"midi: {where}"

    def send(self, frame: LiveFrame) -> None:
        """Raises OutputError while the device is not plugged in."""
        self._look()
        if self._learn is not None:
            self._learned(self._learn.watch(frame))
        if self._mapper is None:
            self._mapper = MidiMapper(default_mapping(frame))
        wanted = (one.control for one in self._mapping)
        self.trouble = unknown_controls("midi", wanted, frame)
        self._time = frame.time
        self._put([*self._instruments(), *self._mapper.messages(frame)])

    def close(self) -> None:
        """Notes that sound end."""
        try:
            if self._mapper is not None:
                self._put(self._mapper.silence())
        finally:
            if self._port is not None:
                self._port.close()
            if self._learn is not None:
                self._learn.close()
            if self._file is not None:
                self._file.close()

    def _instruments(self) -> list[bytes]:
        """Program changes, once for each port."""
        program = self._settings.program
        if program is None or self._told:
            return []
        self._told = True
        channels = sorted({one.channel for one in self._mapping} or {1})
        return [bytes([0xC0 | channel - 1, program]) for channel in channels]

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
        self._told = False
        if self._mapper is not None:
            self._mapper.silence()  # another device, perhaps: it gets all values

    def _look(self) -> None:
        """Open the ports that are not open; close those whose device was pulled out."""
        s = self._settings
        if self._port is None and self._file is None:
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
            raise OutputError(f"midi: {self._port_name!r} was pulled out; plug it in again")
        if learn is not None and not self._there(learn.port_name, inputs=True):
            self._learn = None
            learn.close()
            raise OutputError(f"midi: {learn.port_name!r} was pulled out; plug it in again")

    def _there(self, name: str, inputs: bool) -> bool:
        return name in self._ports.names(inputs)

    def _learned(self, new: MidiMapping | None) -> None:
        """Play it from now on, and keep it."""
        if new is None:
            return
        if self._mapper is not None:
            self._put(self._mapper.silence())
        self._mapping = merged(self._mapping, new)
        self._mapper, self._new = MidiMapper(self._mapping), new
        write_text(Path(self._settings.learned), as_toml(self._mapping))
