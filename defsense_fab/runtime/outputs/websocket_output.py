"""Frames as JSON to WebSocket clients, and a page that shows them."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import logging
import socket
import threading
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import numpy as np
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from ...core.errors import OutputError
from ...core.machine.local_access import Access
from ..frames.live_frame import LiveFrame
from .settings import WebSocketSettings

# The WebSocket's server: an asyncio loop on a thread of its own, and a slot for each client.

_LONGEST = 2048  # bytes of a client's message; nothing that is meant is longer
_BUFFER = 65536  # bytes that the system keeps for a client that does not read
_PATIENCE = 10.0  # s that a client may not read before it is closed
_TOKEN_WAIT = 5.0  # s for the token in a first message
_UNDER_WAY = 200  # connections beyond the clients: requests, handshakes, refusals
_START = 10.0  # s
_PAGE = Path(__file__).with_name("websocket_page.html")
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline';"
    " connect-src 'self' ws:; base-uri 'none'; frame-ancestors 'none'"
)


@dataclass(eq=False)
class Client:
    """One that has passed: the newest text for it, and what was dropped since it did not read."""

    connection: ServerConnection
    text: str | None = None
    fresh: asyncio.Event = field(default_factory=asyncio.Event)
    dropped: int = 0

    def offer(self, text: str) -> None:
        self.dropped += self.text is not None
        self.text = text
        self.fresh.set()

    async def forward(self) -> None:
        """Send the newest text again and again; returns when the client does not read."""
        while True:
            await self.fresh.wait()
            self.fresh.clear()
            text, self.text = self.text, None
            if text is not None:
                try:
                    async with asyncio.timeout(_PATIENCE):
                        await self.connection.send(text)
                except TimeoutError:
                    return


@dataclass
class Counts:
    """`served` clients in all; `refused`: wrong origin, no token, too many; `slow`: closed because
    they did not read; `ignored` messages of clients; `dropped` frames over all clients."""

    served: int = 0
    refused: int = 0
    slow: int = 0
    ignored: int = 0
    dropped: int = 0


class WebSocketServer:
    """Serves the page at / over HTTP, and frames to WebSocket clients, on one port."""

    def __init__(self, settings: WebSocketSettings) -> None:
        """Raises OutputError where the port is taken or the host is not this machine's."""
        self.counts, self.access = Counts(), Access(settings.host, settings.token)
        self._settings, self._clients = settings, set[Client]()
        self._connected = 0
        self._page = _PAGE.read_text(encoding="utf-8")
        self._loop = asyncio.new_event_loop()
        self._stop, self._started = asyncio.Event(), threading.Event()
        self._failure: OSError | None = None
        self.port = settings.port
        self._text: str | None = None
        self._told = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="websocket", daemon=True)
        self._thread.start()
        if not self._started.wait(_START):
            raise OutputError(
                f"the server did not start within {_START:g} s",
                code="server-not-started",
                where="websocket",
                action="Try again",
            )
        if self._failure is not None:
            self._thread.join(_START)
            raise _listen_error(settings, self._failure)

    @property
    def clients(self) -> int:
        return len(self._clients)

    def publish(self, text: str) -> None:
        """From any thread: the newest text for all clients. Returns at once."""
        with self._told:
            waiting, self._text = self._text is not None, text
        if not waiting:
            with contextlib.suppress(RuntimeError):  # closed meanwhile
                self._loop.call_soon_threadsafe(self._spread)

    def close(self) -> None:
        if self._thread.is_alive():
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(_START)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._failure = error
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.close()
            self._started.set()

    async def _serve(self) -> None:
        quiet = logging.getLogger(f"{__name__}.protocol")
        quiet.disabled = True  # it would tell of everything that a stranger sends
        async with serve(
            self._client,
            self._settings.host,
            self._settings.port,
            process_request=self._request,
            create_connection=_bounded(self._settings.max_clients + _UNDER_WAY),
            compression=None,
            max_size=_LONGEST,
            max_queue=4,
            open_timeout=5,
            close_timeout=1,
            server_header=None,
            logger=quiet,
        ) as server:
            self.port = _port_of(server)
            self._started.set()
            await self._stop.wait()

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, a refusal, or None: the WebSocket may open."""
        headers = request.headers
        host, origins = headers.get_all("Host"), headers.get_all("Origin")
        why = self.access.refusal(host[0] if len(host) == 1 else "", origins)
        if why is not None:
            return self._refuse(connection, HTTPStatus.FORBIDDEN, why)
        if "websocket" not in headers.get("Upgrade", "").lower():
            if urlsplit(request.path).path != "/":
                return connection.respond(HTTPStatus.NOT_FOUND, "the page is at /\n")
            response = connection.respond(HTTPStatus.OK, self._page)
            del response.headers["Content-Type"]
            response.headers["Content-Type"] = "text/html; charset=utf-8"
            response.headers["Content-Security-Policy"] = _POLICY
            response.headers["Referrer-Policy"] = "no-referrer"
            return response
        if self._connected >= self._settings.max_clients:
            why = f"there are {self._connected} clients already (max_clients)"
            return self._refuse(connection, HTTPStatus.SERVICE_UNAVAILABLE, why)
        return None

    def _refuse(self, connection: ServerConnection, status: HTTPStatus, why: str) -> Response:
        self.counts.refused += 1
        return connection.respond(status, f"refused: {why}\n")

    async def _client(self, connection: ServerConnection) -> None:
        # Several may have passed the request while fewer were connected.
        if self._connected >= self._settings.max_clients:
            self.counts.refused += 1
            await connection.close(1013, "too many clients")
            return
        self._connected += 1
        try:
            with contextlib.suppress(ConnectionClosed):
                if await self._may_read(connection):
                    await self._serve_client(connection)
        finally:
            self._connected -= 1

    async def _may_read(self, connection: ServerConnection) -> bool:
        request = connection.request
        if request is not None and self.access.has_token(request.path):
            return True
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_TOKEN_WAIT):
                if self.access.is_token(_token_in(await connection.recv())):
                    return True
        self.counts.refused += 1
        await connection.close(1008, "the token is missing or wrong")
        return False

    async def _serve_client(self, connection: ServerConnection) -> None:
        transport = connection.transport
        raw = transport.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        client = Client(connection)
        self._clients.add(client)
        self.counts.served += 1
        listening = asyncio.create_task(self._listen(connection))
        forwarding = asyncio.create_task(client.forward())
        try:
            await asyncio.wait([listening, forwarding], return_when=asyncio.FIRST_COMPLETED)
            if forwarding.done() and not forwarding.exception():
                self.counts.slow += 1
                transport.abort()
        finally:
            self._clients.discard(client)
            self.counts.dropped += client.dropped
            for task in (listening, forwarding):
                task.cancel()
            await asyncio.gather(listening, forwarding, return_exceptions=True)

    async def _listen(self, connection: ServerConnection) -> None:
        """Nothing that clients say is meant for this; too long a message ends the connection."""
        async for _ in connection:
            self.counts.ignored += 1
            await asyncio.sleep(0)  # others get their turn while one client floods

    def _spread(self) -> None:
        with self._told:
            text, self._text = self._text, None
        if text is not None:
            for client in self._clients:
                client.offer(text)


def _bounded(most: int) -> type[ServerConnection]:
    """Connections of which those above `most` end at once: whoever opens thousands and says nothing
    would take all descriptors of this process, and the read-out board's port could not be opened
    again."""

    class Bounded(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            if len(self.server.handlers) > most:
                self.transport.abort()

    return Bounded


def _token_in(message: str | bytes) -> str:
    """Of a first message {"token": "..."}."""
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):
        return ""
    token = data.get("token") if isinstance(data, dict) else None
    return token if isinstance(token, str) else ""


def _port_of(server: Server) -> int:
    return int(next(iter(server.sockets)).getsockname()[1])


def _listen_error(settings: WebSocketSettings, error: OSError) -> OutputError:
    where = f"port {settings.port} on {settings.host}"
    if error.errno == errno.EADDRINUSE:
        return OutputError(
            f"{where} is in use by another program",
            code="port-busy",
            where="websocket",
            action="Close that program or set another port",
            port=settings.port,
        )
    if error.errno == errno.EACCES:
        return OutputError(
            f"{where} may only be used by an administrator",
            code="port-forbidden",
            where="websocket",
            action="Set a port above 1023",
            port=settings.port,
        )
    return OutputError(
        f"cannot listen on {where} ({error.strerror or error})",
        code="address-unavailable",
        where="websocket",
        action="Check host",
        host=settings.host,
    )


# A frame as JSON, for pages in a browser and other programs.

#: Raised when keys are renamed or change their meaning; new keys do not count.
SCHEMA = 1


def frame_json(frame: LiveFrame, markers: bool) -> str:
    """One line of JSON; what is no number is null. `markers` are rows of number, x, y, z, radius
    (mm); `level` is the quality's, 3 the best to 0 the worst; `signals` by the cords' names."""
    data = {
        "schema": SCHEMA,
        "device": frame.device,
        "number": frame.number,
        "time": frame.time,
        "quality": str(frame.quality),
        "level": frame.quality.level,
        "distance": _rounded(frame.distance),
        "lost": frame.lost,
        "controls": {name: _rounded(v) for name, v in frame.controls.items()},
        "confidence": {name: _rounded(v) for name, v in frame.confidence.items()},
        "signals": dict(zip(frame.channels, np.round(frame.signals, 6).tolist(), strict=False)),
        "notes": frame.notes,
    }
    if markers:
        places = np.column_stack([frame.markers, frame.radius]).round(3).tolist()
        data["markers"] = [[n, *row] for n, row in zip(frame.ids, places, strict=True)]
    return msgspec.json.encode(data).decode()


def _rounded(value: float) -> float:
    return round(float(value), 5)


class WebSocketOutput:
    """An `Output` to all who connect."""

    name = "websocket"

    def __init__(self, settings: WebSocketSettings) -> None:
        """Raises OutputError where the port is taken or the host is not this machine's."""
        self._settings, self._server = settings, WebSocketServer(settings)

    @property
    def url(self) -> str:
        """Of the page; the WebSocket's is the same with ws in place of http."""
        host = self._settings.host
        if host in ("0.0.0.0", "::"):  # noqa: S104  # compared, not bound
            host = _address()
        token = f"?token={self._server.access.token}" if self._server.access.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self._server.port}/{token}"

    @property
    def about(self) -> str:
        who = "" if self._server.access.local else ", for whoever has this address with its token"
        return f"websocket: page at {self.url}{who}"

    @property
    def counts(self) -> Counts:
        return self._server.counts

    @property
    def clients(self) -> int:
        return self._server.clients

    @property
    def trouble(self) -> str | None:
        if self._server.clients >= self._settings.max_clients:
            return f"websocket: {self._server.clients} clients, the most (max_clients)"
        return None

    def send(self, frame: LiveFrame) -> None:
        if self._server.clients:
            self._server.publish(frame_json(frame, self._settings.markers))

    def close(self) -> None:
        self._server.close()


def _address() -> str:
    """Of this machine, as others see it; nothing is sent for that."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address kept for documentation
        except OSError:
            return socket.gethostname()
        return str(probe.getsockname()[0])
