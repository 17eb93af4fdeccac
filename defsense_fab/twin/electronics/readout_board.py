"""The read-out board's twin: what the firmware would send, from simulated cords.

It takes the place of a serial port: the host's own code reads it and sends it commands.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import CONVERTERS
from ...sensing.serial_frames import MOST_COUNT, PROTOCOL, Info, Message, Sample, Text, encode
from ...sensing.voltage_divider import Dividers, conversion_time
from ..scenes.assumptions import assume
from .cords import DeviceCords, SpecimenTwin
from .replayed_cords import ReplayedCords

# What a read-out board's converter makes of resistances, without its wire: sums of conversions.

#: Of a converter whose steps cannot be seen.
_FINE = 500_000_000


@dataclass(frozen=True)
class BoardTraits:
    """The read-out board; its clock is `offset` + (1 + `drift`) times the cameras'."""

    steps: bool = assume(
        True, "quantisation", "", "conversions are whole counts",
        "ATmega328P and ADS1115 (core/device/device.py, CONVERTERS)", off=False,
    )  # fmt: skip
    own_noise: float = assume(
        0.5, "quantisation", "counts", "noise of a conversion, white, which evens out steps"
    )
    rate: float = assume(60.0, "read-out board", "Hz", "samples", off=60.0)
    offset: float = assume(0.35, "read-out board", "s", "its clock against the cameras'", off=0.35)
    drift: float = assume(
        60e-6, "read-out board", "1", "the same, relative: a ceramic resonator's order", off=60e-6
    )
    sync_error: float = assume(
        0.003, "sync", "s", "by which the clocks' comparison is off, standard deviation; stated"
    )


@dataclass(frozen=True)
class Converter:
    """`averages` conversions a sample, of `full_scale` counts, with dividers of `reference` (c,)
    ohm."""

    full_scale: int
    averages: int
    reference: Float

    @classmethod
    def of(cls, traits: BoardTraits, full_scale: int, averages: int, reference: Float) -> Converter:
        """The board's, or one without steps."""
        if traits.steps:
            return cls(full_scale, averages, reference)
        return cls(_FINE, 1, reference)

    def sums(self, ohm: Float, own_noise: float, rng: np.random.Generator) -> Int:
        """(n, c) of resistances (n, c) ohm."""
        counts = Dividers(self.reference, self.full_scale).counts(ohm)
        out = np.zeros(counts.shape, np.int64)
        for _ in range(self.averages):
            read = np.rint(counts + own_noise * rng.normal(size=counts.shape))
            out += np.clip(read, 0, self.full_scale).astype(np.int64)
        return out

    def resistances(self, sums: Int) -> Float:
        """Ohm (n, c), as the host has them."""
        return Dividers(self.reference, self.full_scale).resistance(sums / self.averages)


_WAIT = 0.02  # s that a read waits at most
_WORDS = {"rate": 500, "channels": 0, "average": 255, "led": 65535}


class ReadoutTwin:
    """A read-out board with its dividers on the cords of a specimen or a device; `speed` times as
    fast as real time. Its clock says `offset` + (1 + `drift`) times the seconds since it was
    made."""

    full_scale = 1024

    def __init__(
        self, specimen: SpecimenTwin | DeviceCords | ReplayedCords,
        reference: float | Float = 2200.0, speed: float = 1.0, offset: float = 0.0,
        drift: float = 0.0, converter: str = "arduino",
    ) -> None:  # fmt: skip
        self._specimen, self._speed = specimen, speed
        self._offset, self._drift = offset, drift
        count = len(specimen.channels)
        self._converter = list(CONVERTERS).index(converter)
        most, averages = CONVERTERS[converter]
        if self._converter:  # the first one is the board's own, whose firmware tells 1024
            self.full_scale = most
        self._dividers = Dividers(np.broadcast_to(reference, (count,)), self.full_scale)
        self._about = {"channels": count, "average": averages, "rate": 50, "led": 1000}
        self._most = count
        self._framed, self._line, self._out = False, b"", b""
        self.began_ns = time.monotonic_ns()
        self._done, self._counter = 0.0, 0

    def lay(self, radius: float | None, face: str) -> None:
        """Lay the specimen on a jig, now."""
        assert isinstance(self._specimen, SpecimenTwin)
        self._catch_up()
        before = self._specimen.cords.now
        self._specimen.lay(radius, face)
        self._done += self._specimen.cords.now - before  # nobody looks while hands are on it

    def lit(self, seconds: float) -> bool:
        """Whether its LED is on, so many s after it was made."""
        led = self._about["led"]
        return bool(led and int(self._clock(seconds) * 1000 / led) % 2)

    def _clock(self, seconds: float) -> float:
        return self._offset + (1 + self._drift) * seconds

    @property
    def in_waiting(self) -> int:
        self._catch_up()
        return len(self._out)

    def read(self, size: int) -> bytes:
        self._catch_up()
        if not self._out:
            passed = (time.monotonic_ns() - self.began_ns) / 1e9
            due = (self._done + 1 / self._about["rate"]) / self._speed - passed
            time.sleep(min(max(due, 0.0), _WAIT))
            self._catch_up()
        out, self._out = self._out[:size], self._out[size:]
        return out

    def write(self, data: bytes) -> int:
        *lines, self._line = (self._line + data).replace(b"\r", b"\n").split(b"\n")
        for line in filter(None, lines):
            self._obey(line.decode("ascii", "replace"))
        return len(data)

    def close(self) -> None:
        """Nothing is held."""

    def _obey(self, line: str) -> None:
        word, _, number = line.partition(" ")
        if word in _WORDS:
            most = _WORDS[word] or self._most
            if not (
                number.isdigit() and (word == "led" or int(number) > 0) and int(number) <= most
            ):
                self._say(Text(f"{word} takes 1 to {most}"))
                return
            self._about[word] = int(number)
        elif line in ("frames", "plain"):
            self._framed = line == "frames"
            self._out += b"\0" if self._framed else b"\r\n"
        elif line != "version":
            self._say(Text("unknown command, try help"))
            return
        a = self._about
        self._say(
            Info(PROTOCOL, (1, 0), self._converter, a["channels"], a["average"], a["rate"],
                 a["led"], self._most, self.full_scale)
        )  # fmt: skip

    def _say(self, message: Message) -> None:
        self._out += encode(message) if self._framed else f"# {message}\r\n".encode()

    def _catch_up(self) -> None:
        """Samples up to now; of a long pause only the last second."""
        now = (time.monotonic_ns() - self.began_ns) / 1e9 * self._speed
        step = 1 / self._about["rate"]
        while self._done + step <= now:
            behind = int((now - self._done) / step)
            if behind > self._about["rate"] * max(self._speed, 1):
                self._counter += behind - 1
                self._done += (behind - 1) * step
            if not isinstance(self._specimen, SpecimenTwin):
                self._specimen.now = self._done  # a device has moved on while nobody read
            _, ohm = self._specimen.cords.hold(step, 1 / step)
            self._done += step
            counts = self._dividers.counts(ohm[0])[: self._about["channels"]]
            if self._converter:  # its range ends below the supply's voltage
                counts = np.minimum(counts, MOST_COUNT)
            sums = np.round(counts * self._about["average"]).astype(int)
            if self._framed:
                # As the firmware has it: the time of the middle of the conversions, and the LED as
                # it was at their beginning.
                half = conversion_time(self._converter, len(sums), self._about["average"]) / 2
                micros = int(self._clock(self._done) * 1e6) % (1 << 32)
                sample = Sample(
                    self._counter % (1 << 32), micros, self.lit(self._done - half), False,
                    self._about["average"], tuple(int(s) for s in sums),
                )  # fmt: skip
                self._out += encode(sample)
            else:
                shown = (f"A{i}:{c:.2f}" for i, c in enumerate(sums / self._about["average"]))
                self._out += (",".join(shown) + "\r\n").encode()
            self._counter += 1
