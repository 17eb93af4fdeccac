"""The commands `defsense board ports | reference`: what a read-out board reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from msgspec import Meta

from ...core.schema.options import check_options
from ...workflow.board.options import BoardOptions, ReferenceOptions
from ..app import command
from ..output import (
    OutputOptions,
    console,
    print_error_line,
    print_json,
    print_lines,
    standard_output,
)

if TYPE_CHECKING:
    from ...core.arrays import Float
    from ...workflow.board.readout import PortReading

_PORTS = (
    "/dev/ttyUSB0, COM3, socket://host:port, udp://HOST or tcp://HOST (Wi-Fi; HOST may be the name"
    " of a paired board), or twin"
)
Port = Annotated[str, Parameter(help=f"Set the port of the read-out board: {_PORTS}")]


@dataclass(frozen=True)
class PortsOptions:
    """Which ports are shown, and for how long.

    Attributes:
        port: Show the board on this port (COM3, udp://HOST), or a recording (.csv), until Ctrl-C.
        list: List the ports without opening them.
        seconds: Stop after this time in s (default: at Ctrl-C).
    """

    port: str | None = None
    list: bool = False
    seconds: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None

    def __post_init__(self) -> None:
        check_options(self)


_ALL_PORTS, _BOARD = PortsOptions(), BoardOptions()
_OUTPUT = OutputOptions()

ports = command("ports", "defsense board ports", "defsense board ports --port twin")
reference = command("reference", "defsense board reference --port /dev/ttyUSB0 --known 2200")


@ports.default
def _ports(
    *,
    options: Annotated[PortsOptions, Parameter(name="*")] = _ALL_PORTS,
    board: Annotated[BoardOptions, Parameter(name="*")] = _BOARD,
    output: OutputOptions = _OUTPUT,
) -> None:
    """List serial ports and show what a read-out board reads.

    Shows the resistances that the read-out boards on the ports read, as bars. Read-out boards
    restart when their port is opened; --list opens none.
    """
    from ...workflow.board.readout import list_ports

    if options.port is None:
        readings = list_ports(board, is_read=not options.list)
        with standard_output():
            _print_ports(readings, output)
    else:
        with suppress(KeyboardInterrupt), standard_output():
            _watch(options.port, board, options.seconds, output)


def _print_ports(readings: Sequence[PortReading], output: OutputOptions) -> None:
    if output.json:
        print_json([_port_data(p) for p in readings])
        return
    for p in readings:
        print_lines([f"{p.device:<16} {p.description}", *([f"  {p.problem}"] if p.problem else [])])
        if p.ohm is not None:
            console().print(_bars(p.ohm))
        if p.update:
            offer = f"defsense board flash --port {p.device}"
            print_lines([f"  Firmware {p.update} is available (installed: {p.firmware}): {offer}"])
    if readings:
        shown = next((p for p in readings if p.ohm is not None), readings[0])
        next_step = f"defsense board ports --port {shown.device}"
    else:
        print_lines(["No serial port was found."])
        next_step = "connect the read-out board, or try defsense board ports --port twin"
    print_lines([f"Next:    {next_step}"])


def _port_data(port: PortReading) -> dict[str, Any]:
    data: dict[str, Any] = {"device": port.device, "description": port.description}
    if port.ohm is not None:
        data["ohm"] = _finite(port.ohm)
    if port.problem:
        data["problem"] = port.problem
    if port.firmware:
        data["firmware"] = port.firmware
    if port.update:
        data["update"] = port.update
    return data


def _watch(port: str, board: BoardOptions, seconds: float | None, output: OutputOptions) -> None:
    """Show readings until the time is over or the source ends."""
    from rich.console import Console
    from rich.live import Live

    from ...workflow.board.readout import watch_board

    warn_of_port(port)
    screen = Console(stderr=output.json)
    with Live(console=screen, auto_refresh=False, transient=output.json) as live:
        for reading in watch_board(port, board, seconds):
            live.update(_bars(reading.ohm), refresh=not output.json)
    s = reading.statistics
    if output.json:
        print_json({"ohm": _finite(reading.ohm), **s.data()})
    else:
        network = [] if s.network is None else [s.network.summary]
        counts = f"{s.samples} samples, {s.lost} lost, {s.bad} damaged frames"
        print_lines(["", counts, *network])


def warn_of_port(port: str) -> None:
    """Print what reading a port risks, on standard error."""
    from ...workflow.board.readout import port_warning

    if warning := port_warning(port):
        print_error_line(f"warning: {warning}")


def _bars(ohm: Float) -> Any:
    from ...core.guided_parts import resistance_bars
    from ..terminal.guided_screen import bar_table

    return bar_table(resistance_bars({f"channel {n}": float(r) for n, r in enumerate(ohm, 1)}))


def _finite(ohm: Float) -> list[float | None]:
    """Return resistances for JSON: None for an open circuit, or an unknown resistance."""
    return [float(r) if math.isfinite(r) else None for r in ohm]


@reference.default
def _reference(
    *,
    port: Port,
    options: Annotated[ReferenceOptions, Parameter(name="*")],
    output: OutputOptions = _OUTPUT,
) -> None:
    """Measure the reference resistors with a known resistor.

    Replace every cord by one known resistor (1 percent or better, near the cords' resistance), and
    pass the printed numbers as --reference. The response does not depend on them; resistances in
    ohm do.

    Args:
        port: Set the port of the read-out board.
    """
    from ...workflow.board.readout import measure_reference_resistors

    warn_of_port(port)
    resistors = measure_reference_resistors(port, options)
    with standard_output():
        if output.json:
            print_json({"reference": resistors})
        else:
            values = ",".join(f"{r:.1f}" for r in resistors)
            print_lines([f"Next:    defsense calibrate record ... --reference {values}"])
