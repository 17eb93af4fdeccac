"""Read a read-out board in a thread, and reconnect after it was unplugged."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable

from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample, Stream
from .greeting import ReadoutSettings as ReadoutSettings
from .greeting import Transport as Transport
from .greeting import check_info, greet_board, read_stamped
from .network_port import BoardIdentity, NetworkCounts, NetworkPort, board_differs
from .source import Event, ReadoutStatistics, Sink, StaleError, StampedSample

REOPEN_INTERVAL_S = 0.5
#: Largest difference, us, between the board's and the host's clock over a gap.
MAX_CLOCK_DIFFERENCE_US = 2_000_000
#: A board is silent after this time, or this many sample periods if they are longer.
SILENCE_S, SILENCE_SAMPLES = 1.5, 20
COUNTER_RANGE = 1 << 32
MAX_WAITING_ITEMS = 100_000  # a quarter of an hour at 100 Hz
THREAD_JOIN_TIMEOUT_S = 5.0
#: Errors of a board that answers but is not the one that was read before.
WRONG_BOARD_CODES = ("board-differs", "pairing-key-differs", "board-not-paired")


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
        board: The identity of a board with Wi-Fi; None before `start`, and for serial ports.
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
        self._gap_reason = ""  # why the board that answers in a gap is not read
        self._failure: Exception | None = None
        self._has_restarted = False  # since the last sample, by the board's boot id
        self._network = NetworkCounts()  # of connections that were closed
        self.sink: Sink | None = None
        self.info: Info | None = None
        self.board: BoardIdentity | None = None

    def start(self) -> Info:
        """Open the port, set the board up and start the thread.

        Raises:
            CaptureError: If the port is absent or busy, or if the board is silent, has other
                firmware, refuses a setting or is disconnected; for boards with Wi-Fi, if the host
                is not known, the board is not paired, or its key differs.
        """
        self._port = self._opener()
        try:
            info, early_samples = self._connect(self._port)
            self._put(Event(self._last_sample_ns, "start", self._start_data(info)))
            for sample, now in early_samples:
                self._receive(sample, now)
        except OSError as error:
            self._close_port()
            raise CaptureError(
                f"the connection to the board ended ({error})",
                code="port-disconnected",
                where=self.name,
                action="Check that the board is on and connected, and try again",
            ) from None
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
        network = None
        if self.board is not None:
            with self._port_lock:
                counts = self._network.copy()
                if isinstance(self._port, NetworkPort):
                    counts.add(self._port.counts)
            network = counts.statistics
        return ReadoutStatistics(
            self._samples, s.lost, s.bad, self._gaps, s.restarts, self._dropped, network
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
                if isinstance(self._port, NetworkPort):
                    self._network.add(self._port.counts)
                self._port = None

    def _connect(self, port: Transport) -> tuple[Info, list[tuple[Sample, int]]]:
        """Greet the board and remember its description and identity."""
        if isinstance(port, NetworkPort):
            self._identify(port.board)
        info, early_samples = greet_board(
            port, self._stream, self._accept_info, self.name, self._stop
        )
        self._last_sample_ns = time.monotonic_ns()
        return info, early_samples

    def _accept_info(self, info: Info) -> ReadoutSettings:
        """Remember a board's description of itself; return the settings that it is to have."""
        self.info = info
        check_info(info, self.name)
        if self._choose is not None:
            self._settings, self._choose = self._choose(info), None
        return self._settings

    def _identify(self, board: BoardIdentity) -> None:
        """Remember the identity of a board; raise CaptureError if it is another board."""
        if self.board is not None:
            if board.board_id != self.board.board_id:
                raise board_differs(self.name, self.board.board_id, board.board_id)
            if board.boot_id != self.board.boot_id:
                self._has_restarted = True
                self._stream.restart()
        self.board = board

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
                chunks = read_stamped(port)
            except (OSError, TypeError) as error:  # pyserial: TypeError if closed while reading
                self._start_gap(str(error))
                continue
            for data, arrived_ns in chunks:
                self._decode(data, arrived_ns)
            limit_ns = self._silence_limit_ns()
            if time.monotonic_ns() - self._last_sample_ns > limit_ns:
                question = "was it reset?" if self.board is None else "is it on and in reach?"
                self._start_gap(f"silent: no sample for {limit_ns / 1e9:g} s; {question}")

    def _decode(self, data: bytes, now: int) -> None:
        """Pass on the messages that these bytes, which arrived at `now`, ns, complete."""
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
        except (CaptureError, OSError) as error:
            if getattr(error, "code", "") in WRONG_BOARD_CODES:
                self._report_wrong_board(str(error))
            self._stop.wait(REOPEN_INTERVAL_S)
            return
        self._port = port
        for sample, now in early_samples:  # outside of `try`: a sink's error is not the port's
            self._receive(sample, now)

    def _report_wrong_board(self, reason: str) -> None:
        """State once why the board that answers is not read."""
        if reason != self._gap_reason:
            self._gap_reason = reason
            self._put(Event(time.monotonic_ns(), "gap", {"why": reason}))

    def _receive(self, sample: Sample, now: int) -> None:
        """Stamp a sample that arrived at `now`, ns, and pass it on."""
        if self._is_in_gap and self.info is not None:
            self._is_in_gap, self._gap_reason = False, ""
            self._put(Event(now, "resumed", self._start_data(self.info)))
        stamped = StampedSample(now, self._device_time(sample, now), sample)
        self._latest = stamped
        self._samples += 1
        self._put(stamped)

    def _device_time(self, sample: Sample, now: int) -> int:
        """Return the device's time, us, without wraps.

        Boards with Wi-Fi report restarts by their boot id. Another board was restarted if its
        counter started again, or if after a gap its clock does not fit the host's. After a restart
        the host's clock carries the device's time on.
        """
        if self._latest is None:
            return sample.micros
        previous, host_step = self._latest, (now - self._latest.host_ns) // 1000
        step = (sample.micros - previous.sample.micros) % COUNTER_RANGE
        step += max(0, round((host_step - step) / COUNTER_RANGE)) * COUNTER_RANGE
        counter_step = (sample.counter - previous.sample.counter) % COUNTER_RANGE
        if self.board is not None:
            is_restart = self._has_restarted
        else:
            clocks_differ = self._was_reopened and abs(step - host_step) > MAX_CLOCK_DIFFERENCE_US
            is_restart = counter_step > COUNTER_RANGE // 2 or clocks_differ
        self._was_reopened = self._has_restarted = False
        if is_restart:
            self._put(Event(now, "restart", {}))
            step = max(host_step, 1)
        return previous.device_us + step

    def _start_data(self, info: Info) -> dict[str, object]:
        """Return the data of an event after which samples follow."""
        board = {} if self.board is None else vars(self.board)
        return {**_info_data(info), "at": round(time.time(), 3), **board}

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


def _info_data(info: Info) -> dict[str, object]:
    return {**vars(info), "version": list(info.version)}
