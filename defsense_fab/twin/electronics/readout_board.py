"""Simulated read-out boards: the serial protocol of the firmware, and the converter alone.

`ReadoutTwin` takes the place of a serial port: the host's own code reads it and sends it commands.
`Converter` gives the same sums of conversions as arrays, for recordings that are simulated at once.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.boards import CONVERTERS
from ...sensing.serial_frames import (
    NOT_READ,
    PROTOCOL,
    Info,
    Message,
    Sample,
    Text,
    converter_code,
    encode,
)
from ...sensing.voltage_divider import REFERENCE_OHM, Dividers, conversion_time
from ..scenes.assumptions import assume
from .cords import SpecimenTwin
from .wiring import Wiring

FloatOrArray = TypeVar("FloatOrArray", float, Float)

CONTINUOUS_FULL_SCALE = 500_000_000  # counts of a converter whose steps are negligible
MAX_READ_WAIT_S = 0.02
#: Largest arguments of the firmware's commands; 0 stands for the number of channels.
COMMAND_LIMITS = {"rate": 500, "channels": 0, "average": 255, "led": 65535}


class CordSource(Protocol):
    """Cords that a board reads, such as `SpecimenTwin`, `DeviceCords` or `ReplayedCords`."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels (c)."""
        ...

    def sample(self, start: float, step: float) -> Float:
        """Return the resistances (c,) ohm, `step` s after `start`, s."""
        ...


@dataclass(frozen=True)
class BoardTraits:
    """Assumptions on the read-out board.

    Attributes:
        steps: Whether conversions are whole counts.
        own_noise: Standard deviation of the noise of one conversion, counts.
        rate: Sample rate, Hz.
        offset: Offset of the board's clock from the cameras' clock, s.
        drift: Relative drift of the board's clock.
        sync_error: Standard deviation of the error of the clocks' synchronization, s.
    """

    steps: bool = assume(
        True,
        "quantisation",
        "",
        "conversions are whole counts",
        "full scale of each converter (core/device/boards.py, CONVERTERS)",
        off=False,
    )
    own_noise: float = assume(
        0.5, "quantisation", "counts", "white noise of a conversion, which evens out steps"
    )
    rate: float = assume(60.0, "read-out board", "Hz", "sample rate", off=60.0)
    offset: float = assume(
        0.35, "read-out board", "s", "offset of its clock from the cameras' clock", off=0.35
    )
    drift: float = assume(
        60e-6,
        "read-out board",
        "1",
        "relative drift of its clock: the order of a ceramic resonator",
        off=60e-6,
    )
    sync_error: float = assume(
        0.003,
        "sync",
        "s",
        "standard deviation of the clocks' synchronization, reported to the decoder",
    )

    def clock(self, seconds: FloatOrArray) -> FloatOrArray:
        """Return the times of the board's clock, s, at times of the cameras' clock, s."""
        return self.offset + (1 + self.drift) * seconds


@dataclass(frozen=True)
class Converter:
    """An analog-to-digital converter behind voltage dividers.

    Attributes:
        full_scale: Counts at full scale.
        averages: Conversions per sample.
        reference: Reference resistances of the dividers (c,) ohm.
    """

    full_scale: int
    averages: int
    reference: Float

    @classmethod
    def from_traits(
        cls, traits: BoardTraits, full_scale: int, averages: int, reference: Float
    ) -> Converter:
        """Return the converter of the board, or a continuous one if `traits.steps` is off."""
        if traits.steps:
            return cls(full_scale, averages, reference)
        return cls(CONTINUOUS_FULL_SCALE, 1, reference)

    def convert(self, ohm: Float, own_noise: float, rng: np.random.Generator) -> Int:
        """Return the sums of conversions.

        Args:
            ohm: Resistances (n, c) ohm.
            own_noise: Standard deviation of the noise of one conversion, counts.
            rng: Random generator.

        Returns:
            Sums (n, c) of `averages` conversions.
        """
        counts = Dividers(self.reference, self.full_scale).counts(ohm)
        sums = np.zeros(counts.shape, np.int64)
        for _ in range(self.averages):
            conversion = np.rint(counts + own_noise * rng.normal(size=counts.shape))
            sums += np.clip(conversion, 0, self.full_scale).astype(np.int64)
        return sums

    def to_resistances(self, sums: Int) -> Float:
        """Return the resistances (n, c) ohm that the host computes from sums (n, c)."""
        return Dividers(self.reference, self.full_scale).resistance(sums / self.averages)


class ReadoutTwin:
    """A read-out board with simulated cords, which speaks the protocol of the firmware.

    Args:
        source: The cords of a specimen or of a device.
        reference: Reference resistances of the dividers, ohm, one or per channel.
        speed: Simulated seconds per second.
        offset: Value of the board's clock at the start, s.
        drift: Relative drift of the board's clock.
        converter: Name of the converter, a key of `CONVERTERS`.
        wiring: Wires and converter with faults; None for ideal ones.

    Attributes:
        started_ns: Value of `time.monotonic_ns` at the start.
        full_scale: Counts of the converter at full scale.
    """

    full_scale = 1024

    def __init__(
        self,
        source: CordSource,
        reference: float | Float = REFERENCE_OHM,
        speed: float = 1.0,
        offset: float = 0.0,
        drift: float = 0.0,
        converter: str = "arduino",
        wiring: Wiring | None = None,
    ) -> None:
        self._source, self._speed, self._wiring = source, speed, wiring
        self._offset, self._drift = offset, drift
        count = len(source.channels)
        self._converter = converter_code(converter)
        full_scale, averages = CONVERTERS[converter]
        if converter != "arduino":  # which reports 1024
            self.full_scale = full_scale
        self._dividers = Dividers(np.broadcast_to(reference, (count,)), self.full_scale)
        self._settings = {"channels": count, "average": averages, "rate": 50, "led": 1000}
        self._channel_count = count
        self._is_framed, self._line, self._output = False, b"", b""
        self.started_ns = time.monotonic_ns()
        self._sampled_until, self._counter = 0.0, 0

    def place(self, radius: float | None, face: str) -> None:
        """Place the specimen on a jig now (see `SpecimenTwin.place`)."""
        assert isinstance(self._source, SpecimenTwin)
        self._catch_up()
        before = self._source.cords.time
        self._source.place(radius, face)
        # Nothing is sampled while the specimen is being placed.
        self._sampled_until += self._source.cords.time - before

    def is_led_on(self, seconds: float) -> bool:
        """Return whether the LED is on at a time since the start, s."""
        period_ms = self._settings["led"]
        return bool(period_ms and int(self._clock(seconds) * 1000 / period_ms) % 2)

    def _clock(self, seconds: float) -> float:
        return self._offset + (1 + self._drift) * seconds

    @property
    def in_waiting(self) -> int:
        """Number of bytes that can be read now."""
        self._catch_up()
        return len(self._output)

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes; wait shortly for the next sample if there are none."""
        self._catch_up()
        if not self._output:
            elapsed = (time.monotonic_ns() - self.started_ns) / 1e9
            next_sample = (self._sampled_until + 1 / self._settings["rate"]) / self._speed
            time.sleep(min(max(next_sample - elapsed, 0.0), MAX_READ_WAIT_S))
            self._catch_up()
        data, self._output = self._output[:size], self._output[size:]
        return data

    def write(self, data: bytes) -> int:
        """Receive commands, as the firmware does; return the number of bytes."""
        *lines, self._line = (self._line + data).replace(b"\r", b"\n").split(b"\n")
        for line in filter(None, lines):
            self._execute(line.decode("ascii", "replace"))
        return len(data)

    def close(self) -> None:
        """Do nothing: there are no resources to release."""

    def _execute(self, line: str) -> None:
        command, _, argument = line.partition(" ")
        if command in COMMAND_LIMITS:
            limit = COMMAND_LIMITS[command] or self._channel_count
            is_number = argument.isdigit() and (command == "led" or int(argument) > 0)
            if not (is_number and int(argument) <= limit):
                self._send(Text(f"{command} takes 1 to {limit}"))
                return
            self._settings[command] = int(argument)
        elif line in ("frames", "plain"):
            self._is_framed = line == "frames"
            self._output += b"\0" if self._is_framed else b"\r\n"
        elif line != "version":
            self._send(Text("unknown command, try help"))
            return
        s = self._settings
        self._send(
            Info(
                PROTOCOL,
                (1, 0),
                self._converter,
                s["channels"],
                s["average"],
                s["rate"],
                s["led"],
                self._channel_count,
                self.full_scale,
            )
        )

    def _send(self, message: Message) -> None:
        self._output += encode(message) if self._is_framed else f"# {message}\r\n".encode()

    def _catch_up(self) -> None:
        """Produce the samples up to now; after a long pause, only those of the last second."""
        now = (time.monotonic_ns() - self.started_ns) / 1e9 * self._speed
        rate = self._settings["rate"]
        step = 1 / rate
        while self._sampled_until + step <= now:
            missed = int((now - self._sampled_until) / step)
            if missed > rate * max(self._speed, 1):
                self._counter += missed - 1
                self._sampled_until += (missed - 1) * step
            self._sample(step)

    def _sample(self, step: float) -> None:
        """Produce the next sample, `step` s after the last one."""
        ohm = self._source.sample(self._sampled_until, step)
        self._sampled_until += step
        averages, channels = self._settings["average"], self._settings["channels"]
        if self._wiring is not None:
            sums = self._wiring.convert(ohm, self._sampled_until, averages, channels)
        else:
            counts = self._dividers.counts(ohm)[:channels]
            sums = np.round(counts * averages).astype(int)
        if self._is_framed:
            # Like the firmware: the time of the middle of the conversions, and the state of the
            # LED at their start.
            half = conversion_time(self._converter, len(sums), averages) / 2
            micros = int(self._clock(self._sampled_until) * 1e6) % (1 << 32)
            sample = Sample(
                self._counter % (1 << 32),
                micros,
                self.is_led_on(self._sampled_until - half),
                False,
                averages,
                tuple(int(s) for s in sums),
            )
            self._output += encode(sample)
        else:
            counts = np.where(sums == NOT_READ, np.nan, sums / averages)
            values = (f"A{i}:{c:.2f}" for i, c in enumerate(counts))
            self._output += (",".join(values) + "\r\n").encode()
        self._counter += 1
