"""The commands `defsense board micropython | pair`: boards with Wi-Fi."""

from __future__ import annotations

import getpass
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ...core.errors import CaptureError
from ...workflow.board.options import MicroPythonOptions, PairOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines, progress_bars, standard_output

PASSWORD_VARIABLE = "DEFSENSE_WIFI_PASSWORD"  # noqa: S105
_PROGRAM, _PAIR, _OUTPUT = MicroPythonOptions(), PairOptions(), OutputOptions()
_PORT = "/dev/ttyACM0"  # in the lines to type

micropython = command(
    "micropython",
    "defsense board micropython my-board",
    "defsense board micropython my-board --converter internal",
)
pair = command(
    "pair",
    "defsense board pair --port /dev/ttyACM0",
    "defsense board pair --port COM3 --name elbow --network lab",
)


@micropython.default
def _micropython(
    folder: Path,
    /,
    *,
    options: Annotated[MicroPythonOptions, Parameter(name="*")] = _PROGRAM,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the program for an ESP32 or a Raspberry Pi Pico W to a folder.

    The program is for MicroPython, which must be on the board. The lines to type next copy it to
    the board; config.py has the pins.

    Args:
        folder: Set the folder for the program.
    """
    from ...workflow.board.pair import write_program

    files = write_program(folder, options)
    # Shells of Windows pass patterns on as they are.
    sources = " ".join(map(str, files)) if os.name == "nt" else f"{folder}/*.py"
    with standard_output():
        if output.json:
            print_json({"files": [str(file) for file in files]})
            return
        print_lines(
            [
                f"Wrote:   {len(files)} files in {folder}",
                f"Next:    mpremote connect {_PORT} cp {sources} : + reset",
                f"         defsense board pair --port {_PORT}",
            ]
        )


@pair.default
def _pair(
    *,
    options: Annotated[PairOptions, Parameter(name="*")] = _PAIR,
    network: str | None = None,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Connect a board to Wi-Fi and pair it with this computer.

    Asks for the password of the network; scripts set it in the environment as
    DEFSENSE_WIFI_PASSWORD. Name and password are stored on the board only; the key of the board
    is stored on this computer, too. Anyone who can read either can pretend to be the board.

    Args:
        network: Set the name of the Wi-Fi network (default: the command asks for it).
    """
    from ...workflow.board.pair import pair_board

    network = network or _ask_network()
    password = os.environ.get(PASSWORD_VARIABLE)
    if password is None:
        password = _ask_password(network)
    with progress_bars(output) as progress:
        result = pair_board(network, password, options, progress=progress)
    with standard_output():
        if output.json:
            print_json(asdict(result))
            return
        title = result.name or result.board_id
        print_lines(
            [
                f"{title} has joined {network} at {result.address}.",
                *([] if options.key else [_WARNING]),
                f"Next:    defsense board ports --port {result.port}",
            ]
        )


_WARNING = (
    "Warning: the board has no key. Anyone on the network can forge its readings and change its"
    " settings."
)


def _ask_network() -> str:
    """Ask on standard error for the name of the network."""
    _require_terminal("network", "Give the name with --network")
    sys.stderr.write("Name of the Wi-Fi network: ")
    sys.stderr.flush()
    name = sys.stdin.readline().rstrip("\r\n")
    if not name:
        raise CaptureError(
            "the name of the network is empty",
            code="wifi-name-missing",
            where="network",
            action="Run the command again and type the name",
        )
    return name


def _ask_password(network: str) -> str:
    """Ask for the password, which the terminal does not show."""
    _require_terminal("password", f"Set {PASSWORD_VARIABLE} in the environment")
    return getpass.getpass(f"Password of {network} (empty for an open network): ")


def _require_terminal(where: str, action: str) -> None:
    if not sys.stdin.isatty():
        raise CaptureError(
            "there is no terminal on which to ask for it",
            code="wifi-credentials-missing",
            where=where,
            action=action,
        )
