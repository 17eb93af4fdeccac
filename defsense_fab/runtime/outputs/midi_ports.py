"""MIDI ports by mido and RtMidi."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Protocol

from ...core.errors import OutputError
from ...core.machine.optional_libraries import missing

_ALSA = Path("/dev/snd/seq")
_LAST_WITH_WHEEL = (3, 12)  # Python that python-rtmidi 1.5 has wheels for, as in pyproject.toml


class MidiPort(Protocol):
    """An open port: messages as bytes, out or in."""

    def send(self, message: bytes) -> None: ...

    def pending(self) -> list[bytes]: ...

    def close(self) -> None: ...


class MidiPorts(Protocol):
    """Where ports are found and opened."""

    def names(self, inputs: bool) -> list[str]: ...

    def open(self, name: str, inputs: bool, virtual: bool = False) -> MidiPort: ...


class SystemPorts:
    """The machine's."""

    def names(self, inputs: bool) -> list[str]:
        """Raises OutputError where the machine has no MIDI."""
        mido = _mido()
        try:
            return list(mido.get_input_names() if inputs else mido.get_output_names())
        except Exception as error:  # RtMidi's own, which are no OSErrors
            raise _no_midi(str(error)) from None

    def open(self, name: str, inputs: bool, virtual: bool = False) -> MidiPort:
        mido = _mido()
        try:
            opener = mido.open_input if inputs else mido.open_output
            return _Port(opener(name, virtual=virtual), mido)
        except Exception as error:
            raise OutputError(
                f"port {name!r} cannot be opened ({error})",
                code="port-unavailable",
                where="midi",
                action="Close other programs that use it",
                port=name,
            ) from None


class _Port:
    def __init__(self, port: Any, mido: Any) -> None:
        self._port, self._mido = port, mido

    def send(self, message: bytes) -> None:
        self._port.send(self._mido.Message.from_bytes(message))

    def pending(self) -> list[bytes]:
        found = self._port.iter_pending()
        return [bytes(message.bytes()) for message in found]

    def close(self) -> None:
        self._port.close()


def find_port(ports: MidiPorts, device: str, inputs: bool) -> str:
    """The first name that contains `device`, in whatever case. Raises OutputError."""
    names = ports.names(inputs)
    found = next((name for name in names if device.lower() in name.lower()), None)
    if found is None:
        way = "in" if inputs else "out"
        have = ", ".join(map(repr, names)) or "none"
        asked = f" with {device!r} in its name" if device else ""
        raise OutputError(
            f"no {way}put port{asked}; available ports: {have}",
            code="port-not-found",
            where="midi",
            action="Plug the device in",
            device=device,
            inputs=inputs,
            ports=names,
        )
    return found


def _mido() -> Any:
    # RtMidi would write its own complaint to the terminal.
    if sys.platform.startswith("linux") and not _ALSA.exists():
        raise _no_midi(f"no {_ALSA}")
    try:
        import mido
        import rtmidi  # noqa: F401  # what mido opens ports with
    except ImportError as error:
        raise OutputError(_brought_by(error), code="package-missing") from None
    return mido


def _brought_by(error: ImportError) -> str:
    if error.name == "rtmidi" and sys.version_info[:2] > _LAST_WITH_WHEEL:
        compiled = "it has no wheel for this Python and is compiled"
        return missing("midi", error, package="python-rtmidi", otherwise=compiled)
    return missing("midi", error, "midi")


def _no_midi(why: str) -> OutputError:
    return OutputError(
        f"this machine has no MIDI ({why})",
        code="midi-unavailable",
        where="midi",
        action="On Linux load ALSA's sequencer (sudo modprobe snd-seq), or write to a file"
        ' (file = "x.mid")',
    )
