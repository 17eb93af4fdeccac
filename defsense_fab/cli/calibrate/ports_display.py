"""Command `defsense calibrate ports`: list serial ports and show what read-out boards read."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...core.errors import CaptureError
from ..options import (
    REFERENCE_OHM,
    check_range,
    parse_references,
)
from ..output import print_json

if TYPE_CHECKING:
    from ...capture.readout.ports import Port
    from ...capture.readout.source import Source
    from ...core.arrays import Float
    from ...sensing.serial_frames import Info


def run_ports(options: argparse.Namespace) -> int:
    """Run the command; return the exit code."""
    from ...capture.readout.ports import serial_ports
    from ...capture.readout.reader import ReadoutSettings
    from ...twin.live.sample_sources import open_source

    if options.seconds is not None:
        check_range("--seconds", options.seconds, 0.1, 1e6)
    if options.port is None:
        return _list_ports(options, serial_ports())
    source = open_source(
        options.port, ReadoutSettings(rate=options.rate, average=options.average)
    ).source
    info = source.start()
    try:
        return _show_readings(options, source, info)
    except KeyboardInterrupt:
        return 0
    finally:
        source.close()


def _list_ports(options: argparse.Namespace, ports: Sequence[Port]) -> int:
    """List every port, with one reading of the read-out board on it."""
    readings = [{} if options.list else _read_port(options, p.device) for p in ports]
    if options.json:
        rows = [vars(p) | reading for p, reading in zip(ports, readings, strict=True)]
        print_json(rows)
        return 0
    if not ports:
        sys.stdout.write(
            "No serial port was found.\n"
            "Next:    connect the read-out board, or try defsense calibrate ports --port twin\n"
        )
        return 0
    from rich.console import Console

    from ..terminal.guided_measurement import bars

    console = Console()
    for p, reading in zip(ports, readings, strict=True):
        console.print(f"{p.device:<16} {p.description}", highlight=False, markup=False)
        if "ohm" in reading:
            nan = float("nan")
            values = {f"  channel {i + 1}": nan if r is None else r
                      for i, r in enumerate(reading["ohm"])}  # fmt: skip
            console.print(bars(values))
        elif reading:
            console.print(f"  {reading['problem']}", highlight=False, markup=False, soft_wrap=True)
    best = next(
        (p.device for p, reading in zip(ports, readings, strict=True) if "ohm" in reading), None
    )
    console.print(f"Next:    defsense calibrate ports --port {best or ports[0].device}",
                  highlight=False)  # fmt: skip
    return 0


def _read_port(options: argparse.Namespace, port: str) -> dict[str, Any]:
    """Return the resistances of the board on a port, or the problem."""
    import numpy as np

    from ...capture.readout.reader import ReadoutSettings
    from ...sensing.voltage_divider import Dividers
    from ...twin.live.sample_sources import open_source

    source = open_source(port, ReadoutSettings()).source
    try:
        info = source.start()
        time.sleep(0.5)
        latest = source.read_latest(2.0)
    except CaptureError as error:
        return {"problem": str(error).removeprefix(f"{port}: ")}
    finally:
        source.close()
    reference = np.array(parse_references(options.reference or f"{REFERENCE_OHM:g}", info.channels))
    ohm = Dividers(reference, float(info.full_scale)).resistance(latest.sample.counts)
    return {"ohm": [float(r) if np.isfinite(r) else None for r in ohm]}


def _show_readings(options: argparse.Namespace, source: Source, info: Info) -> int:
    """Show readings until the time is over or the source ends."""
    import numpy as np
    from rich.console import Console
    from rich.live import Live

    from ...capture.readout.source import StampedSample
    from ...sensing.voltage_divider import Dividers
    from ..terminal.guided_measurement import bars

    dividers = Dividers(
        np.array(parse_references(options.reference or f"{REFERENCE_OHM:g}", info.channels)),
        float(info.full_scale),
    )
    end = time.monotonic() + (options.seconds or float("inf"))
    ohm: Float | None = None
    console = Console(stderr=options.json)
    with Live(console=console, auto_refresh=False, transient=options.json) as live:
        while time.monotonic() < end:
            time.sleep(0.1)
            try:
                items = [i for i in source.drain() if isinstance(i, StampedSample)]
            except CaptureError:
                break
            if items:
                ohm = dividers.resistance(items[-1].sample.counts)
                named = {f"channel {i + 1}": float(r) for i, r in enumerate(ohm)}
                live.update(bars(named), refresh=not options.json)
    s = source.statistics
    if ohm is None:
        raise CaptureError(
            "no sample arrived",
            code="no-samples",
            where=source.name,
            action="Check the read-out board and its cable",
        )
    if options.json:
        values = [float(r) if np.isfinite(r) else None for r in ohm]
        print_json({"ohm": values, **vars(s)})
    else:
        sys.stdout.write(f"\n{s.samples} samples, {s.lost} lost, {s.bad} damaged frames\n")
    return 0
