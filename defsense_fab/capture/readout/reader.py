"""Read a read-out board in a thread, and reconnect after it was unplugged."""

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

#: Boards restart when their port is opened, and a boot loader may wait for two seconds.
GREETING_TIMEOUT_S = 6.0
COMMAND_RETRY_S = 0.5
REOPEN_INTERVAL_S = 0.5
#: Largest difference, us, between the board's and the host's clock over a gap.
MAX_CLOCK_DIFFERENCE_US = 2_000_000
#: A board is silent after this time, or this many sample periods if they are longer.
SILENCE_S, SILENCE_SAMPLES = 1.5, 20
COUNTER_RANGE = 1 << 32
MAX_WAITING_ITEMS = 100_000  # a quarter of an hour at 100 Hz
THREAD_JOIN_TIMEOUT_S = 5.0
_GREETING_BYTES = 400  # of an answer, kept for the error message
_QUOTED_BYTES = 40


class Transport(Protocol):
    """A two-way byte stream with the methods of pyserial's ports.

    `read` waits for a short time at most. All methods raise OSError when the other end is gone.
    """

    def read(self, size: int) -> bytes: ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...

    @property
    def in_waiting(self) -> int: ...


@dataclass(frozen=True)
class ReadoutSettings:
    """Settings requested from a read-out board; None leaves a setting as it is.

    Attributes:
        channels: Number of channels to read.
        average: Number of conversions that are summed per sample.
        rate: Samples per second, Hz.
        led: Period of the LED, ms.
    """

    channels: int | None = None
    average: int | None = None
    rate: int | None = None
    led: int | None = None

    def fits(self, sample: Sample) -> bool:
        """Return whether a sample was taken with these settings."""
        return self.channels in (None, len(sample.sums)) and self.average in (
            None,
            sample.averages,
        )

    def next_command(self, info: Info) -> str | None:
        """Return the next command that brings a board to these settings.

        Args:
            info: The board's present settings.

        Returns:
            The command; None if the board has all the settings.
        """
        for command, requested, present in (
            ("channels", self.channels, info.channels),
            ("average", self.average, info.averages),
            ("rate", self.rate, info.rate),
            ("led", self.led, info.led_period),
        ):
            if requested is not None and requested != present:
                return f"{command} {requested}"
        return None


class Reader:
    """A `Source` that reads a board through a transport.

    Frames are stamped on arrival, and the sink receives every one. If items are kept, the newest
    100,000 wait for `drain`; older ones are dropped. `statistics` counts the dropped items, and an
    event `dropped` stands in their place.

    Args:
        opener: Opens the transport; called again after a gap.
        name: Name of the source in messages, such as its port.
        settings: Settings requested from the board, or a function that chooses them by the board's
            first description of itself; by default the board keeps its own.
        keep_items: Whether items wait for `drain`; otherwise only the sink receives them.

    Attributes:
        info: The board's latest description of itself, also if `start` refused the board; None
            before `start`.
    """

    def __init__(
        self,
        opener: Callable[[], Transport],
        name: str,
        settings: ReadoutSettings | Callable[[Info], ReadoutSettings] | None = None,
        *,
        keep_items: bool = True,
    ) -> None:
        self.name = name
        self._opener, self._choose = opener, settings if callable(settings) else None
        self._settings = ReadoutSettings() if settings is None or callable(settings) else settings
        self._keep_items = keep_items
        self._items: deque[StampedSample | Event] = deque()
        self._dropped = self._dropped_since_drain = 0
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._port_lock = threading.Lock()  # a port is not closed while `send` writes to it
        self._stream, self._thread = Stream(), threading.Thread(target=self._run, daemon=True)
        self._port: Transport | None = None
        self._latest: StampedSample | None = None
        self._samples = self._gaps = 0
        self._was_reopened, self._last_sample_ns = False, 0
        self._is_in_gap = False  # from a gap until the next sample
        self._failure: Exception | None = None
        self.sink: Sink | None = None
        self.info: Info | None = None

    def start(self) -> Info:
        """Open the port, set the board up and start the thread.

        Raises:
            CaptureError: If the port is absent or busy, or if the board is silent, has other
                firmware or refuses a setting.
        """
        self._port = self._opener()
        try:
            info, early_samples = self._connect(self._port)
            self._put(Event(self._last_sample_ns, "start", _start_data(info)))
            for sample, now in early_samples:
                self._receive(sample, now)
        except BaseException:
            self._close_port()
            raise
        self._thread.start()
        return info

    def drain(self) -> list[StampedSample | Event]:
        """Return the items since the last call, or raise the error that ended the thread."""
        with self._lock:
            items = list(self._items)
            self._items.clear()
            dropped, self._dropped_since_drain = self._dropped_since_drain, 0
        if dropped:
            items.insert(0, Event(items[0].host_ns, "dropped", {"items": dropped}))
        if not items and self._failure:
            raise self._failure
        return items

    def read_latest(self, max_age: float) -> StampedSample:
        """Return the newest sample, at most `max_age` s old."""
        if self._failure:
            raise self._failure
        latest = self._latest
        if latest is None:
            raise StaleError("no sample has arrived yet", code="no-sample-yet", where=self.name)
        age = (time.monotonic_ns() - latest.host_ns) / 1e9
        if age > max_age:
            raise StaleError(
                f"the last sample is {age:.2f} s old, more than {max_age:g} s",
                code="reading-stale",
                where=self.name,
                action="Check that the read-out board is plugged in",
            )
        return latest

    def send(self, command: str) -> None:
        """Send a command line; the board's answer arrives as an event."""
        with self._port_lock:
            if self._port is not None:
                with contextlib.suppress(OSError):
                    self._port.write(command.encode("ascii") + b"\n")

    @property
    def statistics(self) -> ReadoutStatistics:
        """Counts of received and lost items."""
        s = self._stream
        return ReadoutStatistics(
            self._samples, s.lost, s.bad, self._gaps, s.restarts, self._dropped
        )

    def close(self) -> None:
        """Stop the thread and close the port.

        A thread that hangs in a driver closes the port itself when it returns, because a
        descriptor must not be closed while a thread uses it.
        """
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(THREAD_JOIN_TIMEOUT_S)
        if not self._thread.is_alive():
            self._close_port()

    def __enter__(self) -> Reader:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _close_port(self) -> None:
        with self._port_lock:
            if self._port is not None:
                with contextlib.suppress(OSError):
                    self._port.close()
                self._port = None

    def _connect(self, port: Transport) -> tuple[Info, list[tuple[Sample, int]]]:
        """Greet the board and remember its description."""
        info, early_samples = self._greet(port)
        self._last_sample_ns = time.monotonic_ns()
        return info, early_samples

    def _greet(self, port: Transport) -> tuple[Info, list[tuple[Sample, int]]]:
        """Ask for frames until the board describes itself, then send the settings.

        Returns:
            The board's description, and the samples that arrived meanwhile with their arrival
            times, ns.
        """
        started_at, sent_at, answer = time.monotonic(), 0.0, b""
        self._stream.reset()
        info: Info | None = None
        early_samples: list[tuple[Sample, int]] = []
        is_set_up, command = False, "frames"
        while time.monotonic() - started_at < GREETING_TIMEOUT_S and not self._stop.is_set():
            if time.monotonic() - sent_at > COMMAND_RETRY_S:
                sent_at = time.monotonic()
                port.write(f"\n{command}\n".encode("ascii"))
            data = self._read(port)
            answer, now = (answer + data)[-_GREETING_BYTES:], time.monotonic_ns()
            for message in self._stream.feed(data):
                if isinstance(message, Info):
                    self.info = message
                    self._check(message)
                    if self._choose is not None:
                        self._settings, self._choose = self._choose(message), None
                    info, sent_at = message, 0.0
                    next_command = self._settings.next_command(info)
                    is_set_up, command = next_command is None, next_command or command
                elif isinstance(message, Sample):
                    if self._choose is None and self._settings.fits(message):
                        early_samples.append((message, now))
                elif isinstance(message, Text) and info is not None:
                    raise CaptureError(
                        f"the read-out board refuses the command {command!r}: {message.text}",
                        code="board-command-refused",
                        where=self.name,
                        action=_update_or(info, "Choose another setting"),
                        command=command,
                    )
            if info is not None and is_set_up:
                return info, early_samples
        if info is not None:
            raise CaptureError(
                f"the read-out board does not answer the command {command!r}",
                code="board-command-unanswered",
                where=self.name,
                action=_update_or(info, "Unplug the board, plug it in and try again"),
                command=command,
            )
        raise self._silence_error(answer)

    def _check(self, info: Info) -> None:
        """Raise CaptureError for a board of another protocol or without a converter."""
        if info.protocol != PROTOCOL:
            raise CaptureError(
                f"the read-out board's firmware speaks protocol {info.protocol}, this version"
                f" reads {PROTOCOL}",
                code="firmware-protocol-differs",
                where=self.name,
                action=_update_or(info, "Update defsense-fab"),
                protocol=info.protocol,
            )
        if not info.most_channels:
            raise CaptureError(
                "the read-out board finds no ADS1115",
                code="converter-not-found",
                where=self.name,
                action="Check the converter's wiring",
            )

    def _silence_error(self, answer: bytes) -> CaptureError:
        """Explain a port on which no board described itself."""
        if not answer:
            return CaptureError(
                "nothing answers",
                code="board-silent",
                where=self.name,
                action=(
                    "Check that this is the board's port, and write the firmware with"
                    " defsense board flash if the board is new"
                ),
            )
        text = answer[-_QUOTED_BYTES:].decode("ascii", "replace")
        return CaptureError(
            f"the device does not run this firmware (it sends {text!r})",
            code="board-firmware-unknown",
            where=self.name,
            action="Write the firmware with defsense board flash, or choose another port",
            text=text,
        )

    def _read(self, port: Transport) -> bytes:
        return port.read(max(1, min(port.in_waiting, 4096)))

    def _run(self) -> None:
        try:
            self._read_until_stopped()
        except Exception as error:  # mostly a sink's; `drain` and `read_latest` raise it
            self._failure = error
        finally:
            self._close_port()

    def _read_until_stopped(self) -> None:
        while not self._stop.is_set():
            port = self._port
            if port is None:
                self._reopen()
                continue
            try:
                data = self._read(port)
            except (OSError, TypeError) as error:  # pyserial: TypeError if closed while reading
                self._start_gap(str(error))
                continue
            now = time.monotonic_ns()
            limit_ns = self._silence_limit_ns()
            if now - self._last_sample_ns > limit_ns:
                self._start_gap(f"silent: no sample for {limit_ns / 1e9:g} s; was it reset?")
                continue
            for message in self._stream.feed(data):
                if isinstance(message, Sample):
                    self._last_sample_ns = now
                    self._receive(message, now)
                elif isinstance(message, Info):
                    self.info = message
                    self._put(Event(now, "info", _info_data(message)))
                else:
                    self._put(Event(now, "text", {"text": message.text}))

    def _silence_limit_ns(self) -> float:
        """Return the time without a sample, ns, after which a board is greeted again.

        A board that was reset behind an open port sends plain lines instead of frames.
        """
        rate = self.info.rate if self.info else 1
        return 1e9 * max(SILENCE_S, SILENCE_SAMPLES / rate)

    def _start_gap(self, reason: str) -> None:
        """Close the port, so that the board is greeted again.

        A board that answers but sends no samples leads here repeatedly; that is one gap.
        """
        self._close_port()
        if self._is_in_gap:
            return
        self._is_in_gap = True
        self._gaps += 1
        self._put(Event(time.monotonic_ns(), "gap", {"why": reason}))

    def _reopen(self) -> None:
        try:
            port = self._opener()
            try:
                self._was_reopened = True
                _, early_samples = self._connect(port)
            except BaseException:
                port.close()
                raise
        except (CaptureError, OSError):
            self._stop.wait(REOPEN_INTERVAL_S)
            return
        self._port = port
        for sample, now in early_samples:  # outside of `try`: a sink's error is not the port's
            self._receive(sample, now)

    def _receive(self, sample: Sample, now: int) -> None:
        """Stamp a sample that arrived at `now`, ns, and pass it on."""
        if self._is_in_gap and self.info is not None:
            self._is_in_gap = False
            self._put(Event(now, "resumed", _start_data(self.info)))
        stamped = StampedSample(now, self._device_time(sample, now), sample)
        self._latest = stamped
        self._samples += 1
        self._put(stamped)

    def _device_time(self, sample: Sample, now: int) -> int:
        """Return the device's time, us, without wraps.

        The board was restarted if its counter started again, or if after a gap its clock does not
        fit the host's. Then the host's clock carries the device's time on.
        """
        if self._latest is None:
            return sample.micros
        previous, host_step = self._latest, (now - self._latest.host_ns) // 1000
        step = (sample.micros - previous.sample.micros) % COUNTER_RANGE
        step += max(0, round((host_step - step) / COUNTER_RANGE)) * COUNTER_RANGE
        counter_step = (sample.counter - previous.sample.counter) % COUNTER_RANGE
        clocks_differ = self._was_reopened and abs(step - host_step) > MAX_CLOCK_DIFFERENCE_US
        self._was_reopened = False
        if counter_step > COUNTER_RANGE // 2 or clocks_differ:
            self._put(Event(now, "restart", {}))
            step = max(host_step, 1)
        return previous.device_us + step

    def _put(self, item: StampedSample | Event) -> None:
        if self.sink is not None:
            self.sink(item)
        if not self._keep_items:
            return
        with self._lock:
            if len(self._items) >= MAX_WAITING_ITEMS:
                self._items.popleft()
                self._dropped += 1
                self._dropped_since_drain += 1
            self._items.append(item)


def _update_or(info: Info, action: str) -> str:
    """Return what to do about a board: update its firmware if that is older, else `action`."""
    return "Update the firmware with defsense board flash" if info.is_outdated else action


def _start_data(info: Info) -> dict[str, object]:
    """Return the data of an event after which samples follow."""
    return {**_info_data(info), "at": round(time.time(), 3)}


def _info_data(info: Info) -> dict[str, object]:
    return {**vars(info), "version": list(info.version)}
