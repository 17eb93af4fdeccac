"""The microcontroller's own converters."""

#: Microvolts of a count of the ESP32: 3.3 V are 26400 counts, as with an ADS1115.
ESP32_COUNT_UV = 125


class InternalAdc:
    """Channels on the analog inputs of the microcontroller.

    Args:
        readers: For each channel a function that returns the counts of one conversion.
        full_scale: Counts at the dividers' supply voltage.
    """

    code = 0
    name = "divider"
    averages = 16
    missing = "no analog input is configured, edit config.py"

    def __init__(self, readers, full_scale):
        self.full_scale = full_scale
        self._readers = readers

    def find_channels(self):
        """Return the number of channels."""
        return len(self._readers)

    def read(self, sums, channels, averages, service):
        """Add conversions of the first channels to `sums`, which are 0.

        Args:
            sums: One number per channel.
            channels: Number of channels.
            averages: Number of conversions of each channel.
            service: Called between conversions.
        """
        for channel in range(channels):
            reader = self._readers[channel]
            total = 0
            for _ in range(averages):
                total += reader()
                service()
            sums[channel] = total


def ratiometric(adcs):
    """Return converters whose reference is the dividers' supply (RP2040, RP2350: 12 bits).

    Args:
        adcs: Inputs with the method `read_u16` of `machine.ADC`.
    """

    def make_reader(adc):
        return lambda: adc.read_u16() >> 4

    return InternalAdc([make_reader(adc) for adc in adcs], 4096)


def calibrated(adcs, supply_mv=3300):
    """Return converters that measure volts with the calibration of the factory (ESP32).

    Args:
        adcs: Inputs with the method `read_uv` of `machine.ADC`.
        supply_mv: Supply voltage of the dividers, mV.
    """

    def make_reader(adc):
        return lambda: adc.read_uv() // ESP32_COUNT_UV

    return InternalAdc([make_reader(adc) for adc in adcs], supply_mv * 1000 // ESP32_COUNT_UV)
