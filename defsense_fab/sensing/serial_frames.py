"""Frames that the read-out board sends, encoded and decoded; see `firmware/PROTOCOL.md`.

A frame is COBS (Cheshire & Baker 1999) of payload and CRC-16/CCITT-FALSE, then a zero byte.
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass

import numpy as np
from cobs import cobs

from ..core.arrays import Float
from ..core.device.boards import ADS1115

PROTOCOL = 1
#: Version of the firmware in `firmware/DefSense` (`DefSense.cpp`).
FIRMWARE_VERSION = (1, 0)
#: Sum of a channel that could not be read.
NOT_READ = 0xFFFFFF
MAX_CHANNELS = 16
#: Largest count of one conversion of any converter.
MAX_COUNT = 32767
_SAMPLE, _INFO, _TEXT = b"SIT"
_SAMPLE_HEAD = struct.Struct("<BIIBBB")
_INFO_PAYLOAD = struct.Struct("<BBBBBBBHHBI")
_MAX_SAMPLE_BYTES = _SAMPLE_HEAD.size + 3 * MAX_CHANNELS + 2
_MAX_TEXT_BYTES = 100
_COUNTER_PERIOD = 1 << 32
#: A counter that increases by up to this is accepted at once.
_MAX_COUNTER_STEP = 1000


@dataclass(frozen=True)
class Sample:
    """One sample of all channels.

    Attributes:
        counter: Number of the sample; wraps at 2^32.
        micros: Time of the board's clock, us; wraps at 2^32.
        led: Whether the board's LED was on.
        late: Whether the sample was late.
        averages: Conversions per channel.
        sums: Sum of the conversions of each channel, NOT_READ where a converter did not answer.
    """

    counter: int
    micros: int
    led: bool
    late: bool
    averages: int
    sums: tuple[int, ...]

    @property
    def counts(self) -> Float:
        """Mean counts of a conversion (c,), NaN where a channel was not read."""
        sums = np.array(self.sums, float)
        return np.where(sums == NOT_READ, np.nan, sums / self.averages)


@dataclass(frozen=True)
class Info:
    """Description that a read-out board gives of itself.

    Attributes:
        protocol: Version of the protocol.
        version: Version of the firmware.
        converter: 0 for the microcontroller's converter, 1 for ADS1115.
        channels: Channels in use; 0 where no converter answers.
        averages: Conversions per channel and sample.
        rate: Samples per second, Hz.
        led_period: Period of the LED, ms; 0 where it does not blink.
        most_channels: Largest number of channels.
        full_scale: Counts at the dividers' supply voltage.
    """

    protocol: int
    version: tuple[int, int]
    converter: int
    channels: int
    averages: int
    rate: int
    led_period: int
    most_channels: int
    full_scale: int

    @property
    def is_outdated(self) -> bool:
        """Whether the board's firmware is older than `FIRMWARE_VERSION`."""
        return (self.protocol, self.version) < (PROTOCOL, FIRMWARE_VERSION)


@dataclass(frozen=True)
class Text:
    """Answer in words.

    Attributes:
        text: The words, in ASCII.
    """

    text: str


Message = Sample | Info | Text


def format_version(version: tuple[int, int]) -> str:
    """Return a version of the firmware for people, such as "1.0"."""
    return ".".join(map(str, version))


def converter_code(converter: str) -> int:
    """Return the `converter` of an `Info` for the name of a converter in `CONVERTERS`."""
    return int(converter == ADS1115)


def encode(message: Message) -> bytes:
    """Return the frame of a message, with its zero byte at the end."""
    if isinstance(message, Sample):
        head = _SAMPLE_HEAD.pack(
            _SAMPLE,
            message.counter,
            message.micros,
            message.led | message.late << 1,
            message.averages,
            len(message.sums),
        )
        payload = head + b"".join(n.to_bytes(3, "little") for n in message.sums)
    elif isinstance(message, Info):
        payload = _INFO_PAYLOAD.pack(
            _INFO,
            message.protocol,
            *message.version,
            message.converter,
            message.channels,
            message.averages,
            message.rate,
            message.led_period,
            message.most_channels,
            message.full_scale,
        )
    else:
        payload = bytes([_TEXT]) + message.text.encode("ascii")
    check = binascii.crc_hqx(payload, 0xFFFF)
    return bytes(cobs.encode(payload + check.to_bytes(2, "little")) + b"\0")


def decode(frame: bytes) -> Message | None:
    """Decode a frame.

    Messages that a read-out board never sends are refused, too: the sixteen check bits alone let
    one damaged frame in 65,536 pass.

    Args:
        frame: A frame without its zero byte.

    Returns:
        The message; None for a damaged frame.
    """
    try:
        data = cobs.decode(frame)
    except cobs.DecodeError:
        return None
    payload = data[:-2]
    if len(data) < 4 or binascii.crc_hqx(payload, 0xFFFF) != int.from_bytes(data[-2:], "little"):
        return None
    if payload[0] == _SAMPLE:
        return _decode_sample(payload)
    if payload[0] == _INFO and len(payload) >= 2:
        return _decode_info(payload)
    text = payload[1:]
    if payload[0] == _TEXT and len(text) <= _MAX_TEXT_BYTES and all(31 < b < 127 for b in text):
        return Text(text.decode("ascii"))
    return None


def _decode_sample(payload: bytes) -> Sample | None:
    if len(payload) < _SAMPLE_HEAD.size:
        return None
    _, counter, micros, flags, averages, channels = _SAMPLE_HEAD.unpack_from(payload)
    if len(payload) != _SAMPLE_HEAD.size + 3 * channels or not 1 <= channels <= MAX_CHANNELS:
        return None
    if flags > 3 or averages == 0:
        return None
    sums = tuple(
        int.from_bytes(payload[i : i + 3], "little")
        for i in range(_SAMPLE_HEAD.size, len(payload), 3)
    )
    if any(n > averages * MAX_COUNT and n != NOT_READ for n in sums):
        return None
    return Sample(counter, micros, bool(flags & 1), bool(flags & 2), averages, sums)


def _decode_info(payload: bytes) -> Info | None:
    """Decode an Info; of another protocol, only the position of its version is certain."""
    if payload[1] != PROTOCOL:
        return Info(payload[1], (0, 0), 0, 0, 0, 0, 0, 0, 0)
    if len(payload) != _INFO_PAYLOAD.size:
        return None
    _, protocol, major, minor, converter, channels, averages, rate, led, limit, full = (
        _INFO_PAYLOAD.unpack(payload)
    )
    if not (channels <= limit <= MAX_CHANNELS and averages and rate and full):
        return None
    return Info(protocol, (major, minor), converter, channels, averages, rate, led, limit, full)


class Stream:
    """Extracts messages from the bytes of a port, whatever else is between them.

    A sample whose counter does not continue from the last one waits until the next sample confirms
    it: the read-out board was restarted, or many samples were lost. Two damaged frames that agree
    are not to be expected.

    Attributes:
        bad: Frames that were damaged.
        lost: Samples that are missing according to the counter.
        restarts: Times that the counter started again.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._last: int | None = None
        self._unconfirmed: Sample | None = None
        self.bad = self.lost = self.restarts = 0

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that these bytes complete."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        self._rest = self._rest[-2 * _MAX_TEXT_BYTES :]
        limit = max(_MAX_SAMPLE_BYTES, _MAX_TEXT_BYTES + 3) + 2
        out: list[Message] = []
        for frame in frames:
            if not frame:
                continue
            message = decode(frame) if len(frame) <= limit else None
            if message is None:
                self.bad += 1
            elif isinstance(message, Sample):
                out += self._accept(message)
            else:
                out.append(message)
        return out

    def _accept(self, sample: Sample) -> list[Message]:
        """Return the samples that this one confirms, itself included."""
        if self._last is not None and self._continues(self._last, sample):
            if self._unconfirmed is not None:
                self.bad += 1
            accepted = [sample]
            self.lost += (sample.counter - self._last) % _COUNTER_PERIOD - 1
        elif self._unconfirmed is not None and self._continues(self._unconfirmed.counter, sample):
            first = self._unconfirmed
            accepted = [first, sample]
            self.lost += (sample.counter - first.counter) % _COUNTER_PERIOD - 1
            ahead = 0 if self._last is None else (first.counter - self._last) % _COUNTER_PERIOD
            if self._last is not None and ahead > _COUNTER_PERIOD // 2:
                self.restarts += 1
            elif ahead:
                self.lost += ahead - 1
        else:
            if self._unconfirmed is not None:
                self.bad += 1
            self._unconfirmed = sample
            return []
        self._unconfirmed, self._last = None, sample.counter
        return list(accepted)

    @staticmethod
    def _continues(last: int, sample: Sample) -> bool:
        return 1 <= (sample.counter - last) % _COUNTER_PERIOD <= _MAX_COUNTER_STEP

    def restart(self) -> None:
        """Count a restart of the board that is known for certain; its counter starts again."""
        self.reset()
        self._last = None
        self.restarts += 1

    def reset(self) -> None:
        """Discard incomplete input after a port was opened again."""
        self._rest, self._unconfirmed = b"", None
