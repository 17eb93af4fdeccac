"""The command `defsense board check`: find faults of a device's wiring."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...workflow.board.options import CheckOptions
from ..app import command
from ..device import DeviceFolder
from ..exit_codes import DONE, NO, STOPPED
from ..output import OutputOptions, print_json, print_lines, standard_output
from .ports import Port, warn_of_port

if TYPE_CHECKING:
    from ...workflow.board.check import BoardCheck

_CHECK, _OUTPUT = CheckOptions(), OutputOptions()

check = command(
    "check",
    "defsense board check my-device --port /dev/ttyUSB0",
    "defsense board check my-device --port /dev/ttyUSB0 --reference 1200 --view 8080",
    "defsense board check my-device --port twin:unit=2,loose=A --auto",
)


@check.default
def _check(
    device: DeviceFolder,
    *,
    port: Port,
    auto: bool = False,
    view: Annotated[int | None, Parameter(metavar="PORT")] = None,
    options: Annotated[CheckOptions, Parameter(name="*")] = _CHECK,
    output: OutputOptions = _OUTPUT,
) -> int:
    """Check the wiring of a device and state what to repair.

    Compares the readings of each channel with those that the build expects: hands off, while each
    wire is moved, and in a pose if only that shows which cord is on which pin. Finds open, shorted,
    exchanged and loose wires, wrong reference resistors, noise and hum of the mains. Returns 1 if
    a channel needs attention.

    Args:
        device: Choose the folder of the device, which is built.
        port: Set the port of the read-out board; faults of the twin are listed in
            docs/board-reference.md.
        auto: Start each step without a key.
        view: Show the steps in the browser, too, on this port.
    """
    from ...workflow.board.check import check_board
    from ..terminal.guided_screen import GuidedLines, GuidedTerminal

    def print_address(url: str) -> None:
        sys.stderr.write(f"View:    {url}\n")

    warn_of_port(port)
    result = check_board(
        device,
        port,
        options,
        screen=GuidedLines() if auto else GuidedTerminal(),
        auto=auto,
        page=view,
        on_page=print_address,
    )
    with standard_output():
        if output.json:
            print_json(_check_data(result), allow_nan=False)
        else:
            print_lines(_describe(result))
    if not result.findings:
        return STOPPED
    return DONE if result.is_sound else NO


def _check_data(result: BoardCheck) -> dict[str, Any]:
    return {
        "device": result.device,
        "sound": result.is_sound,
        "complete": result.is_complete,
        "rate": result.sampling.rate,
        "average": result.sampling.averages,
        "reference": list(result.reference),
        "poses": list(result.poses),
        "channels": [
            asdict(f) | {"data": {k: v if math.isfinite(v) else None for k, v in f.data.items()}}
            for f in result.findings
        ],
        "notes": [{"code": n.code, "text": n.text} for n in result.notices],
    }


def _describe(result: BoardCheck) -> list[str]:
    lines = [f"{f.code:<16} {f}" for f in result.findings]
    lines += [f"note: {n}" for n in result.notices]
    if not result.findings:
        lines.append("Stopped before the readings at rest were complete; nothing was checked.")
    elif not result.is_complete:
        lines.append("Not all steps were done: their faults are not checked.")
    if result.is_sound:
        lines.append("Next:    defsense capture record, or defsense run with a trained model")
    elif result.findings:
        lines.append("Next:    repair the channels above, and repeat the check")
    return lines
