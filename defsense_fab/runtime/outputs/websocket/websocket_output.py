"""Frames as JSON to WebSocket clients, and a page that shows them."""

from __future__ import annotations

from ...frames.live_frame import LiveFrame
from ..settings import WebSocketSettings
from .frame_json import frame_json
from .server import Counts, WebSocketServer


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
