"""One browser that shows a page: the messages that wait for it, and the threads of its requests."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import msgspec

from .messages import Arrays, Event, encode_arrays

#: Of messages to one browser that it has not read; a page that reads has far fewer.
_MAX_UNREAD_MESSAGES, _MAX_UNREAD_BYTES = 2000, 128 * 1024 * 1024


@dataclass
class PartialUpload:
    """An uploaded file that has arrived in part.

    Attributes:
        name: Its name.
        size: Its announced size, bytes.
        content: What has arrived.
    """

    name: str
    size: int
    content: bytearray = field(default_factory=bytearray)


class Client:
    """A browser that shows the page.

    Messages that it has not received yet are replaced by newer ones of their kind, so that a slow
    browser gets fewer of them and none that is outdated. A browser that asks and does not read is
    disconnected.

    Attributes:
        is_open: Whether the connection is open.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, connection: Any) -> None:
        self._loop, self._connection = loop, connection
        self._waiting: dict[object, str | bytes] = {}
        self._waiting_bytes = 0
        self._has_waiting = asyncio.Event()
        self._lock = threading.Lock()
        self._lanes: dict[str, ThreadPoolExecutor] = {}
        self.is_open = True
        self.pending_requests = 0
        self.upload: tuple[int, PartialUpload] | None = None

    def send(self, event: Event) -> None:
        """Send an event; call it from any thread."""
        kind = event.__struct_config__.tag
        self.post(kind if event.is_kept else object(), msgspec.json.encode(event).decode())

    def send_arrays(self, arrays: Arrays, reply_to: int | None = None) -> None:
        """Send arrays; call it from any thread."""
        key = ("arrays", arrays.name) if reply_to is None else object()
        self.post(key, encode_arrays(arrays, reply_to))

    def post(self, key: object, content: str | bytes) -> None:
        """Send a message, which replaces a waiting one with the same key."""
        with self._lock:
            if not self.is_open:
                return
            self._waiting_bytes += len(content) - len(self._waiting.pop(key, b""))
            self._waiting[key] = content
            is_stuck = (
                len(self._waiting) > _MAX_UNREAD_MESSAGES or self._waiting_bytes > _MAX_UNREAD_BYTES
            )
            if is_stuck:
                self.is_open = False
                self._forget_waiting()
        try:
            self._loop.call_soon_threadsafe(
                self._connection.transport.abort if is_stuck else self._has_waiting.set
            )
        except RuntimeError:  # the server has stopped
            return

    def run(self, lane: str, action: Any) -> None:
        """Call a function on the thread of a lane."""
        if lane not in self._lanes:
            self._lanes[lane] = ThreadPoolExecutor(1, thread_name_prefix=f"page-{lane}")
        self._lanes[lane].submit(action)

    async def pump(self) -> None:
        """Send the waiting messages until the connection ends."""
        while True:
            await self._has_waiting.wait()
            self._has_waiting.clear()
            while True:
                with self._lock:
                    if not self._waiting:
                        break
                    key = next(iter(self._waiting))
                    content = self._waiting.pop(key)
                    self._waiting_bytes -= len(content)
                await self._connection.send(content)

    def close(self) -> None:
        """Drop the waiting messages and end the threads."""
        with self._lock:
            self.is_open = False
            self._forget_waiting()
        for executor in self._lanes.values():
            executor.shutdown(wait=False, cancel_futures=True)

    def _forget_waiting(self) -> None:
        self._waiting.clear()
        self._waiting_bytes = 0
