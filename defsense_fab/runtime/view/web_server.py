"""Serve the page of an application, and exchange its messages over a WebSocket.

The server listens to this machine alone, or to everyone who has the link with its token. Each
request is checked by its headers first, since browsers send requests on behalf of any page that is
open in them: a page of another origin could otherwise steer a device or edit a design.
"""

from __future__ import annotations

import asyncio
import http
import logging
import mimetypes
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Protocol
from urllib.parse import quote, unquote, urlsplit

import msgspec

from ...core.errors import DefsenseError
from ...core.machine.local_access import Access
from .client import Client, PartialUpload
from .messages import Arrays, Event, Problem, Reply, Request, Upload, encode_arrays
from .page_guard import check_free, set_cookie, token_refusal

#: The address at which pages are served to this machine alone.
HOST = "127.0.0.1"
#: Largest size of an uploaded file.
MAX_UPLOAD_BYTES = 200 * 1024 * 1024
SOCKET_PATH = "/socket"
_MAX_MESSAGE_BYTES = 1024 * 1024
_UPLOAD_HEADER_BYTES = 4  # number of the request that announced the file
_MAX_UPLOADS = 4  # in progress at the same time
_MAX_WAITING_REQUESTS = 200  # of one browser; a page waits for answers long before
_START_TIMEOUT_S, _STOP_TIMEOUT_S = 10.0, 5.0
_HEADERS = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline';"
        " worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
#: Clients that send invalid data are closed; tracebacks of that help nobody.
_socket_log = logging.getLogger(f"{__name__}.sockets")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Download:
    """A file that a browser saves.

    Attributes:
        name: Its name.
        content: Its content.
    """

    name: str
    content: bytes


class Application(Protocol):
    """What a server shows; its methods are called on threads of the server.

    Attributes:
        decoder: Reads the requests of browsers.
    """

    decoder: msgspec.json.Decoder[Any]

    def connect(self, client: Client) -> None:
        """Greet a browser, which has got the kept events."""

    def handle(self, client: Client, request: Any) -> Any:
        """Handle a request; return a result, arrays, or None. Raises DefsenseError."""

    def receive(self, client: Client, name: str, content: bytes) -> None:
        """Handle an uploaded file. Raises DefsenseError."""

    def disconnect(self, client: Client) -> None:
        """Forget a browser."""

    def download(self, path: str) -> Download | None:
        """Return the file at a path below `/files/`, or None."""


class WebServer:
    """Serves one application's page until `close`.

    Args:
        port: The port.
        access: Who may open the page.
        host: Address to listen on.
        max_upload_bytes: Largest size of an uploaded file.

    Attributes:
        port: The port.
        clients: The browsers that show the page.

    Raises:
        OutputError: The port is in use, or the host is not an address of this machine.
    """

    def __init__(
        self, port: int, access: Access, host: str = HOST, max_upload_bytes: int = MAX_UPLOAD_BYTES
    ) -> None:
        import websockets.asyncio.server as sockets
        from websockets.exceptions import ConnectionClosed

        check_free(host, port)
        _socket_log.setLevel(logging.CRITICAL)
        self._listen, self._closed = sockets.serve, ConnectionClosed
        self.port, self._host, self._access = port, host, access
        self._max_upload_bytes = max_upload_bytes
        self._files = _read_files()
        self._kept: dict[object, str | bytes] = {}
        self._lock = threading.Lock()
        self.clients: set[Client] = set()
        self._application: Application | None = None
        self._is_started = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None  # while it listens
        self._thread: threading.Thread | None = None
        self._server: Any = None

    def listen(self) -> None:
        """Serve the files of the page; sockets wait until `start`."""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        starting = asyncio.run_coroutine_threadsafe(self._start(), self._loop)
        self._server = starting.result(_START_TIMEOUT_S)

    def start(self, application: Application) -> None:
        """Hand requests to an application, and listen if that was not done before."""
        self._application = application
        if self._loop is None:
            self.listen()
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._is_started.set)

    def publish(self, event: Event) -> None:
        """Send an event to all browsers, and keep it for later ones; call it from any thread."""
        kind, content = event.__struct_config__.tag, msgspec.json.encode(event).decode()
        self._publish(kind if event.is_kept else None, content)

    def publish_arrays(self, arrays: Arrays) -> None:
        """Send arrays to all browsers, and keep them for later ones; call it from any thread."""
        self._publish(("arrays", arrays.name), encode_arrays(arrays))

    def forget(self) -> None:
        """Forget all kept events and arrays; another page is shown."""
        with self._lock:
            self._kept.clear()

    def close(self) -> None:
        """Close all connections and stop to listen, if it listens."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None:
            return
        if self._server is not None:
            stopping = asyncio.run_coroutine_threadsafe(self._stop(), loop)
            stopping.result(_STOP_TIMEOUT_S)
        loop.call_soon_threadsafe(loop.stop)
        self._thread.join(_STOP_TIMEOUT_S)
        loop.close()

    def _publish(self, key: object, content: str | bytes) -> None:
        with self._lock:
            if key is not None:
                self._kept.pop(key, None)
                self._kept[key] = content
            clients = tuple(self.clients)
        for client in clients:
            client.post(object() if key is None else key, content)

    async def _start(self) -> Any:
        return await self._listen(
            self._serve,
            self._host,
            self.port,
            process_request=self._answer,
            max_size=_MAX_MESSAGE_BYTES,
            compression=None,
            logger=_socket_log,
        )

    async def _stop(self) -> None:
        self._is_started.set()  # waiting sockets end
        self._server.close()
        await self._server.wait_closed()

    # HTTP

    def _answer(self, connection: Any, request: Any) -> Any:
        """Refuse a request, answer it with a file, or let it open the socket (None)."""
        headers = request.headers
        host, origins = ", ".join(headers.get_all("Host")), headers.get_all("Origin")
        reason = self._access.refusal(host, origins, any_port=False) or token_refusal(
            self._access, self.port, request.path, headers.get_all("Cookie")
        )
        if reason is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, reason + "\n")
        try:
            path = unquote(urlsplit(request.path).path)
        except ValueError:  # such as "//["
            return connection.respond(http.HTTPStatus.BAD_REQUEST, "This is not an address.\n")
        if path == SOCKET_PATH:
            return None
        return self._respond(connection, path)

    def _respond(self, connection: Any, path: str) -> Any:
        response = connection.respond(http.HTTPStatus.OK, "")
        content = self._files.get("index.html" if path == "/" else path.removeprefix("/"))
        kind = mimetypes.guess_type("index.html" if path == "/" else path)[0] or "text/plain"
        if content is None and path.startswith("/files/") and self._application is not None:
            download = self._application.download(path.removeprefix("/files/"))
            if download is not None:
                content, kind = download.content, "application/octet-stream"
                name = quote(download.name)
                response.headers["Content-Disposition"] = f"attachment; filename*=UTF-8''{name}"
        if content is None:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "There is no such file.\n")
        for name in ("Content-Type", "Content-Length"):
            del response.headers[name]
        response.headers["Content-Type"] = kind
        response.headers["Content-Length"] = str(len(content))
        for name, value in _HEADERS.items():
            response.headers[name] = value
        set_cookie(self._access, self.port, response.headers)
        response.body = content
        return response

    # The socket

    async def _serve(self, connection: Any) -> None:
        await self._is_started.wait()
        if self._application is None:
            return
        client = Client(asyncio.get_running_loop(), connection)
        with self._lock:
            self.clients.add(client)
            for key, kept in self._kept.items():
                client.post(key, kept)
        application = self._application
        client.run("edit", lambda: application.connect(client))
        pump = asyncio.create_task(client.pump())
        try:
            async for message in connection:
                if isinstance(message, str):
                    self._receive(client, message)
                else:
                    self._receive_part(client, message)
        except self._closed:
            pass  # the browser is gone
        finally:
            pump.cancel()
            with self._lock:
                self.clients.discard(client)
            client.close()
            await asyncio.to_thread(application.disconnect, client)

    def _receive(self, client: Client, message: str) -> None:
        assert self._application is not None
        try:
            request = self._application.decoder.decode(message)
        except (msgspec.DecodeError, RecursionError) as error:
            problem = Problem(code="invalid-request", text=str(error), message=str(error))
            client.send(Reply(id=_number_of(message), problem=problem))
            return
        if client.pending_requests >= _MAX_WAITING_REQUESTS:
            _refuse(client, request.id, "too-many-requests", "The program is busy")
            return
        if isinstance(request, Upload):
            self._announce(client, request)
            return
        client.pending_requests += 1
        client.run(request.lane, lambda: self._handle(client, request))

    def _handle(self, client: Client, request: Request) -> None:
        assert self._application is not None
        try:
            result = self._application.handle(client, request)
        except Exception as error:  # shown on the page: the program continues
            if not isinstance(error, DefsenseError):
                _log.exception("request %s failed", type(request).__name__)
            client.send(Reply(id=request.id, problem=Problem.of(error)))
        else:
            if isinstance(result, Arrays):
                client.send_arrays(result, request.id)
            else:
                client.send(Reply(id=request.id, result=result))
        finally:
            client.pending_requests -= 1

    def _announce(self, client: Client, request: Upload) -> None:
        limit = self._max_upload_bytes
        if sum(other.upload is not None for other in self.clients) >= _MAX_UPLOADS:
            _refuse(client, request.id, "upload-running", "Other files are being sent. Try again")
        elif client.upload is not None:
            _refuse(client, request.id, "upload-running", "Another file is being sent")
        elif request.size <= 0:
            _refuse(client, request.id, "upload-empty", "The file is empty")
        elif request.size > limit:
            text = f"The file has {request.size / 2**20:,.0f} MB; {limit // 2**20} MB are allowed"
            _refuse(client, request.id, "upload-too-large", text)
        else:
            client.upload = request.id, PartialUpload(request.name, request.size)

    def _receive_part(self, client: Client, message: bytes) -> None:
        """Receive a part of an announced file; parts of a refused one are dropped."""
        number = int.from_bytes(message[:_UPLOAD_HEADER_BYTES], "little")
        if client.upload is None or client.upload[0] != number:
            return
        upload = client.upload[1]
        upload.content += message[_UPLOAD_HEADER_BYTES:]
        if len(upload.content) < upload.size:
            return
        client.upload = None
        if len(upload.content) > upload.size:
            text = "The file is larger than announced"
            _refuse(client, number, "upload-longer-than-announced", text)
            return
        client.pending_requests += 1
        client.run("edit", lambda: self._pass_on(client, number, upload))

    def _pass_on(self, client: Client, number: int, upload: PartialUpload) -> None:
        assert self._application is not None
        try:
            self._application.receive(client, upload.name, bytes(upload.content))
            client.send(Reply(id=number))
        except Exception as error:  # shown on the page: the program continues
            client.send(Reply(id=number, problem=Problem.of(error)))
        finally:
            client.pending_requests -= 1


def _read_files() -> Mapping[str, bytes]:
    """Return the files of the page by their names; no request reads anything else."""
    folder = resources.files("defsense_fab") / "data" / "web"
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.is_file()}


def _refuse(client: Client, number: int, code: str, text: str) -> None:
    client.send(Reply(id=number, problem=Problem(code=code, text=text, message=text)))


def _number_of(message: str) -> int:
    """Return the number of a request that cannot be read; 0 if it has none."""
    try:
        value = msgspec.json.decode(message)
    except (msgspec.DecodeError, RecursionError):
        return 0
    number = value.get("id") if isinstance(value, dict) else None
    return number if isinstance(number, int) else 0
