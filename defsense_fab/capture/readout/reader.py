"""A thread that reads a read-out board, whatever it hangs on, and carries on when it was
unplugged."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from ...core.errors import CaptureError
from ...sensing.serial_frames import PROTOCOL, Info, Sample, Stream, Text
from .source import Event, ReadoutStatistics, Sink, StaleError, StampedSample

#: Boards restart when their port is opened; a boot loader may wait for two seconds.
_PATIENCE = 6.0
_ASK_AGAIN = 0.5
_AGAIN = 0.5  # s between attempts to open a port that went away
_STRANGE = 2_000_000  # us by which a read-out board's clock may differ from the host's over a gap
_SILENT, _SILENT_SAMPLES = 1.5, 20  # s, or samples, that a read-out board may be silent
_WRAP = 1 << 32
_KEPT = 100_000  # items that wait to be drained: a quarter of an hour at 100 Hz
_HANGS = 5.0  # s after which a thread that does not come back is left to itself


class Transport(Protocol):
    """Bytes both ways, as pyserial's ports have them; reading waits for a short time at most and
    raises OSError when the other end is gone."""

    def read(self, size: int) -> bytes: ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...

    @property
    def in_waiting(self) -> int: ...


@dataclass(frozen=True)
class Settings:
    """What the read-out board is asked for: channels, conversions averaged, samples per second
    (Hz), period of the LED (ms); None leaves it as it is."""

    channels: int | None = None
    average: int | None = None
    rate: int | None = None
    led: int | None = None

    def fits(self, sample: Sample) -> bool:
        """Whether a sample was taken with these settings."""
        return self.channels in (None, len(sample.sums)) and self.average in (
            None,
            sample.averages,
        )

    def missing(self, info: Info) -> str | None:
        """The next command that the read-out board needs, None when it does all that it was asked
        for."""
        for command, asked, is_ in (
            ("channels", self.channels, info.channels),
            ("average", self.average, info.averages),
            ("rate", self.rate, info.rate),
            ("led", self.led, info.led_period),
        ):
            if asked is not None and asked != is_:
                return f"{command} {asked}"
        return None


class Reader:
    """A `Source` on whatever `opener` opens.

    Frames are stamped on arrival. A sink gets every one of them. For `drain` the latest 100,000
    items wait; where nobody drains, older ones are dropped: `statistics` counts them, and an event
    `dropped` stands in their place. `read_latest` tells how fresh it is.
    """

    def __init__(
        self, opener: Callable[[], Transport], name: str, settings: Settings | None = None
    ) -> None:
        self.name = name
        self._opener, self._settings = opener, settings or Settings()
        self._items: deque[StampedSample | Event] = deque()
        self._dropped = self._dropped_now = 0  # in all, and since the last `drain`
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._port_lock = threading.Lock()  # a port is not closed while `send` writes to it
        self._stream, self._thread = Stream(), threading.Thread(target=self._run, daemon=True)
        self._port: Transport | None = None
        self._latest: StampedSample | None = None
        self._samples = self._gaps = 0
        self._reopened, self._heard = False, 0
        self._away = False  # from a gap until a sample comes again
        self._failure: Exception | None = None
        self.sink: Sink | None = None
        self.info: Info | None = None

    def start(self) -> Info:
        """Open the port and set the read-out board up. Raises CaptureError where it is absent,
        busy, says nothing, or speaks something else."""
        self._port = self._opener()
        try:
            info, early = self._begin(self._port)
            self._put(Event(self._heard, "start", _told(info)))
            for sample, now in early:
                self._take(sample, now)
        except BaseException:
            self._shut()
            raise
        self._thread.start()
        return info

    def drain(self) -> list[StampedSample | Event]:
        with self._lock:
            out = list(self._items)
            self._items.clear()
            dropped, self._dropped_now = self._dropped_now, 0
        if dropped:
            out.insert(0, Event(out[0].host_ns, "dropped", {"items": dropped}))
        if not out and self._failure:
            raise self._failure
        return out

    def read_latest(self, max_age: float) -> StampedSample:
        if self._failure:
            raise self._failure
        latest = self._latest
        if latest is None:
            raise StaleError(f"{self.name}: no sample has arrived yet", code="no-sample-yet")
        age = (time.monotonic_ns() - latest.host_ns) / 1e9
        if age > max_age:
            raise StaleError(
                f"{self.name}: the last sample is {age:.2f} s old, more than {max_age:g} s; is the"
                " read-out board still plugged in?",
                code="reading-stale",
            )
        return latest

    def send(self, command: str) -> None:
        """One command line; what the read-out board answers is an event."""
        with self._port_lock:
            if self._port is not None:
                with contextlib.suppress(OSError):
                    self._port.write(command.encode("ascii") + b"\n")

    @property
    def statistics(self) -> ReadoutStatistics:
        s = self._stream
        return ReadoutStatistics(
            self._samples, s.lost, s.bad, self._gaps, s.restarts, self._dropped
        )

    def close(self) -> None:
        """End the thread and close the port. A thread that hangs in a driver is left to itself: it
        closes the port when it comes back, for a descriptor must not be closed under it."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(_HANGS)
        if not self._thread.is_alive():
            self._shut()

    def __enter__(self) -> Reader:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _shut(self) -> None:
        with self._port_lock:
            if self._port is not None:
                with contextlib.suppress(OSError):
                    self._port.close()
                self._port = None

    def _begin(self, port: Transport) -> tuple[Info, list[tuple[Sample, int]]]:
        """Greet the read-out board: what it is, and the samples that came meanwhile."""
        info, early = self._greet(port)
        self.info, self._heard = info, time.monotonic_ns()
        return info, early

    def _greet(self, port: Transport) -> tuple[Info, list[tuple[Sample, int]]]:
        """Ask for frames until the read-out board tells what it is, then for the settings; samples
        that came with them, and when."""
        begun, asked, heard = time.monotonic(), 0.0, b""
        self._stream.forget()
        info: Info | None = None
        early: list[tuple[Sample, int]] = []
        done, command = False, "frames"
        while time.monotonic() - begun < _PATIENCE and not self._stop.is_set():
            if time.monotonic() - asked > _ASK_AGAIN:
                asked = time.monotonic()
                port.write(f"\n{command}\n".encode("ascii"))
            data = self._read(port)
            heard, now = (heard + data)[-400:], time.monotonic_ns()
            for message in self._stream.feed(data):
                if isinstance(message, Info):
                    if message.protocol != PROTOCOL:
                        raise CaptureError(
                            f"{self.name}: the read-out board's firmware speaks protocol"
                            f" {message.protocol}, this version reads {PROTOCOL}: upload the"
                            " firmware of this version (firmware/), or update defsense-fab",
                            code="firmware-protocol-differs",
                            protocol=message.protocol,
                        )
                    if not message.most_channels:
                        raise CaptureError(
                            f"{self.name}: the read-out board finds no ADS1115; check its wiring",
                            code="converter-not-found",
                        )
                    info, asked = message, 0.0
                    missing = self._settings.missing(info)
                    done, command = missing is None, missing or command
                elif isinstance(message, Sample):
                    if self._settings.fits(message):
                        early.append((message, now))
                elif isinstance(message, Text) and info is not None:
                    raise CaptureError(
                        f"{self.name}: the read-out board does not take {command!r}:"
                        f" {message.text}",
                        code="board-command-refused",
                        command=command,
                    )
            if info is not None and done:
                return info, early
        if info is not None:
            raise CaptureError(
                f"{self.name}: the read-out board does not answer {command!r}",
                code="board-command-unanswered",
                command=command,
            )
        if not heard:
            raise CaptureError(
                f"{self.name}: nothing answers; is the firmware on the read-out board"
                " (firmware/), and is this its port?",
                code="board-silent",
            )
        sample = heard[-40:].decode("ascii", "replace")
        raise CaptureError(
            f"{self.name}: what answers is not this firmware (it sends {sample!r}); upload"
            " firmware/ to the read-out board, or choose another port",
            code="board-firmware-unknown",
            text=sample,
        )

    def _read(self, port: Transport) -> bytes:
        return port.read(max(1, min(port.in_waiting, 4096)))

    def _run(self) -> None:
        try:
            self._read_on()
        except Exception as error:  # a sink's, above all: told by `drain` and `read_latest`
            self._failure = error
        finally:
            self._shut()

    def _read_on(self) -> None:
        while not self._stop.is_set():
            port = self._port
            if port is None:
                self._reopen()
                continue
            try:
                data = self._read(port)
            except (OSError, TypeError) as error:  # pyserial: TypeError if closed while reading
                self._gap(str(error))
                continue
            now = time.monotonic_ns()
            if now - self._heard > self._silence():
                self._gap(f"silent: no sample for {self._silence() / 1e9:g} s; was it reset?")
                continue
            for message in self._stream.feed(data):
                if isinstance(message, Sample):
                    self._heard = now
                    self._take(message, now)
                elif isinstance(message, Info):
                    self.info = message
                    self._put(Event(now, "info", _about(message)))
                else:
                    self._put(Event(now, "text", {"text": message.text}))

    def _silence(self) -> float:
        """ns without a sample that mean something happened to the read-out board: one that was
        reset behind an open port speaks in plain lines."""
        rate = self.info.rate if self.info else 1
        return 1e9 * max(_SILENT, _SILENT_SAMPLES / rate)

    def _gap(self, why: str) -> None:
        """Close the port, to greet the read-out board anew. A board that answers and sends nothing
        comes here again and again: all that is one gap."""
        self._shut()
        if self._away:
            return
        self._away = True
        self._gaps += 1
        self._put(Event(time.monotonic_ns(), "gap", {"why": why}))

    def _reopen(self) -> None:
        try:
            port = self._opener()
            try:
                self._reopened = True
                _, early = self._begin(port)
            except BaseException:
                port.close()
                raise
        except (CaptureError, OSError):
            self._stop.wait(_AGAIN)
            return
        self._port = port
        for sample, now in early:  # a sink's error is none of the port's
            self._take(sample, now)

    def _take(self, sample: Sample, now: int) -> None:
        if self._away and self.info is not None:
            self._away = False
            self._put(Event(now, "resumed", _told(self.info)))
        stamped = StampedSample(now, self._clock(sample, now), sample)
        self._latest = stamped
        self._samples += 1
        self._put(stamped)

    def _clock(self, sample: Sample, now: int) -> int:
        """The device's clock without wraps. Where its counter begins anew, or where after a gap it
        does not fit the host's clock, the read-out board was restarted: then that carries it on."""
        if self._latest is None:
            return sample.micros
        before, host = self._latest, (now - self._latest.host_ns) // 1000
        went = (sample.micros - before.sample.micros) % _WRAP
        went += max(0, round((host - went) / _WRAP)) * _WRAP
        again = (sample.counter - before.sample.counter) % _WRAP > _WRAP // 2
        strange = self._reopened and abs(went - host) > _STRANGE
        self._reopened = False
        if again or strange:
            self._put(Event(now, "restart", {}))
            went = max(host, 1)
        return before.device_us + went

    def _put(self, item: StampedSample | Event) -> None:
        if self.sink is not None:
            self.sink(item)
        with self._lock:
            if len(self._items) >= _KEPT:
                self._items.popleft()
                self._dropped += 1
                self._dropped_now += 1
            self._items.append(item)


def _told(info: Info) -> dict[str, object]:
    """Of an event from which on samples come."""
    return {**_about(info), "at": round(time.time(), 3)}


def _about(info: Info) -> dict[str, object]:
    return {**vars(info), "version": list(info.version)}
