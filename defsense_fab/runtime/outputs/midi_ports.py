"""Find and open MIDI ports, by mido and RtMidi."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from ...core.errors import OutputError
from ...core.machine.optional_libraries import missing, missing_code

_ALSA_SEQUENCER = Path("/dev/snd/seq")
_LAST_PYTHON_WITH_WHEEL = (3, 12)  # for python-rtmidi 1.5, as in pyproject.toml


class SystemPorts:
    """The ports of this machine."""

    def names(self, inputs: bool) -> list[str]:
        """Return the names of inputs or outputs; raise OutputError without MIDI."""
        mido = _import_mido()
        try:
            return list(mido.get_input_names() if inputs else mido.get_output_names())
        except Exception as error:  # errors of RtMidi are not OSErrors
            raise _unavailable(str(error)) from None

    def open(self, name: str, inputs: bool, virtual: bool = False) -> MidiPort:
        """Open a port, or create a virtual one.

        Args:
            name: Name of the port.
            inputs: Whether it is an input.
            virtual: Whether to create it for other programs to connect to.

        Raises:
            OutputError: The port cannot be opened.
        """
        mido = _import_mido()
        try:
            opener = mido.open_input if inputs else mido.open_output
            return MidiPort(opener(name, virtual=virtual), mido)
        except Exception as error:
            raise OutputError(
                f"port {name!r} cannot be opened ({error})",
                code="port-unavailable",
                where="midi",
                action="Close other programs that use it",
                port=name,
            ) from None


class MidiPort:
    """An open port, input or output; messages are bytes."""

    def __init__(self, port: Any, mido: Any) -> None:
        self._port, self._mido = port, mido

    def send(self, message: bytes) -> None:
        """Send a message."""
        self._port.send(self._mido.Message.from_bytes(message))

    def pending(self) -> list[bytes]:
        """Return the messages that have arrived."""
        return [bytes(message.bytes()) for message in self._port.iter_pending()]

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def find_port(ports: SystemPorts, device: str, inputs: bool) -> str:
    """Return the first port whose name contains a text, in any case.

    Args:
        ports: The ports of the machine.
        device: The text; empty for the first port.
        inputs: Whether to search the inputs.

    Raises:
        OutputError: There is no such port.
    """
    names = ports.names(inputs)
    name = next((name for name in names if device.lower() in name.lower()), None)
    if name is None:
        direction = "input" if inputs else "output"
        requested = f" with {device!r} in its name" if device else ""
        available = ", ".join(map(repr, names)) or "none"
        raise OutputError(
            f"no {direction} port{requested}; available ports: {available}",
            code="port-not-found",
            where="midi",
            action="Plug the device in",
            device=device,
            inputs=inputs,
            ports=names,
        )
    return name


def _import_mido() -> Any:
    # Without the sequencer, RtMidi would print to the terminal.
    if sys.platform.startswith("linux") and not _ALSA_SEQUENCER.exists():
        raise _unavailable(f"no {_ALSA_SEQUENCER}")
    try:
        import mido
        import rtmidi  # noqa: F401  # which mido opens ports with
    except ImportError as error:
        raise OutputError(_describe_missing(error), code=missing_code(error)) from None
    return mido


def _describe_missing(error: ImportError) -> str:
    if error.name == "rtmidi" and sys.version_info[:2] > _LAST_PYTHON_WITH_WHEEL:
        compiled = "it has no wheel for this Python and is compiled"
        return missing("midi", error, package="python-rtmidi", otherwise=compiled)
    return missing("midi", error, "midi")


def _unavailable(reason: str) -> OutputError:
    return OutputError(
        f"this machine has no MIDI ({reason})",
        code="midi-unavailable",
        where="midi",
        action="On Linux load ALSA's sequencer (sudo modprobe snd-seq), or write to a file"
        ' (file = "x.mid")',
    )
