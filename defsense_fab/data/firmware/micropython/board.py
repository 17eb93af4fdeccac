"""The read-out board: settings, timing of the samples, LED, and what is sent."""

from commands import execute
from frames import (
    LATE,
    LED_ON,
    MAX_CHANNELS,
    NOT_READ,
    PROTOCOL,
    VERSION_MAJOR,
    VERSION_MINOR,
    FrameBuilder,
)

DEFAULT_CHANNELS = 3
DEFAULT_RATE_HZ = 50
DEFAULT_LED_PERIOD_MS = 1000
_SEARCH_INTERVAL_MS = 1000
_MAX_PLAIN_BYTES = 14  # of a channel in a plain line
_MICROS_MASK = 0xFFFFFFFF


class Clock:
    """Microseconds since the start, modulo 2**32, from a counter that wraps earlier.

    Args:
        ticks: Module or object with `ticks_us`, `ticks_ms`, `ticks_add` and `ticks_diff` of
            MicroPython's `time`.
    """

    def __init__(self, ticks):
        self.ticks_us, self.ticks_ms = ticks.ticks_us, ticks.ticks_ms
        self.ticks_add, self.ticks_diff = ticks.ticks_add, ticks.ticks_diff
        self._last, self._micros = ticks.ticks_us(), 0

    def read_micros(self):
        """Return the time, us; call it more often than the counter wraps."""
        return self.convert(self.ticks_us())

    def convert(self, ticks):
        """Return the time, us, of a value of the counter that is not much older than the last."""
        self._micros = (self._micros + self.ticks_diff(ticks, self._last)) & _MICROS_MASK
        self._last = ticks
        return self._micros


class Settings:
    """What commands change.

    Attributes:
        channels: Number of channels that are read.
        averages: Conversions of each channel in a sample.
        rate: Samples per second, Hz.
        led_period: Time after which the LED toggles, ms; 0 if it is held.
    """

    def __init__(self, averages):
        self.channels = 0
        self.averages = averages
        self.rate = DEFAULT_RATE_HZ
        self.led_period = DEFAULT_LED_PERIOD_MS


class Board:
    """A read-out board.

    Args:
        converter: `Ads1115` or `InternalAdc`.
        clock: The board's `Clock`.
        links: Where commands come from and frames go; the serial port first.
        set_led: Function that turns the LED on or off.
        wifi: The board's `Wifi`; None without Wi-Fi.
        collect_garbage: Called after each sample, when there is time before the next one.

    Attributes:
        settings: The board's `Settings`.
        max_channels: Largest number of channels; 0 if no converter was found.
        wifi: The board's `Wifi`, or None.
    """

    def __init__(self, converter, clock, links, set_led, wifi=None, collect_garbage=None):
        self.settings = Settings(converter.averages)
        self.max_channels = 0
        self.wifi = wifi
        self._converter, self._clock, self._links = converter, clock, links
        self._set_led, self._collect_garbage = set_led, collect_garbage
        self._frames = FrameBuilder()
        self._sums = [0] * MAX_CHANNELS
        self._service = self.service  # a bound method is an object; this one is made once
        self._counter = 0
        self._searched_at = clock.ticks_ms()
        self.hold_led(False, DEFAULT_LED_PERIOD_MS)
        self._find_converter()

    def loop(self):
        """Carry out commands, and take a sample when one is due.

        Returns:
            The time until the next sample, us.
        """
        self.service()
        if self.wifi is not None:
            self.wifi.poll()
        for link in self._links:
            if link.line.is_complete and link.has_room_for_answer():
                execute(self, link)
                link.line.clear()
        clock = self._clock
        if self.settings.channels == 0:
            self._search_again()
            return self._period
        now = clock.ticks_us()
        behind = clock.ticks_diff(now, self._due)
        if behind < 0:
            return -behind
        is_late = behind > self._period
        while clock.ticks_diff(now, self._due) > self._period:  # slots that were missed
            self._next_slot()
        self._take_sample(is_late)
        self._next_slot()
        if self._collect_garbage:
            self._collect_garbage()
        return 0

    def service(self):
        """Blink and serve the links; carry out no command."""
        clock, period = self._clock, self.settings.led_period
        if period and clock.ticks_diff(clock.ticks_ms(), self._led_since) >= period:
            self._led_since = clock.ticks_add(self._led_since, period)
            self._is_led_on = not self._is_led_on
            self._set_led(self._is_led_on)
        for link in self._links:
            link.poll()

    def set_rate(self, rate):
        """Take samples at this rate, Hz, from now on."""
        self.settings.rate = rate
        self._restart()

    def blink_led(self, period):
        """Toggle the LED every `period` ms; turn it off if that is 0."""
        self.hold_led(bool(period) and self._is_led_on, period)

    def hold_led(self, is_on, period=0):
        """Turn the LED on or off, and toggle it every `period` ms if that is not 0."""
        self._is_led_on = is_on
        self._led_since = self._clock.ticks_ms()
        self.settings.led_period = period
        self._set_led(is_on)

    def send_info(self, link):
        """Answer with a description of the board."""
        converter, settings = self._converter, self.settings
        if link.is_framed or not link.is_local:
            length = self._frames.build_info(
                converter.code, settings, self.max_channels, converter.full_scale
            )
            link.send_answer(self._frames.frame, length)
            return
        parts = (  # before 1.24 MicroPython does not join f-strings in a row
            f"# defsense {VERSION_MAJOR}.{VERSION_MINOR} {converter.name}",
            f"protocol {PROTOCOL}",
            f"{settings.channels} of {self.max_channels} channels",
            f"average {settings.averages}",
            f"{settings.rate} Hz",
            f"led {settings.led_period} ms",
            f"full scale {converter.full_scale}",
        )
        link.send_plain(", ".join(parts))

    def send_text(self, link, text):
        """Answer in words."""
        if link.is_framed or not link.is_local:
            link.send_answer(self._frames.frame, self._frames.build_text(text))
        else:
            link.send_plain("# " + text)

    def _find_converter(self):
        self.max_channels = self._converter.find_channels()
        self.settings.channels = min(self.max_channels, DEFAULT_CHANNELS)
        self._restart()

    def _search_again(self):
        """Look for a converter once a second, and report that none answers."""
        now = self._clock.ticks_ms()
        if self._clock.ticks_diff(now, self._searched_at) < _SEARCH_INTERVAL_MS:
            return
        self._searched_at = now
        self._clock.read_micros()
        self._find_converter()
        link = self._links[0]
        if self.max_channels == 0 and link.has_room_for_answer():
            self.send_text(link, self._converter.missing)

    def _restart(self):
        """Start the next sample at once, and the following ones at the present rate."""
        self._period, self._remainder = divmod(1000000, self.settings.rate)
        self._fraction = 0
        self._due = self._clock.ticks_us()

    def _next_slot(self):
        self._counter = (self._counter + 1) & 0xFFFFFFFF
        step = self._period
        self._fraction += self._remainder
        if self._fraction >= self.settings.rate:
            self._fraction -= self.settings.rate
            step += 1
        self._due = self._clock.ticks_add(self._due, step)

    def _take_sample(self, is_late):
        clock, sums = self._clock, self._sums
        channels, averages = self.settings.channels, self.settings.averages
        for channel in range(channels):
            sums[channel] = 0
        flags = (LED_ON if self._is_led_on else 0) | (LATE if is_late else 0)
        started_at = clock.ticks_us()
        self._converter.read(sums, channels, averages, self._service)
        duration = clock.ticks_diff(clock.ticks_us(), started_at)
        micros = clock.convert(clock.ticks_add(started_at, duration // 2))
        length = 0
        for link in self._links:
            if link.is_framed:
                length = length or self._frames.build_sample(
                    self._counter, micros, flags, averages, channels, sums
                )
                link.send_sample(self._frames.frame, length, self._period)
            elif link.is_local and link.has_room_for_sample(_MAX_PLAIN_BYTES * channels):
                link.send_plain(self._format_plain(channels, averages))

    def _format_plain(self, channels, averages):
        """Return the mean counts of the sample with two decimals."""
        parts = []
        for channel in range(channels):
            value = self._sums[channel]
            if value == NOT_READ:
                parts.append(f"A{channel}:nan")
            else:
                hundredths = (value * 100 + averages // 2) // averages
                parts.append(f"A{channel}:{hundredths // 100}.{hundredths % 100:02d}")
        return ",".join(parts)
