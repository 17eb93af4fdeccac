"""The serial port and the radio of ESP32 and Raspberry Pi Pico W, for `main.py`."""

# States of network.WLAN.status(). ESP32: 1010 and reasons of esp_wifi_types.h; Pico W: 3 to -3.
_JOINED = (1010, 3)
_WRONG_PASSWORD = (202, 204, 15, -3)
_NOT_FOUND = (201, 210, 211, 212, -2)
_JOINING = (1001, 1, 2)

_BYTES_PER_SECOND = 11520  # 115200 baud, 8N1
_MAX_BURST = 64  # bytes; the smallest buffer of a UART or USB port has this size


class Console:
    """The port on which MicroPython has its prompt, read and written without waiting.

    Writing is limited to 115200 baud, because a full UART waits and does not report that it is
    full.

    Args:
        stdin: `sys.stdin.buffer`.
        stdout: `sys.stdout.buffer`.
        select: The module `select`.
        clock: The board's clock.
    """

    def __init__(self, stdin, stdout, select, clock):
        self._stdin, self._stdout, self._clock = stdin, stdout, clock
        self._input, self._output = select.poll(), select.poll()
        self._input.register(stdin, select.POLLIN)
        self._output.register(stdout, select.POLLOUT)
        self._byte = bytearray(1)
        self._allowance, self._since = _MAX_BURST, clock.ticks_us()

    def readinto(self, buffer):
        """Read bytes that have arrived; return their number."""
        count = 0
        while count < len(buffer) and _is_ready(self._input):
            self._stdin.readinto(self._byte)
            buffer[count] = self._byte[0]
            count += 1
        return count

    def write(self, data):
        """Write as much as is sent without waiting; return the number of bytes."""
        now = self._clock.ticks_us()
        elapsed = min(self._clock.ticks_diff(now, self._since), 10000)
        new = elapsed * _BYTES_PER_SECOND // 1000000
        if new > 0:
            self._allowance = min(_MAX_BURST, self._allowance + new)
            self._since = now
        count = min(len(data), self._allowance)
        if count == 0 or not _is_ready(self._output):
            return 0
        written = self._stdout.write(data[:count])
        count = count if written is None else written
        self._allowance -= count
        return count


def _is_ready(poller):
    """Return whether the stream of a poller is ready, without allocating memory."""
    for _ in poller.ipoll(0):
        return True
    return False


class WlanRadio:
    """The radio as a station.

    Args:
        wlan: `network.WLAN(network.STA_IF)`.
    """

    def __init__(self, wlan):
        self._wlan = wlan
        self._has_failed = False

    def connect(self, name, password):
        """Start to join a network; it takes seconds.

        Args:
            name: Name of the network.
            password: Its password; None for an open network.
        """
        wlan = self._wlan
        try:
            wlan.active(True)
            # Power saving delays packets by up to 0.1 s. One attempt: `status` hides the reason
            # of a failure while the ESP32 tries again.
            self._configure(pm=getattr(wlan, "PM_NONE", 0))
            self._configure(reconnects=0)
            if wlan.status() in _JOINING + _JOINED:
                wlan.disconnect()
            wlan.connect(name, password)
            self._has_failed = False
        except OSError:
            self._has_failed = True

    def disconnect(self):
        """Leave the network and turn the radio off."""
        try:
            self._wlan.disconnect()
            self._wlan.active(False)
        except OSError:
            pass

    def read_state(self):
        """Return `joining`, `joined`, `wrong-password`, `not-found` or `failed`."""
        status = self._wlan.status()
        if self._has_failed:
            return "failed"
        if status in _JOINED:
            return "joined"
        if status in _JOINING:
            return "joining"
        if status in _WRONG_PASSWORD:
            return "wrong-password"
        return "not-found" if status in _NOT_FOUND else "failed"

    def read_address(self):
        """Return the board's IPv4 address."""
        return self._wlan.ifconfig()[0]

    def _configure(self, **setting):
        """Change a setting that not all boards have."""
        try:
            self._wlan.config(**setting)
        except (ValueError, OSError):
            pass
