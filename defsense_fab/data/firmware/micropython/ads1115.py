"""One to four ADS1115 converters on an I2C bus (16 bits, single shot, gain 1, 860 a second)."""

from frames import NOT_READ

FIRST_ADDRESS = 0x48
MAX_CHIPS = 4
INPUTS = 4

_CONVERSION_REGISTER, _CONFIG_REGISTER = 0, 1
# Start one conversion: single ended, +-4.096 V, single shot, 860 a second, no comparator.
_START_HIGH, _START_LOW = 0xC3, 0xE3
_READY = 0x80  # of the high byte of the config register
_MIN_CONVERSION_US, _MAX_CONVERSION_US = 1000, 3000


class Ads1115:
    """The channels of the ADS1115 that answer at the addresses 0x48 to 0x4B.

    The inputs A0 to A3 of the chips are channels 0 to 15 in the order of the addresses.

    Args:
        i2c: Bus with the methods `writeto` and `readfrom_into` of `machine.I2C`.
        clock: The board's clock.
        supply_mv: Supply voltage of the dividers, mV.
    """

    code = 1
    name = "ads1115"
    averages = 1
    missing = "no ADS1115 answers at 0x48 to 0x4B, check the wiring"

    def __init__(self, i2c, clock, supply_mv=3300):
        self.full_scale = supply_mv * 32768 // 4096
        self._i2c = i2c
        self._clock = clock
        self._chips = []
        self._is_silent = [False] * MAX_CHIPS
        self._started_at = [0] * MAX_CHIPS
        self._config = bytearray((_CONFIG_REGISTER, 0, _START_LOW))
        self._pointer = bytes((_CONVERSION_REGISTER,))
        self._word = bytearray(2)

    def find_channels(self):
        """Look for chips; return the number of channels."""
        self._chips = [
            address
            for address in range(FIRST_ADDRESS, FIRST_ADDRESS + MAX_CHIPS)
            if self._write(address, self._pointer)
        ]
        return len(self._chips) * INPUTS

    def read(self, sums, channels, averages, service):
        """Add conversions of the first channels to `sums`, which are 0, or put NOT_READ there.

        Chips convert at the same time. A chip that does not answer is not asked again in this
        sample.

        Args:
            sums: One number per channel.
            channels: Number of channels.
            averages: Number of conversions of each channel.
            service: Called while the chips convert.
        """
        for chip in range(MAX_CHIPS):
            self._is_silent[chip] = False
        for source in range(INPUTS):
            for _ in range(averages):
                self._convert(sums, channels, source, service)

    def _convert(self, sums, channels, source, service):
        """Start the same input on all chips, and then collect the results."""
        chips = (channels - source + INPUTS - 1) // INPUTS
        self._config[1] = _START_HIGH | source << 4
        for chip in range(chips):
            self._started_at[chip] = self._clock.ticks_us()
            if not self._is_silent[chip] and not self._write(self._chips[chip], self._config):
                self._is_silent[chip] = True
        for chip in range(chips):
            channel = chip * INPUTS + source
            value = -1 if self._is_silent[chip] else self._collect(chip, service)
            if value < 0:
                self._is_silent[chip] = True
                sums[channel] = NOT_READ
            else:
                sums[channel] += value

    def _collect(self, chip, service):
        """Wait for a conversion; return its result, 0 or above, or -1 if there is none."""
        address, started_at = self._chips[chip], self._started_at[chip]
        clock, word = self._clock, self._word
        while clock.ticks_diff(clock.ticks_us(), started_at) < _MIN_CONVERSION_US:
            service()
        while True:  # the chip is still at its config register
            is_overdue = clock.ticks_diff(clock.ticks_us(), started_at) > _MAX_CONVERSION_US
            if not self._read_word(address):
                return -1
            if word[0] & _READY:
                break
            if is_overdue:
                return -1
            service()
        if not self._write(address, self._pointer) or not self._read_word(address):
            return -1
        # Noise at 0 V may be below it.
        return 0 if word[0] & 0x80 else word[0] << 8 | word[1]

    def _write(self, address, data):
        """Write to a chip; return whether it answered."""
        try:
            self._i2c.writeto(address, data)
        except OSError:
            return False
        return True

    def _read_word(self, address):
        """Read a register of a chip; return whether it answered."""
        try:
            self._i2c.readfrom_into(address, self._word)
        except OSError:
            return False
        return True
