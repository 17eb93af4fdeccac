"""Write the firmware to an Arduino, and check that it runs."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...capture.boards.images import FirmwareImage, find_image
from ...capture.boards.stk500 import BootLoader, write_flash
from ...capture.readout.network_url import is_network_url
from ...capture.readout.ports import find_only_port, open_port
from ...capture.readout.reader import Reader
from ...core.device.boards import ADS1115, find_board
from ...core.device.device_file import load_device
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ...sensing.serial_frames import FIRMWARE_VERSION, Info, format_version
from .options import FlashOptions

_DEFAULT_BOARD = "nano"
_DEFAULT_OPTIONS = FlashOptions()
#: Codes of errors of ports on which another program runs, or none.
_OTHER_PROGRAM = {"board-silent", "board-firmware-unknown"}


@dataclass(frozen=True)
class FlashResult:
    """The firmware on a board after `flash_board`.

    Attributes:
        port: Port of the board.
        file: File of the firmware's image.
        version: Version that the board reports.
        previous: Version that it reported before; empty for another program, or if it was not
            read.
        boot_loader: The boot loader that wrote the firmware; None if it was not written, because
            the board runs this version or a later one.
        channels: Number of channels that can be read; 0 if no ADS1115 is connected.
    """

    port: str
    file: str
    version: str
    previous: str
    boot_loader: BootLoader | None
    channels: int


def flash_board(
    device: Path | None = None,
    options: FlashOptions = _DEFAULT_OPTIONS,
    *,
    progress: Progress = silent,
) -> FlashResult:
    """Write the firmware to an Arduino Nano or Uno, and check that the board runs it.

    Args:
        device: Folder of the device, which selects board and converter; None for no device.
        options: Port, board and converter.
        progress: Called during the stages `read`, `connect`, `write`, `verify` and `start`.

    Raises:
        DeviceError: The device cannot be read.
        CaptureError: No port, or several ports are plugged in (`board-not-found`,
            `port-ambiguous`), the port is a network connection (`port-not-serial`) or cannot be
            opened (`port-busy`, `port-forbidden`, ...),
            the board runs another program and the option `yes` is not set
            (`replacement-not-confirmed`), the firmware could not be written (see `write_flash`), or
            does not run afterwards (`firmware-not-running`).
    """
    image = _choose_image(device, options)
    data = image.read()
    port = options.port or find_only_port()
    if is_network_url(port):
        raise CaptureError(
            "the firmware cannot be written over a network",
            code="port-not-serial",
            where=port,
            action="Connect the board by USB, and use its serial port",
            port=port,
        )
    installed = None
    if not (options.yes and options.force):  # otherwise it is written in any case
        progress("read", 0, "reading the installed version")
        installed = _read_info(port)
        progress("read", 1, "done")
    if installed is not None and image.runs_on(installed) and not options.force:
        return _result(port, image, installed, installed, None)
    if installed is None and not options.yes:
        raise CaptureError(
            "the board runs another program, or none, which would be replaced",
            code="replacement-not-confirmed",
            where=port,
            action="Set yes to replace it, or choose another port",
            port=port,
        )
    with closing(open_port(port)) as opened:
        boot_loader = write_flash(opened, data, port, progress)  # type: ignore[arg-type]
    progress("start", 0, "waiting for the firmware")
    running = _read_info(port)
    if running is None or running.version != FIRMWARE_VERSION or not image.runs_on(running):
        raise _not_running(port, running)
    progress("start", 1, "done")
    return _result(port, image, running, installed, boot_loader)


def _choose_image(folder: Path | None, options: FlashOptions) -> FirmwareImage:
    """Return the firmware for the options; what they leave open is that of the device."""
    device = None if folder is None else load_device(folder, complete=False)
    board = options.board or (_DEFAULT_BOARD if device is None else device.board)
    has_modules = device is not None and device.converter == ADS1115
    own = ADS1115 if has_modules else find_board(board).converter
    return find_image(board, options.converter or own)


def _read_info(port: str) -> Info | None:
    """Return the description that a board gives of itself; None if it does not run the firmware."""
    reader = Reader(partial(open_port, port), port)
    with closing(reader):
        try:
            reader.start()
        except CaptureError as error:
            if reader.info is None and error.code not in _OTHER_PROGRAM:
                raise
    return reader.info


def _result(
    port: str,
    image: FirmwareImage,
    running: Info,
    installed: Info | None,
    boot_loader: BootLoader | None,
) -> FlashResult:
    version = format_version(running.version)
    previous = "" if installed is None else format_version(installed.version)
    return FlashResult(port, image.file, version, previous, boot_loader, running.most_channels)


def _not_running(port: str, running: Info | None) -> CaptureError:
    state = "does not answer" if running is None else f"reports {format_version(running.version)}"
    return CaptureError(
        f"the firmware {format_version(FIRMWARE_VERSION)} was written, but the board {state}",
        code="firmware-not-running",
        where=port,
        action="Unplug the board, plug it in and run defsense board ports",
        port=port,
    )
