"""The command `defsense board flash`: write the firmware to an Arduino."""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...core.errors import CaptureError
from ...workflow.board.options import FlashOptions
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, print_json, print_lines, progress_bars, standard_output

if TYPE_CHECKING:
    from ...workflow.board.flash import FlashResult

_OPTIONS, _OUTPUT = FlashOptions(), OutputOptions()

flash = command(
    "flash",
    "defsense board flash",
    "defsense board flash my-device --port /dev/ttyUSB0",
    "defsense board flash --board uno --converter ads1115 --yes",
)


@flash.default
def _flash(
    device: DeviceFolder | None = None,
    /,
    *,
    options: Annotated[FlashOptions, Parameter(name="*")] = _OPTIONS,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the firmware to an Arduino Nano or Uno.

    Resets the board, writes the firmware through the board's boot loader, reads it back, and
    checks that it runs. Nothing is written if the board already runs this version. If the command
    is interrupted, run it again: the boot loader itself is never overwritten.

    Args:
        device: Set the device folder, whose device.toml selects board and converter.
    """
    from ...workflow.board.flash import flash_board

    def run(options: FlashOptions) -> FlashResult:
        with progress_bars(output) as progress:
            return flash_board(device, options, progress=progress)

    try:
        result = run(options)
    except CaptureError as error:
        if error.code != "replacement-not-confirmed":
            raise
        if output.json or not sys.stdin.isatty() or not _ask(error.where):
            error.action = "Repeat the command with --yes to replace it, or choose another port"
            raise
        result = run(replace(options, yes=True, force=True))
    with standard_output():
        if output.json:
            print_json(asdict(result))
        else:
            print_lines(_describe(result))


def _ask(port: str) -> bool:
    """Ask on standard error whether to replace the program on a board."""
    sys.stderr.write(f"The board on {port} runs another program, or none. Replace it? [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _describe(result: FlashResult) -> list[str]:
    if result.boot_loader is None:
        lines = [f"{result.port} already runs firmware {result.version}; --force writes it again."]
    else:
        before = f"; it had {result.previous}" if result.previous else ""
        lines = [f"{result.port} runs firmware {result.version}{before}."]
    if not result.channels:
        lines.append("No ADS1115 answers yet: check its wiring before you read the board.")
    return [*lines, f"Next:    defsense board ports --port {result.port}"]
