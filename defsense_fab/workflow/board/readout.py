"""Serial ports, the readings of the boards on them, and the boards' reference resistors."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ...capture.readout.network_url import FORGERY_WARNING, is_forgeable
from ...capture.readout.ports import serial_ports
from ...capture.readout.reader import ReadoutSettings
from ...capture.readout.source import ReadoutStatistics, Source, StampedSample
from ...core.arrays import Float
from ...core.errors import CaptureError
from ...sensing.serial_frames import FIRMWARE_VERSION, Info, format_version
from ...sensing.voltage_divider import Dividers, measure_reference, reference_resistors
from ...twin.live.sample_sources import open_source
from .options import BoardOptions, ReferenceOptions

_GREETING_S = 0.5  # until the first samples of a board have arrived
_MAX_AGE_S = 2.0
_POLL_INTERVAL_S = 0.1
_DEFAULT_BOARD = BoardOptions()


@dataclass(frozen=True)
class PortReading:
    """A serial port, and what the read-out board on it reads.

    Attributes:
        device: Name by which the port is opened, such as `/dev/ttyUSB0`.
        description: Description that the port gives of itself; empty if none.
        ohm: Resistances (c,), ohm; None if the port was not opened or has no board.
        problem: Why no board could be read; empty if one was, or if the port was not opened.
        firmware: Version of the board's firmware; empty if no board could be read.
        update: Version of the firmware to update to; empty if the board's is not older.
    """

    device: str
    description: str
    ohm: Float | None = None
    problem: str = ""
    firmware: str = ""
    update: str = ""


@dataclass(frozen=True)
class BoardReading:
    """One reading of a read-out board.

    Attributes:
        ohm: Resistances (c,), ohm: 0 for a short circuit, inf for an open one, NaN if unknown.
        statistics: Counts of received and lost samples so far.
    """

    ohm: Float
    statistics: ReadoutStatistics


def list_ports(board: BoardOptions = _DEFAULT_BOARD, *, is_read: bool = True) -> list[PortReading]:
    """List the serial ports, with one reading of the read-out board on each.

    Args:
        board: How boards measure; only the reference resistors are used.
        is_read: Whether ports are opened, which restarts the boards on them.

    Raises:
        CaptureError: The reference resistors are neither one nor one per channel.
    """
    return [
        _read_port(p.device, p.description, board)
        if is_read
        else PortReading(p.device, p.description)
        for p in serial_ports()
    ]


def watch_board(
    port: str, board: BoardOptions = _DEFAULT_BOARD, seconds: float | None = None
) -> Iterator[BoardReading]:
    """Yield the newest reading of a read-out board about ten times per second.

    Args:
        port: Port of the board, the .csv file of a recording, or `twin`.
        board: How the board measures.
        seconds: Time after which it ends, s, after the answer of the board, or after the
            first sample if that is later; None for the end of the source.

    Raises:
        CaptureError: The port cannot be read, or no sample arrives (`no-samples`).
    """
    settings = ReadoutSettings(rate=board.rate, average=board.average)
    is_empty = True
    with _start(port, settings) as (source, info):
        dividers = _dividers(board, info)
        end = time.monotonic() + (np.inf if seconds is None else seconds)
        while time.monotonic() < (end + _MAX_AGE_S if is_empty else end):
            time.sleep(_POLL_INTERVAL_S)
            try:
                samples = _drain_samples(source)
            except CaptureError:  # the recording has ended, or the board is gone
                break
            if samples:
                is_empty = False
                ohm = dividers.resistance(samples[-1].sample.counts)
                yield BoardReading(ohm, source.statistics)
        if is_empty:
            raise _no_samples(source)


def port_warning(port: str) -> str:
    """Return what reading a port risks; empty for ports without a risk."""
    return f"{port}: {FORGERY_WARNING}" if is_forgeable(port) else ""


def measure_reference_resistors(port: str, options: ReferenceOptions) -> list[float]:
    """Measure the reference resistors with one known resistor in place of every cord.

    Args:
        port: Port of the read-out board, or `twin`.
        options: The known resistor.

    Returns:
        The reference resistors (c,), ohm.

    Raises:
        CaptureError: The port cannot be read, no sample arrives (`no-samples`), or a channel is
            open or shorted (`channels-unreadable`).
    """
    with _start(port, ReadoutSettings(channels=options.channels)) as (source, info):
        time.sleep(options.seconds)
        counts = [item.sample.counts for item in _drain_samples(source)]
        if not counts:
            raise _no_samples(source)
    mean = np.mean(counts, axis=0)
    resistors: list[float] = measure_reference(mean, options.known, float(info.full_scale)).tolist()
    return resistors


@contextmanager
def _start(port: str, settings: ReadoutSettings) -> Iterator[tuple[Source, Info]]:
    """Start a source, and close it at the end."""
    source = open_source(port, settings).source
    try:
        yield source, source.start()
    finally:
        source.close()


def _read_port(port: str, description: str, board: BoardOptions) -> PortReading:
    try:
        with _start(port, ReadoutSettings()) as (source, info):
            time.sleep(_GREETING_S)
            latest = source.read_latest(_MAX_AGE_S)
    except CaptureError as error:
        return PortReading(port, description, problem=str(error).removeprefix(f"{port}: "))
    ohm = _dividers(board, info).resistance(latest.sample.counts)
    update = format_version(FIRMWARE_VERSION) if info.is_outdated else ""
    return PortReading(port, description, ohm, firmware=format_version(info.version), update=update)


def _dividers(board: BoardOptions, info: Info) -> Dividers:
    resistors = reference_resistors(board.reference, info.channels)
    return Dividers(np.array(resistors), float(info.full_scale))


def _drain_samples(source: Source) -> list[StampedSample]:
    return [item for item in source.drain() if isinstance(item, StampedSample)]


def _no_samples(source: Source) -> CaptureError:
    return CaptureError(
        "no sample arrived",
        code="no-samples",
        where=source.name,
        action="Check the read-out board and its cable",
    )
