"""Boards with microcontrollers that read the cords: the table `data/boards.csv`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from ..errors import DeviceError
from ..storage.package_data import read_rows

FILE = "boards.csv"
#: Converters that read the resistances: full scale of a conversion (counts) and conversions per
#: sample. ADS1115 is a module on I2C, the others belong to microcontrollers: 10 bits (ATmega328P
#: datasheet), 12 bits (RP2040 datasheet) and, of ESP32, conversions calibrated to mV, 3300 at the
#: supply of 3.3 V. Dividers on ADS1115 use 3.3 V of its range of 4.096 V. Steps are noise, errors
#: of linearity are not (ESP32 datasheet: 60 mV).
CONVERTERS = {
    "arduino": (1023, 16),
    "ads1115": (26400, 1),
    "pico": (4096, 16),
    "esp32": (3300, 16),
}
#: Converter on modules of its own, which any board reads by I2C.
ADS1115 = "ads1115"
#: Analog inputs of one ADS1115.
ADS1115_INPUTS = 4
#: Pin of the module to which ADDR of each ADS1115 is connected, and the address on I2C that results
#: (Texas Instruments, ADS111x datasheet SBAS444, table "ADDR pin connection").
ADS1115_STRAPS = (("GND", 0x48), ("VDD", 0x49), ("SDA", 0x4A), ("SCL", 0x4B))


@dataclass(frozen=True)
class Board:
    """A board with a microcontroller; pins are named as in its pinout.

    Attributes:
        name: Value of `[readout] board`.
        title: Name of the product.
        converter: Name of its own converter, a key of `CONVERTERS`.
        pins: Analog pins in the order of the channels.
        supply: Pin that supplies dividers on its own converter.
        supply_volt: Voltage of this pin, V.
        ground: Ground pin.
        supply_3v3: Pin of 3.3 V, which supplies dividers on ADS1115.
        converter_supply: Pin that supplies ADS1115, whose I2C lines have this voltage.
        sda: Data pin of I2C.
        scl: Clock pin of I2C.
        note: What to know about its own converter, as a sentence.
        source: Where the pins come from.
    """

    name: str
    title: str
    converter: str
    pins: tuple[str, ...]
    supply: str
    supply_volt: float
    ground: str
    supply_3v3: str
    converter_supply: str
    sda: str
    scl: str
    note: str
    source: str

    def channel_count(self, converter: str) -> int:
        """Return how many cords the board reads with a converter; 0 if it does not have it."""
        if converter == ADS1115:
            return ADS1115_INPUTS * len(ADS1115_STRAPS)
        return len(self.pins) if converter == self.converter else 0

    def check_converter(self, converter: str) -> None:
        """Check that the board can use a converter.

        Raises:
            DeviceError: It has another converter (`converter-not-on-board`).
        """
        if not self.channel_count(converter):
            raise DeviceError(
                f"{self.title} has no converter {converter!r}",
                code="converter-not-on-board",
                where="converter",
                action=f"Use {self.converter!r} or {ADS1115!r}",
                board=self.name,
                converter=converter,
            )

    def check_channels(self, cords: int, converter: str) -> None:
        """Check that the board can read a number of cords with a converter.

        Raises:
            DeviceError: It has another converter (`converter-not-on-board`), or too few channels
                (`too-many-cords`).
        """
        self.check_converter(converter)
        channels = self.channel_count(converter)
        if cords > channels:
            with_modules = self.channel_count(ADS1115)
            raise DeviceError(
                f"{cords} cords need {cords} channels, and {self.title} has {channels} with"
                f" converter {converter!r}",
                code="too-many-cords",
                where="[readout]",
                action=f"Use converter {ADS1115!r}, with up to {with_modules} channels"
                if cords <= with_modules
                else f"Use at most {with_modules} cords",
                cords=cords,
                channels=channels,
            )


@cache
def find_board(name: str) -> Board:
    """Return a board.

    Args:
        name: Its name in `data/boards.csv`.
    """
    row = read_rows(FILE)[name]
    values = {
        **row,
        "pins": tuple(row["pins"].split("|")),
        "supply_volt": float(row["supply_volt"]),
    }
    return Board(**values)  # type: ignore[arg-type]
