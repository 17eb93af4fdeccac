"""The command `defsense capture record`: record a device with cameras and read-out board."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.sessions.options import RecordOptions
from ..app import command
from ..device import DeviceFolder
from ..exit_codes import DONE, STOPPED
from ..output import OutputOptions, print_json, print_lines

if TYPE_CHECKING:
    from cyclopts import Token

    from ...core.guided_run import Screen
    from ...workflow.sessions.recording import RecordedSession


def _words(_: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    """Return addresses as they are: those of simulated cameras have commas."""
    return tuple(token.value for token in tokens)


_Cameras = Annotated[
    tuple[str, ...],
    Parameter(converter=_words, n_tokens=1, consume_multiple=True, metavar="CAMERA"),
]
_DEFAULTS = RecordOptions()
_NO_OUTPUT = OutputOptions()

record = command(
    "record",
    "defsense capture record my-device --cameras 0 2 --calibration cameras.toml"
    " --port /dev/ttyUSB0",
    "defsense capture record my-device --cameras twin --port twin",
)


@record.default
def _record(
    device: DeviceFolder,
    /,
    *,
    cameras: _Cameras,
    port: str,
    options: Annotated[RecordOptions, Parameter(name="*", negative=())] = _DEFAULTS,
    auto: bool = False,
    output: OutputOptions = _NO_OUTPUT,
) -> int:
    """Record a device with calibrated cameras and its read-out board.

    The screen shows the next pose, the pictures with the detected tags, the signals, and how much
    of each pose was seen. Everything is written immediately, so that nothing is lost if the program
    stops. Rerun the command to resume a session.

    Args:
        device: Folder that contains device.toml.
        cameras: Set the cameras, one per camera of the calibration: 0, /dev/video0; simulated ones
            (twin:webcam, twin:phone or twin:industrial, twin:seed=1,cameras=3; twin alone has
            webcams); or none, if another system records the markers.
        port: Set the port of the read-out board: /dev/ttyUSB0, COM3, socket://host:port,
            udp://HOST or tcp://HOST (Wi-Fi; HOST may be the name of a paired board), twin, or none
            (markers only).
        auto: Read no keys: steps follow automatically.
    """
    from ...core.device.device_file import load_device
    from ...workflow.sessions.recording import record_session
    from ..terminal.guided_screen import GuidedLines, GuidedTerminal

    def open_screen(_: object) -> AbstractContextManager[Screen]:
        return GuidedLines() if auto else GuidedTerminal()

    result = record_session(
        load_device(device),
        cameras,
        port,
        options,
        open_screen=open_screen,
        auto=auto,
        note=_print_note,
    )
    if output.json:
        print_json(result.summary)
    else:
        print_lines(_describe(result))
    return DONE if result.is_complete else STOPPED


def _print_note(text: str) -> None:
    sys.stderr.write(f"note: {text}\n")
    sys.stderr.flush()


def _describe(result: RecordedSession) -> list[str]:
    folder = result.session.folder
    process = f"defsense capture process {folder}"
    return [
        f"{result.last_run}: {result.ending}; {result.finished_steps} of"
        f" {len(result.session.steps)} steps",
        f"Next:    {process}"
        if result.is_complete
        else f"Next:    rerun the command to resume; {process} also accepts incomplete sessions",
    ]
