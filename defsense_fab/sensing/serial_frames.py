"""What the read-out board sends: frames of `firmware/PROTOCOL.md`, packed and unpacked.

A frame is COBS (Cheshire & Baker 1999) of payload and CRC-16/CCITT-FALSE, then a zero byte.
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass

import numpy as np
from cobs import cobs

from ..core.arrays import Float

PROTOCOL = 1
#: Sum of a channel that could not be read.
NOT_READ = 0xFFFFFF
MOST_CHANNELS = 16
_SAMPLE, _INFO, _TEXT = b"SIT"
_HEAD = struct.Struct("<BIIBBB")
_ABOUT = struct.Struct("<BBBBBBBHHBI")
_LONGEST = _HEAD.size + 3 * MOST_CHANNELS + 2
_LONGEST_TEXT = 100
#: Largest count of one conversion of any converter.
MOST_COUNT = 32767


@dataclass(frozen=True)
class Sample:
    """One sample: its `counter`, the device's `micros` (both wrap at 2^32), whether its LED was on
    and whether it was `late`, and for each channel the sum of `averages` conversions, NOT_READ
    where a converter did not answer."""

    counter: int
    micros: int
    led: bool
    late: bool
    averages: int
    sums: tuple[int, ...]

    @property
    def counts(self) -> Float:
        """Mean counts of a conversion (c,), NaN where not read."""
        sums = np.array(self.sums, float)
        return np.where(sums == NOT_READ, np.nan, sums / self.averages)


@dataclass(frozen=True)
class Info:
    """What a read-out board says of itself: its protocol and firmware version, `converter` (0 the
    microcontroller's own, 1 ADS1115), channels in use and at most, averages, rate (Hz), period of
    its LED (ms, 0: still), and `full_scale`: counts at the dividers' supply voltage. Without any
    converter that answers there are no channels."""

    protocol: int
    version: tuple[int, int]
    converter: int
    channels: int
    averages: int
    rate: int
    led_period: int
    most_channels: int
    full_scale: int


@dataclass(frozen=True)
class Text:
    """An answer in words."""

    text: str


Message = Sample | Info | Text


def encode(message: Message) -> bytes:
    """The frame of a message, its zero byte at the end."""
    if isinstance(message, Sample):
        m = message
        payload = _HEAD.pack(
            _SAMPLE, m.counter, m.micros, m.led | m.late << 1, m.averages, len(m.sums)
        ) + b"".join(n.to_bytes(3, "little") for n in m.sums)
    elif isinstance(message, Info):
        i = message
        payload = _ABOUT.pack(
            _INFO, i.protocol, *i.version, i.converter, i.channels, i.averages, i.rate,
            i.led_period, i.most_channels, i.full_scale,
        )  # fmt: skip
    else:
        payload = bytes([_TEXT]) + message.text.encode("ascii")
    check = binascii.crc_hqx(payload, 0xFFFF)
    return bytes(cobs.encode(payload + check.to_bytes(2, "little")) + b"\0")


def decode(frame: bytes) -> Message | None:
    """The message of a frame without its zero byte; None for what is none. Everything that a
    read-out board never sends is refused, for sixteen bits of check alone let one damaged frame in
    65,536 pass."""
    try:
        data = cobs.decode(frame)
    except cobs.DecodeError:
        return None
    payload = data[:-2]
    if len(data) < 4 or binascii.crc_hqx(payload, 0xFFFF) != int.from_bytes(data[-2:], "little"):
        return None
    if payload[0] == _SAMPLE:
        return _sample(payload)
    if payload[0] == _INFO and len(payload) >= 2:
        return _info(payload)
    text = payload[1:]
    if payload[0] == _TEXT and len(text) <= _LONGEST_TEXT and all(31 < b < 127 for b in text):
        return Text(text.decode("ascii"))
    return None


def _sample(payload: bytes) -> Sample | None:
    if len(payload) < _HEAD.size:
        return None
    _, counter, micros, flags, averages, channels = _HEAD.unpack_from(payload)
    if len(payload) != _HEAD.size + 3 * channels or not 1 <= channels <= MOST_CHANNELS:
        return None
    if flags > 3 or averages == 0:
        return None
    sums = tuple(
        int.from_bytes(payload[i : i + 3], "little") for i in range(_HEAD.size, len(payload), 3)
    )
    if any(n > averages * MOST_COUNT and n != NOT_READ for n in sums):
        return None
    return Sample(counter, micros, bool(flags & 1), bool(flags & 2), averages, sums)


def _info(payload: bytes) -> Info | None:
    """Of another protocol only the version is certain to be where it is here."""
    if payload[1] != PROTOCOL:
        return Info(payload[1], (0, 0), 0, 0, 0, 0, 0, 0, 0)
    if len(payload) != _ABOUT.size:
        return None
    _, protocol, major, minor, converter, channels, averages, rate, led, most, full = _ABOUT.unpack(
        payload
    )
    if not (channels <= most <= MOST_CHANNELS and averages and rate and full):
        return None
    return Info(protocol, (major, minor), converter, channels, averages, rate, led, most, full)


#: A counter that goes on by up to this is taken at its word.
_NEAR = 1000
_WRAP = 1 << 32


class Stream:
    """Messages out of the bytes of a port, whatever else lies between them.

    A sample whose counter does not go on from the last one waits for the next sample to bear it
    out: the read-out board was restarted, or many were lost; two damaged frames that agree are not
    to be expected."""

    def __init__(self) -> None:
        self._rest = b""
        self._last: int | None = None
        self._doubted: Sample | None = None
        #: Frames that were none, samples that the counter misses, times that it began anew.
        self.bad = self.lost = self.restarts = 0

    def feed(self, data: bytes) -> list[Message]:
        """The messages that these bytes complete."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        self._rest = self._rest[-2 * _LONGEST_TEXT :]
        out: list[Message] = []
        for frame in frames:
            if not frame:
                continue
            message = decode(frame) if len(frame) <= max(_LONGEST, _LONGEST_TEXT + 3) + 2 else None
            if message is None:
                self.bad += 1
            elif isinstance(message, Sample):
                out += self._in_order(message)
            else:
                out.append(message)
        return out

    def _in_order(self, sample: Sample) -> list[Message]:
        if self._last is not None and self._goes_on(self._last, sample):
            if self._doubted is not None:
                self.bad += 1
            accepted = [sample]
            self.lost += (sample.counter - self._last) % _WRAP - 1
        elif self._doubted is not None and self._goes_on(self._doubted.counter, sample):
            accepted = [self._doubted, sample]
            self.lost += (sample.counter - self._doubted.counter) % _WRAP - 1
            ahead = 0 if self._last is None else (self._doubted.counter - self._last) % _WRAP
            if self._last is not None and ahead > _WRAP // 2:
                self.restarts += 1
            elif ahead:
                self.lost += ahead - 1
        else:
            if self._doubted is not None:
                self.bad += 1
            self._doubted = sample
            return []
        self._doubted, self._last = None, sample.counter
        return list(accepted)

    @staticmethod
    def _goes_on(last: int, sample: Sample) -> bool:
        return 1 <= (sample.counter - last) % _WRAP <= _NEAR

    def forget(self) -> None:
        """A port was opened anew: what comes next need not go on from before."""
        self._rest, self._doubted = b"", None
