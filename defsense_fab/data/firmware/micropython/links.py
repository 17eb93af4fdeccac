"""Where commands come from and where frames go: the serial port, or a session over Wi-Fi."""

from frames import MAX_FRAME

MAX_LINE = 40
#: `wifi` with a name of 32 bytes and a password of 63 bytes, all of them percent-encoded.
MAX_WIFI_LINE = 300
_QUEUE_SIZE = 1024
_READ_SIZE = 64
_LINE_FEED, _CARRIAGE_RETURN = 10, 13


class OutputQueue:
    """Bytes on their way out, so that sampling never waits for a port.

    Args:
        write: Function that takes some bytes, without waiting, and returns how many it took.
        size: Largest number of bytes, plus one.
    """

    def __init__(self, write, size=_QUEUE_SIZE):
        self._write = write
        self._size = size
        self._ring = bytearray(size)
        self._view = memoryview(self._ring)
        self._head = self._tail = 0

    def count_room(self):
        """Return the number of bytes that can be added."""
        return (self._tail - self._head - 1) % self._size

    def push(self, data, length):
        """Add the first `length` bytes of `data`; return False if there is no room for them."""
        if self.count_room() < length:
            return False
        head, first = self._head, min(length, self._size - self._head)
        view = memoryview(data)
        self._view[head : head + first] = view[:first]
        if first < length:
            self._view[: length - first] = view[first:length]
        self._head = (head + length) % self._size
        return True

    def drain(self):
        """Write as much as is taken without waiting."""
        tail, head = self._tail, self._head
        if tail != head:
            end = head if head > tail else self._size
            self._tail = (tail + self._write(self._view[tail:end])) % self._size

    def clear(self):
        """Discard all bytes."""
        self._head = self._tail = 0


class LineReader:
    """Collects a command line.

    Args:
        max_length: Largest number of characters; longer lines are bad.

    Attributes:
        is_complete: Whether a line has ended.
        is_bad: Whether the line is too long or has characters that are not printable.
    """

    def __init__(self, max_length):
        self._line = bytearray(max_length)
        self.clear()

    def add(self, byte):
        """Add a byte to a line that is not complete."""
        if byte in (_LINE_FEED, _CARRIAGE_RETURN):
            # An empty line is the other half of \r\n.
            self.is_complete = self._length > 0 or self.is_bad
        elif self._length == len(self._line) or not 32 <= byte <= 126:
            self.is_bad = True
        else:
            self._line[self._length] = byte
            self._length += 1

    def read_line(self):
        """Return the line."""
        return bytes(self._line[: self._length]).decode()

    def clear(self):
        """Start the next line."""
        self._length = 0
        self.is_complete = self.is_bad = False


class SerialLink:
    """The serial port.

    Args:
        port: Port with the method `readinto(buffer)`, which returns a number of bytes, and
            `write(data)`, which returns how many bytes it took; both without waiting.

    Attributes:
        is_local: True: Wi-Fi is set up here.
        is_framed: Whether frames are sent; otherwise plain lines.
        line: The command that is being received.
    """

    is_local = True

    def __init__(self, port):
        self.is_framed = False
        self.line = LineReader(MAX_WIFI_LINE)
        self._port = port
        self._queue = OutputQueue(port.write)
        self._input = bytearray(_READ_SIZE)
        self._count = self._position = 0

    def poll(self):
        """Write what is waiting, and read until a line is complete."""
        self._queue.drain()
        while not self.line.is_complete:
            if self._position == self._count:
                self._count, self._position = self._port.readinto(self._input), 0
                if not self._count:
                    return
            self.line.add(self._input[self._position])
            self._position += 1

    def has_room_for_answer(self):
        """Return whether an answer is sure to fit."""
        return self._queue.count_room() >= 2 * MAX_FRAME

    def has_room_for_sample(self, length):
        """Return whether a sample fits without taking the room of an answer."""
        return self._queue.count_room() >= length + 2 * MAX_FRAME

    def send_answer(self, frame, length):
        """Send the frame of an answer."""
        self._queue.push(frame, length)

    def send_sample(self, frame, length, period):  # noqa: ARG002  # noqa: ARG002 - as links over Wi-Fi
        """Send the frame of a sample, or leave it out if the port is too slow.

        Args:
            frame: Buffer with the frame.
            length: Length of the frame.
            period: Time between samples, us.
        """
        if self.has_room_for_sample(length):
            self._queue.push(frame, length)

    def send_plain(self, text):
        """Send a plain line."""
        data = (text + "\r\n").encode()
        self._queue.push(data, len(data))

    def start_frames(self):
        """End the plain line that a reader may be in, and send frames from now on."""
        self._queue.push(b"\0", 1)
        self.is_framed = True

    def start_plain(self):
        """Send plain lines from now on."""
        if self.is_framed:
            self._queue.push(b"\r\n", 2)
        self.is_framed = False
