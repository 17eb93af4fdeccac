"""Plan the wiring of a device: which terminals are connected, and by which resistors.

A cord and its reference resistor are a voltage divider. One end of the cord is connected to the
ground rail. The other end, the resistor and a pin meet in one junction, which is the terminal
`JUNCTION` of the resistor. Its other terminal is connected to the supply rail.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from ...core.device.boards import ADS1115, ADS1115_INPUTS, ADS1115_STRAPS, Board, find_board
from ...core.device.device import Device
from ...core.errors import DeviceError
from ...store.manifest import END_NAMES, Manifest
from ..pictures.sheet import COLORS

JUNCTION, SUPPLY, RAIL = "junction", "supply", "rail"
#: Pins of an ADS1115 that are connected to the board, and the address pin.
VDD, GND, SDA, SCL, ADDR = "VDD", "GND", "SDA", "SCL", "ADDR"
#: Colors of bands on resistors for the digits from 0 to 9, with their "#rrggbb".
BANDS = {
    "black": "#000000",
    "brown": "#7b3f00",
    "red": "#d40000",
    "orange": "#ff8000",
    "yellow": "#ffe000",
    "green": "#008000",
    "blue": "#0040d0",
    "violet": "#8000c0",
    "gray": "#808080",
    "white": "#ffffff",
    "gold": "#c9a227",
    "silver": "#b8b8b8",
}
_DIGITS = tuple(BANDS)[:10]
_MULTIPLIERS = {-1: "gold", -2: "silver"} | dict(enumerate(_DIGITS))
_TOLERANCE = "brown"  # 1 %
_MAX_SOURCE_OHM = 10_000.0  # that a microcontroller's converter reads without a capacitor


class PartKind(StrEnum):
    """Kind of a part in the wiring."""

    BOARD = "board"
    MODULE = "ADS1115"
    CORD = "cord"
    RESISTOR = "resistor"
    GROUND = "ground rail"
    SUPPLY = "supply rail"


class Wire(StrEnum):
    """Purpose of a connection."""

    CORD = "cord"
    SIGNAL = "signal"
    SUPPLY = "supply"
    GROUND = "ground"
    I2C = "I2C"
    ADDRESS = "address"


class Terminal(NamedTuple):
    """A terminal of a part.

    Attributes:
        kind: Kind of the part.
        number: Number of the part among those of its kind, from 1.
        pin: Name of the terminal.
    """

    kind: PartKind
    number: int
    pin: str


class Connection(NamedTuple):
    """A wire between two terminals.

    Attributes:
        start: One terminal.
        end: The other terminal.
        wire: Purpose of the connection.
    """

    start: Terminal
    end: Terminal
    wire: Wire


@dataclass(frozen=True)
class Channel:
    """A cord and its voltage divider.

    Attributes:
        cord: Name of the cord or trace.
        color: Its color in pictures, "#rrggbb".
        rest: Resistance at rest, ohm.
        highest: Highest resistance in use, ohm.
        resistor: Reference resistor, ohm.
        module: Number of the ADS1115 that reads it, from 1; 0 for the board itself.
        pin: Pin of the module or board.
    """

    cord: str
    color: str
    rest: float
    highest: float
    resistor: float
    module: int
    pin: str


@dataclass(frozen=True)
class Wiring:
    """The wiring of a device.

    Attributes:
        device: Name of the device.
        noun: What one sensor is called: "cord" or "trace".
        board: The board.
        converter: Name of the converter.
        channels: The channels in their order.
    """

    device: str
    noun: str
    board: Board
    converter: str
    channels: tuple[Channel, ...]

    @property
    def module_count(self) -> int:
        """Number of ADS1115."""
        return max(c.module for c in self.channels)

    @property
    def supply_pin(self) -> str:
        """Pin of the board that supplies the dividers."""
        return self.board.supply_3v3 if self.module_count else self.board.supply

    @property
    def supply_volt(self) -> float:
        """Voltage of the dividers, V."""
        return 3.3 if self.module_count else self.board.supply_volt

    @property
    def connections(self) -> tuple[Connection, ...]:
        """All connections."""
        return tuple(self._list_connections())

    def _list_connections(self) -> Iterator[Connection]:
        ground = Terminal(PartKind.GROUND, 1, RAIL)
        supply = Terminal(PartKind.SUPPLY, 1, RAIL)
        for number, channel in enumerate(self.channels, start=1):
            to_ground, to_junction = (Terminal(PartKind.CORD, number, end) for end in END_NAMES)
            junction = Terminal(PartKind.RESISTOR, number, JUNCTION)
            yield Connection(to_ground, ground, Wire.CORD)
            yield Connection(to_junction, junction, Wire.CORD)
            yield Connection(junction._replace(pin=SUPPLY), supply, Wire.SUPPLY)
            yield Connection(junction, self.input_of(channel), Wire.SIGNAL)
        yield Connection(supply, self._board(self.supply_pin), Wire.SUPPLY)
        yield Connection(ground, self._board(self.board.ground), Wire.GROUND)
        for number in range(1, self.module_count + 1):
            module = Terminal(PartKind.MODULE, number, VDD)
            yield Connection(module, self._board(self.board.converter_supply), Wire.SUPPLY)
            yield Connection(module._replace(pin=GND), self._board(self.board.ground), Wire.GROUND)
            yield Connection(module._replace(pin=SCL), self._board(self.board.scl), Wire.I2C)
            yield Connection(module._replace(pin=SDA), self._board(self.board.sda), Wire.I2C)
            strap = module._replace(pin=ADS1115_STRAPS[number - 1][0])
            yield Connection(module._replace(pin=ADDR), strap, Wire.ADDRESS)

    def input_of(self, channel: Channel) -> Terminal:
        """Return the pin that reads a channel."""
        if channel.module:
            return Terminal(PartKind.MODULE, channel.module, channel.pin)
        return self._board(channel.pin)

    def _board(self, pin: str) -> Terminal:
        return Terminal(PartKind.BOARD, 1, pin)

    def describe(self, terminal: Terminal) -> str:
        """Describe a terminal, as in "Arduino Nano, A0"."""
        if terminal.pin == RAIL:
            return terminal.kind.value
        if terminal.kind is PartKind.BOARD:
            return f"{self.board.title}, {terminal.pin}"
        return f"{terminal.kind.value} {terminal.number}, {terminal.pin}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know about the wiring, as sentences."""
        notes = [
            f"The {END_NAMES[0]} and the {END_NAMES[1]} of a {self.noun} may be exchanged.",
        ]
        if self.module_count:
            notes.append(
                "ADDR sets the address of an ADS1115, which differs for each. The dividers are on"
                " 3.3 V, as the inputs measure up to 4.096 V. This voltage is not the reference of"
                " the converters: if it sags, all channels show it."
            )
            return tuple(notes)
        notes.append(
            f"Supply the dividers from {self.supply_pin}, not from another source."
            f" {self.board.note}"
        )
        slow = [
            c.cord
            for c in self.channels
            if c.highest * c.resistor / (c.highest + c.resistor) > _MAX_SOURCE_OHM
        ]
        if slow:
            notes.append(
                "These have more than 10 kohm in parallel with the resistor, and need 100 nF from"
                f" the pin to ground: {', '.join(slow)}."
            )
        return tuple(notes)


def plan_wiring(
    device: Device, manifest: Manifest, board: str | None = None, converter: str | None = None
) -> Wiring:
    """Plan the wiring of a built device.

    Args:
        device: The device.
        manifest: The manifest of its parts, with the resistors.
        board: Name of another board; None for the device's.
        converter: Name of another converter; None for the device's, or for the board's own if the
            board does not have that one.

    Raises:
        DeviceError: The board has another converter (`converter-not-on-board`), or too few
            channels (`too-many-cords`), or the device has no cords (`no-cords`).
    """
    used_board = find_board(board or device.board)
    if converter is None:
        has_converter = used_board.channel_count(device.converter) > 0
        converter = device.converter if has_converter else used_board.converter
    if not manifest.cords:
        raise DeviceError(
            "has no cords, so there is nothing to connect",
            code="no-cords",
            where=device.name,
            action="Draw [[sensors]] in device.toml, or give [design] sensors = 3",
        )
    used_board.check_channels(len(manifest.cords), converter)
    channels = []
    for index, cord in enumerate(manifest.cords):
        if converter == ADS1115:
            module, pin = index // ADS1115_INPUTS + 1, f"A{index % ADS1115_INPUTS}"
        else:
            module, pin = 0, used_board.pins[index]
        channels.append(
            Channel(
                cord.sensor,
                COLORS[index % len(COLORS)],
                cord.resistance,
                cord.range[1],
                cord.reference_resistor,
                module,
                pin,
            )
        )
    return Wiring(device.name, device.cord.noun, used_board, converter, tuple(channels))


def color_code(ohm: float) -> tuple[str, ...]:
    """Return the colors of the five bands of a resistor of 1 % (IEC 60062), keys of `BANDS`.

    Args:
        ohm: Its resistance, from 1 ohm to 100 Gohm, with up to three digits other than zero.
    """
    digits, exponent = f"{ohm:.2e}".split("e")
    bands = [_DIGITS[int(d)] for d in digits if d != "."]
    return (*bands, _MULTIPLIERS[int(exponent) - 2], _TOLERANCE)
