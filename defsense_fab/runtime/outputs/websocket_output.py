"""Send frames as JSON over a WebSocket, and serve a page that shows them."""

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
from ..frames.fixed_decoder import target_values
from ..frames.live_frame import LiveFrame, Note
from .settings import WebSocketSettings

#: Version of the JSON, increased when keys are renamed or change their meaning, not for new keys.
SCHEMA = 1

_MAX_MESSAGE_BYTES = 2048  # of a client; the token is much shorter
_SEND_BUFFER_BYTES = 65536  # that the system keeps for a client that does not read
_SLOW_CLIENT_S = 10.0  # after which a client that does not read is closed
_TOKEN_TIMEOUT_S = 5.0  # for the token in a first message
_SPARE_CONNECTIONS = 200  # beyond the clients: requests, handshakes, refusals
_START_TIMEOUT_S = 10.0
_PAGE = Path(__file__).with_name("websocket_page.html")
_CONTENT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline';"
    " connect-src 'self' ws:; base-uri 'none'; frame-ancestors 'none'"
)


def frame_json(frame: LiveFrame, markers: bool) -> str:
    """Encode a frame as one line of JSON; numbers that are not finite become null.

    Args:
        frame: The frame. `level` is that of its quality, from 3 (the best) to 0; `signals` are by
            the names of the cords.
        markers: Whether to include `markers`, rows of number, x, y, z and radius, mm.
    """
    data = {
        "schema": SCHEMA,
        "device": frame.device,
        "number": frame.number,
        "time": frame.time,
        "quality": str(frame.quality),
        "level": frame.quality.level,
        "distance": _rounded(frame.distance),
        "lost": frame.lost_channel,
        "controls": {name: _rounded(v) for name, v in frame.controls.items()},
        "confidence": {name: _rounded(v) for name, v in frame.confidence.items()},
        "signals": dict(zip(frame.channels, np.round(frame.signals, 6).tolist(), strict=False)),
        "notes": [note.text for note in frame.notes],
    }
    if markers and frame.targets is not None:
        data["targets"] = target_values(frame)
    elif markers:
        places = np.column_stack([frame.markers, frame.radius]).round(3).tolist()
        data["markers"] = [[n, *row] for n, row in zip(frame.ids, places, strict=True)]
    return msgspec.json.encode(data).decode()


def _rounded(value: float) -> float:
    return round(float(value), 5)


@dataclass(eq=False)
class Client:
    """A client that may read.

    Attributes:
        connection: Its connection.
        text: The newest text that was not sent yet, or None.
        has_text: Event that is set when there is a new text.
        dropped: Number of texts that were dropped because the client did not read.
    """

    connection: ServerConnection
    text: str | None = None
    has_text: asyncio.Event = field(default_factory=asyncio.Event)
    dropped: int = 0

    def offer(self, text: str) -> None:
        """Replace the text to send."""
        self.dropped += self.text is not None
        self.text = text
        self.has_text.set()

    async def forward(self) -> None:
        """Send the newest text repeatedly; return when the client does not read."""
        while True:
            await self.has_text.wait()
            self.has_text.clear()
            text, self.text = self.text, None
            if text is not None:
                try:
                    async with asyncio.timeout(_SLOW_CLIENT_S):
                        await self.connection.send(text)
                except TimeoutError:
                    return


@dataclass
class Counts:
    """Counts of a server.

    Attributes:
        served: Clients that were served.
        refused: Clients that were refused, for their origin, token or number.
        slow: Clients that were closed because they did not read.
        ignored: Messages of clients, which are ignored.
        dropped: Frames that were dropped, over all clients.
    """

    served: int = 0
    refused: int = 0
    slow: int = 0
    ignored: int = 0
    dropped: int = 0


class WebSocketServer:
    """An asyncio server on its own thread, which serves the page and the clients on one port.

    The page is at / over HTTP; frames go to WebSocket clients.

    Args:
        settings: Host, port, token and number of clients.

    Attributes:
        counts: Counts of clients and frames.
        access: Who may connect.
        port: The port it listens on.

    Raises:
        OutputError: The port is in use, or the host is not an address of this machine.
    """

    def __init__(self, settings: WebSocketSettings) -> None:
        self.counts, self.access = Counts(), Access(settings.host, settings.token)
        self._settings, self._clients = settings, set[Client]()
        self._connected = 0
        self._page = _PAGE.read_text(encoding="utf-8")
        self._loop = asyncio.new_event_loop()
        self._stop, self._started = asyncio.Event(), threading.Event()
        self._failure: OSError | None = None
        self.port = settings.port
        self._text: str | None = None
        self._text_lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="websocket", daemon=True)
        self._thread.start()
        if not self._started.wait(_START_TIMEOUT_S):
            raise OutputError(
                f"the server did not start within {_START_TIMEOUT_S:g} s",
                code="server-not-started",
                where="websocket",
                action="Try again",
            )
        if self._failure is not None:
            self._thread.join(_START_TIMEOUT_S)
            raise _listen_error(settings, self._failure)

    @property
    def clients(self) -> int:
        """Number of clients that are served now."""
        return len(self._clients)

    def publish(self, text: str) -> None:
        """Offer a text to all clients, from any thread; returns at once."""
        with self._text_lock:
            is_scheduled, self._text = self._text is not None, text
        if not is_scheduled:
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self._offer_text)

    def close(self) -> None:
        """Close all connections and end the thread. Idempotent."""
        if self._thread.is_alive():
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(_START_TIMEOUT_S)

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
        quiet.disabled = True  # it would log everything that strangers send
        async with serve(
            self._handle_client,
            self._settings.host,
            self._settings.port,
            process_request=self._handle_request,
            create_connection=_limited_connection(self._settings.max_clients + _SPARE_CONNECTIONS),
            compression=None,
            max_size=_MAX_MESSAGE_BYTES,
            max_queue=4,
            open_timeout=5,
            close_timeout=1,
            server_header=None,
            logger=quiet,
            start_serving=False,
        ) as server:
            # asyncio leaves the socket open if it cannot listen, unless the server is closed.
            await server.start_serving()
            self.port = _port_of(server)
            self._started.set()
            await self._stop.wait()

    def _handle_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer with the page or a refusal, or return None to open the WebSocket."""
        headers = request.headers
        host, origins = headers.get_all("Host"), headers.get_all("Origin")
        reason = self.access.refusal(host[0] if len(host) == 1 else "", origins)
        if reason is not None:
            return self._refuse(connection, HTTPStatus.FORBIDDEN, reason)
        if "websocket" not in headers.get("Upgrade", "").lower():
            if urlsplit(request.path).path != "/":
                return connection.respond(HTTPStatus.NOT_FOUND, "the page is at /\n")
            response = connection.respond(HTTPStatus.OK, self._page)
            del response.headers["Content-Type"]
            response.headers["Content-Type"] = "text/html; charset=utf-8"
            response.headers["Content-Security-Policy"] = _CONTENT_POLICY
            response.headers["Referrer-Policy"] = "no-referrer"
            return response
        if self._connected >= self._settings.max_clients:
            reason = f"there are {self._connected} clients already (max_clients)"
            return self._refuse(connection, HTTPStatus.SERVICE_UNAVAILABLE, reason)
        return None

    def _refuse(self, connection: ServerConnection, status: HTTPStatus, reason: str) -> Response:
        self.counts.refused += 1
        return connection.respond(status, f"refused: {reason}\n")

    async def _handle_client(self, connection: ServerConnection) -> None:
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
            async with asyncio.timeout(_TOKEN_TIMEOUT_S):
                if self.access.is_token(_token_in(await connection.recv())):
                    return True
        self.counts.refused += 1
        await connection.close(1008, "the token is missing or wrong")
        return False

    async def _serve_client(self, connection: ServerConnection) -> None:
        transport = connection.transport
        raw = transport.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        client = Client(connection)
        self._clients.add(client)
        self.counts.served += 1
        listening = asyncio.create_task(self._ignore_messages(connection))
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

    async def _ignore_messages(self, connection: ServerConnection) -> None:
        """Read and count the messages of a client; one that is too long ends the connection."""
        async for _ in connection:
            self.counts.ignored += 1
            await asyncio.sleep(0)  # let others run while one client floods

    def _offer_text(self) -> None:
        with self._text_lock:
            text, self._text = self._text, None
        if text is not None:
            for client in self._clients:
                client.offer(text)


def _limited_connection(max_connections: int) -> type[ServerConnection]:
    """Return a class of connections that end at once if there are too many.

    Thousands of silent connections would use all file descriptors of this process, so that the
    read-out board's port could not be opened again.
    """

    class LimitedConnection(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            if len(self.server.handlers) > max_connections:
                self.transport.abort()

    return LimitedConnection


def _token_in(message: str | bytes) -> str:
    """Return the token of a first message {"token": "..."}, or an empty text."""
    try:
        data = json.loads(message)
    except (ValueError, RecursionError):
        return ""
    token = data.get("token") if isinstance(data, dict) else None
    return token if isinstance(token, str) else ""


def _port_of(server: Server) -> int:
    return int(next(iter(server.sockets)).getsockname()[1])


def _listen_error(settings: WebSocketSettings, error: OSError) -> OutputError:
    address = f"port {settings.port} on {settings.host}"
    if error.errno == errno.EADDRINUSE:
        return OutputError(
            f"{address} is in use by another program",
            code="port-busy",
            where="websocket",
            action="Close that program or set another port",
            port=settings.port,
        )
    if error.errno == errno.EACCES:
        return OutputError(
            f"{address} may only be used by an administrator",
            code="port-forbidden",
            where="websocket",
            action="Set a port above 1023",
            port=settings.port,
        )
    return OutputError(
        f"cannot listen on {address} ({error.strerror or error})",
        code="address-unavailable",
        where="websocket",
        action="Check host",
        host=settings.host,
    )


class WebSocketOutput:
    """An `Output` to all clients that connect.

    Args:
        settings: Host, port, token, number of clients and contents.

    Raises:
        OutputError: The port is in use, or the host is not an address of this machine.
    """

    name = "websocket"

    def __init__(self, settings: WebSocketSettings) -> None:
        self._settings, self._server = settings, WebSocketServer(settings)

    @property
    def port(self) -> int:
        """The port of the server."""
        return self._server.port

    @property
    def url(self) -> str:
        """Address of the page; that of the WebSocket has ws in place of http."""
        return self._server.access.link(self._server.port)

    @property
    def about(self) -> str:
        """Description with the address of the page."""
        is_local = self._server.access.local
        readers = "" if is_local else ", for everyone who has this address with its token"
        return f"websocket: page at {self.url}{readers}"

    @property
    def counts(self) -> Counts:
        """Counts of clients and frames."""
        return self._server.counts

    @property
    def clients(self) -> int:
        """Number of clients that are served now."""
        return self._server.clients

    @property
    def trouble(self) -> Note | None:
        """A note if no further client can connect."""
        clients = self._server.clients
        if clients >= self._settings.max_clients:
            text = f"websocket: {clients} clients are connected, the limit (max_clients)"
            return Note("clients-at-limit", text, {"clients": clients})
        return None

    def send(self, frame: LiveFrame) -> None:
        """Publish a frame, if there is a client."""
        if self._server.clients:
            self._server.publish(frame_json(frame, self._settings.markers))

    def publish(self, text: str) -> None:
        """Publish an encoded frame."""
        self._server.publish(text)

    def close(self) -> None:
        """Close all connections. Idempotent."""
        self._server.close()
