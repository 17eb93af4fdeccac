"""Options of the functions of `workflow.board`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ...calibration.options import BoardOptions as BoardOptions
from ...core.errors import CalibrationError, CaptureError
from ...core.schema.options import check_options
from ...sensing.voltage_divider import Resistance


@dataclass(frozen=True)
class ReferenceOptions:
    """How the reference resistors of a read-out board are measured.

    Attributes:
        known: Set the known resistance in ohm.
        channels: Set the number of channels.
        seconds: Set the time to average over in s.

    Raises:
        CalibrationError: A value is not valid.
    """

    known: Resistance
    channels: Annotated[int, Meta(ge=1, le=16)] = 3
    seconds: Annotated[float, Meta(ge=0.1, le=3600)] = 2.0

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)


@dataclass(frozen=True)
class WiringOptions:
    """For which board a device's wiring is drawn.

    Attributes:
        board: Set the board instead of [readout] board in device.toml.
        converter: Set the converter instead of [readout] converter in device.toml.
        out: Set the folder for the files (default: wiring in the device's folder).

    Raises:
        DeviceError: A value is not valid.
    """

    board: Literal["nano", "uno", "esp32", "pico"] | None = None
    converter: Literal["arduino", "ads1115", "pico", "esp32"] | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True)
class CheckOptions:
    """How the wiring of a device is checked.

    Attributes:
        reference: Set the reference resistors of the channels in ohm, or one for all (default:
            those that the build proposes).
        wiggle: Move the wire of each cord in turn, which finds loose contacts.
        poses: Hold poses, if only they show which cord is connected to which pin.

    Raises:
        CaptureError: A value is not valid.
    """

    reference: tuple[Resistance, ...] | None = None
    wiggle: bool = True
    poses: bool = True

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class FlashOptions:
    """Which firmware is written to which board.

    Attributes:
        port: Set the serial port of the board (default: the only one that is plugged in).
        board: Choose the board (default: [readout] board of the device, or nano).
        converter: Choose what measures the cords: the board itself (arduino), or ADS1115 modules
            (default: [readout] converter of the device, or the board's own).
        yes: Replace another program on the board without asking.
        force: Write the firmware even if the board runs this version or a later one.

    Raises:
        CaptureError: A value is not valid.
    """

    port: str | None = None
    board: Literal["nano", "uno"] | None = None
    converter: Literal["arduino", "ads1115"] | None = None
    yes: bool = False
    force: bool = False

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class PairOptions:
    """How a board with Wi-Fi is paired.

    Attributes:
        port: Set the serial port of the board (default: the only one that is plugged in).
        name: Set the board's name in udp://NAME (default: its present name, or one of its id).
        key: Make a key, so that nobody on the network can forge readings and commands.
        timeout: Set the time to wait for the access point in s.

    Raises:
        CaptureError: A value is not valid.
    """

    port: str | None = None
    name: str | None = None
    key: bool = True
    timeout: Annotated[float, Meta(ge=1, le=600)] = 60.0

    def __post_init__(self) -> None:
        check_options(self, CaptureError)


@dataclass(frozen=True)
class MicroPythonOptions:
    """What the program for MicroPython reads.

    Attributes:
        converter: Choose what measures the cords: ADS1115 modules, or the converters of the
            microcontroller (internal).

    Raises:
        CaptureError: A value is not valid.
    """

    converter: Literal["ads1115", "internal"] = "ads1115"

    def __post_init__(self) -> None:
        check_options(self, CaptureError)
