"""Frames of the serial protocol: packing into reused buffers, CRC and COBS."""

import struct

PROTOCOL = 1
VERSION_MAJOR, VERSION_MINOR = 1, 0
MAX_CHANNELS = 16
MAX_TEXT = 100
CRC_SIZE = 2
MAX_PAYLOAD = 1 + MAX_TEXT
MAX_FRAME = MAX_PAYLOAD + CRC_SIZE + 2
LED_ON, LATE = 1, 2  # flags of a sample
#: Sum of a channel that could not be read; 255 conversions of 32767 stay below it.
NOT_READ = 0xFFFFFF

_POLYNOMIAL = 0x1021
_MAX_CODE = 0xFF  # of COBS: 254 bytes without a zero, and no zero after them


def _make_table():
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = crc << 1 ^ _POLYNOMIAL if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_TABLE = _make_table()


def compute_crc(data, length):
    """Return the CRC-16/CCITT-FALSE of the first `length` bytes of `data`."""
    crc = 0xFFFF
    table = _TABLE
    for i in range(length):
        crc = (crc << 8 & 0xFF00) ^ table[crc >> 8 ^ data[i]]
    return crc


def encode_cobs(data, length, out):
    """Write the COBS code of the first `length` bytes of `data` and a zero byte to `out`.

    Args:
        data: Bytes to encode.
        length: Number of bytes.
        out: Buffer of at least `length + length // 254 + 2` bytes.

    Returns:
        The number of bytes written.
    """
    code = 0  # position of the distance to the next zero
    end = 1
    for i in range(length):
        byte = data[i]
        if byte:
            out[end] = byte
            end += 1
        if byte == 0 or (end - code == _MAX_CODE and i + 1 < length):
            out[code] = end - code
            code = end
            end += 1
    out[code] = end - code
    out[end] = 0
    return end + 1


def decode_cobs(data, length):
    """Return the bytes of a COBS code, given without its zero byte; None if it is not valid."""
    out = bytearray()
    position = 0
    while position < length:
        code = data[position]
        end = position + code
        if code == 0 or end > length:
            return None
        block = bytes(data[position + 1 : end])
        if 0 in block:
            return None
        out += block
        position = end
        if code != _MAX_CODE and position < length:
            out.append(0)
    return bytes(out)


class FrameBuilder:
    """Builds frames in buffers of its own, which the next frame overwrites.

    Attributes:
        frame: Buffer of the last frame.
    """

    def __init__(self):
        self._payload = bytearray(MAX_PAYLOAD + CRC_SIZE)
        self.frame = bytearray(MAX_FRAME)

    def build_sample(self, counter, micros, flags, averages, channels, sums):
        """Build the frame of a sample.

        Args:
            counter: Number of the sample since the start.
            micros: The board's clock in the middle of the conversions, us.
            flags: LED_ON and LATE.
            averages: Conversions of each channel.
            channels: Number of channels.
            sums: Sum of the conversions of each channel, or NOT_READ.

        Returns:
            The frame's length.
        """
        payload = self._payload
        struct.pack_into("<BIIBBB", payload, 0, 0x53, counter, micros, flags, averages, channels)
        end = 12
        for channel in range(channels):
            value = sums[channel]
            payload[end] = value & 0xFF
            payload[end + 1] = value >> 8 & 0xFF
            payload[end + 2] = value >> 16
            end += 3
        return self._finish(end)

    def build_info(self, converter, settings, max_channels, full_scale):
        """Build the frame that describes the board.

        Args:
            converter: 0 for internal converters, 1 for ADS1115.
            settings: The board's settings.
            max_channels: Largest number of channels.
            full_scale: Counts of one conversion at the dividers' supply voltage.

        Returns:
            The frame's length.
        """
        struct.pack_into(
            "<BBBBBBBHHBI",
            self._payload,
            0,
            0x49,
            PROTOCOL,
            VERSION_MAJOR,
            VERSION_MINOR,
            converter,
            settings.channels,
            settings.averages,
            settings.rate,
            settings.led_period,
            max_channels,
            full_scale,
        )
        return self._finish(16)

    def build_text(self, text):
        """Build the frame of a text, cut after 100 characters; return the frame's length."""
        data = text[:MAX_TEXT].encode()
        self._payload[0] = 0x54
        self._payload[1 : 1 + len(data)] = data
        return self._finish(1 + len(data))

    def _finish(self, length):
        """Add the CRC to the payload and encode both; return the frame's length."""
        payload = self._payload
        crc = compute_crc(payload, length)
        payload[length] = crc & 0xFF
        payload[length + 1] = crc >> 8
        return encode_cobs(payload, length + CRC_SIZE, self.frame)
