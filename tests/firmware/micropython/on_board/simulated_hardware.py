"""Simulated clock, converters, ports and radio, in MicroPython and in CPython."""

ERROR_NO_DEVICE = 19
CONVERSION_US = 1163  # of an ADS1115 at 860 a second
I2C_BYTE_US = 23  # nine bits at 400 kHz
BYTES_PER_SECOND = 11520


class SimulatedTime:
    """`time` of MicroPython; the counter wraps after `period` us.

    Args:
        step: Time that each look at the clock takes, us.
    """

    def __init__(self, step=20, period=1 << 24):
        self.now = 0
        self._step, self._period = step, period

    def advance(self, microseconds):
        self.now += microseconds

    def ticks_us(self):
        self.now += self._step
        return self.now % self._period

    def ticks_ms(self):
        return self.now // 1000 % self._period

    def ticks_add(self, ticks, delta):
        return (ticks + delta) % self._period

    def ticks_diff(self, end, start):
        half = self._period // 2
        return (end - start + half) % self._period - half


class SimulatedAds1115:
    """A chip of which a conversion is requested by writing its config register.

    Args:
        time: The simulated time.
        values: Function of the input and the number of the conversion that returns its code.
        silent_from: Time from which it does not answer, us; None for never.
    """

    def __init__(self, time, values, silent_from=None):
        self._time, self._values, self._silent_from = time, values, silent_from
        self._register, self._count, self._ready_at, self._code = 1, 0, 0, 0
        self.conversions = []

    def _check(self):
        if self._silent_from is not None and self._time.now >= self._silent_from:
            raise OSError(ERROR_NO_DEVICE)

    def write(self, data):
        self._check()
        self._register = data[0]
        if len(data) == 3:
            assert data[0] == 1
            config = data[1] << 8 | data[2]
            assert config & 0xCFFF == 0xC3E3, hex(config)
            source = config >> 12 & 3
            self._code = self._values(source, self._count)
            self.conversions.append([self._time.now, source, self._code])
            self._count += 1
            self._ready_at = self._time.now + CONVERSION_US

    def read(self):
        self._check()
        is_ready = self._time.now >= self._ready_at
        if self._register == 1:
            return 0xC3E3 if is_ready else 0x43E3
        assert is_ready, "the result was read before the conversion had ended"
        return self._code & 0xFFFF


class SimulatedI2C:
    """A bus with chips by address."""

    def __init__(self, time, chips):
        self._time, self._chips = time, chips

    def _chip(self, address, size):
        self._time.advance(I2C_BYTE_US * (size + 1))
        if address not in self._chips:
            raise OSError(ERROR_NO_DEVICE)
        return self._chips[address]

    def writeto(self, address, data):
        self._chip(address, len(data)).write(data)
        return len(data)

    def readfrom_into(self, address, buffer):
        word = self._chip(address, len(buffer)).read()
        buffer[0], buffer[1] = word >> 8, word & 0xFF


class SimulatedPort:
    """A serial port at 115200 baud with a buffer of 128 bytes.

    Args:
        time: The simulated time.
        received: Bytes with the times at which they arrive, us: `[[time, bytes], ...]`.
        stops_at: Time from which nobody reads, us; None for never.
    """

    def __init__(self, time, received, stops_at=None):
        self._time, self._received, self._stops_at = time, received, stops_at
        self._filled, self._since = 0, 0
        self.sent = bytearray()

    def readinto(self, buffer):
        if not self._received or self._received[0][0] > self._time.now:
            return 0
        at, data = self._received.pop(0)
        if len(data) > len(buffer):
            self._received.insert(0, [at, data[len(buffer) :]])
            data = data[: len(buffer)]
        buffer[: len(data)] = data
        return len(data)

    def write(self, data):
        if self._stops_at is not None and self._time.now >= self._stops_at:
            return 0
        drained = (self._time.now - self._since) * BYTES_PER_SECOND // 1000000
        if drained:
            self._filled, self._since = max(0, self._filled - drained), self._time.now
        count = min(len(data), 128 - self._filled)
        self._filled += count
        self.sent += data[:count]
        return count


class SimulatedRadio:
    """A radio whose state follows a list: `[[time, state], ...]`, times in us."""

    def __init__(self, time, states):
        self._time, self._states = time, states
        self.calls = []

    def connect(self, name, password):
        self.calls.append([self._time.now, name, password])

    def disconnect(self):
        self.calls.append([self._time.now, None, None])

    def read_state(self):
        while len(self._states) > 1 and self._states[1][0] <= self._time.now:
            self._states.pop(0)
        return self._states[0][1]

    def read_address(self):
        return "192.168.1.20"


class SimulatedStorage:
    """Flash memory."""

    def __init__(self, values):
        self.values = values

    def load(self):
        return self.values

    def save(self, values):
        self.values = values


class SimulatedSockets:
    """Delivers packets at their times, and keeps those that the board sends.

    Args:
        time: The simulated time.
        link: The board's `NetworkLink`.
        packets: Packets with the times at which they arrive, us: `[[time, bytes], ...]`.
    """

    is_open = True

    def __init__(self, time, link, packets):
        self._time, self._link, self._packets = time, link, packets
        self.sent = []

    def poll(self):
        while self._packets and self._packets[0][0] <= self._time.now:
            self._link.receive(self._packets.pop(0)[1], self)

    def has_room(self):
        return True

    def send(self, packet):
        self.sent.append([self._time.now, packet])
