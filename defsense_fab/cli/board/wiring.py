"""The command `defsense board wiring`: how the cords are connected to a board."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...workflow.board.options import WiringOptions
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, console, print_json, print_lines, standard_output

if TYPE_CHECKING:
    from ...workflow.board.wiring import WiringFiles

_DEFAULT, _OUTPUT = WiringOptions(), OutputOptions()

wiring = command(
    "wiring",
    "defsense board wiring my-device",
    "defsense board wiring my-device --board esp32 --converter ads1115 --out my-wiring",
)


@wiring.default
def _wiring(
    device: DeviceFolder,
    /,
    *,
    options: Annotated[WiringOptions, Parameter(name="*")] = _DEFAULT,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Draw how the cords of a built device are connected to a board.

    Prints where each wire leads and which resistor it needs, and writes wiring.svg, a drawing, and
    wireviz.yml, from which the program WireViz draws a harness and lists its materials.

    Args:
        device: Folder that contains device.toml.
    """
    from ...core.device.device_file import load_device
    from ...workflow.board.wiring import write_wiring

    result = write_wiring(load_device(device), options)
    with standard_output():
        if output.json:
            print_json(_to_plain(result))
        else:
            _show(result)


def _show(result: WiringFiles) -> None:
    from rich.table import Table
    from rich.text import Text

    for table in result.tables:
        shown = Table(title=table.title)
        for heading in table.header:
            shown.add_column(heading)
        for row in table.rows:
            shown.add_row(*map(Text, row))
        console().print(shown)
    print_lines(f"note: {note}" for note in result.wiring.notes)
    print_lines(
        [
            f"Wrote:   {result.drawing}, {result.harness}",
            "Next:    connect the board, then defsense board ports",
        ]
    )


def _to_plain(result: WiringFiles) -> dict[str, Any]:
    plan = result.wiring
    return {
        "board": plan.board.name,
        "converter": plan.converter,
        "channels": [
            {
                "cord": c.cord,
                "resistor": c.resistor,
                "pin": c.pin,
                "module": c.module or None,
            }
            for c in plan.channels
        ],
        "connections": [[plan.describe(c.start), plan.describe(c.end)] for c in plan.connections],
        "notes": list(plan.notes),
        "files": [str(result.drawing), str(result.harness)],
    }
