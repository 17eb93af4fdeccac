"""Serve a live view or a guided run on a page of its own."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Union

import msgspec

from ...core.errors import LiveError
from ...core.machine.local_access import Access
from ..frames.live_frame import LiveFrame
from .client import Client
from .guided_screen import GuidedScreen
from .live_messages import (
    BendTwin,
    LivePage,
    PressKey,
    RecordAnimation,
    TakeRest,
    UndoTakeRest,
    WatchLive,
)
from .live_place import Handler, LivePlace
from .messages import Request, Upload
from .panel_actions import PanelActions
from .viewed_device import ViewedDevice
from .web_server import HOST, Download, WebServer

_REQUESTS = (BendTwin, PressKey, RecordAnimation, TakeRest, UndoTakeRest, Upload, WatchLive)


class PageApplication:
    """An application with the requests of one live view, or of one guided run.

    Args:
        handlers: The requests that are handled.
        place: The place of a live view, or None.
    """

    decoder = msgspec.json.Decoder(Union[_REQUESTS])  # noqa: UP007 - of a tuple

    def __init__(
        self, handlers: Mapping[type[Request], Handler], place: LivePlace | None = None
    ) -> None:
        self._handlers, self._place = handlers, place

    def connect(self, client: Client) -> None:
        """Greet a browser, which has got the kept events."""

    def handle(self, client: Client, request: Request) -> Any:
        """Handle a request. Raises DefsenseError."""
        handler = self._handlers.get(type(request))
        if handler is None:
            raise _not_expected(type(request).__name__)
        return handler(client, request)

    def receive(self, client: Client, name: str, content: bytes) -> None:  # noqa: ARG002
        """Refuse a file."""
        raise _not_expected(name)

    def disconnect(self, client: Client) -> None:
        """Forget a browser."""
        if self._place is not None:
            self._place.disconnect(client)

    def download(self, path: str) -> Download | None:  # noqa: ARG002 - there are no files
        """Return None: there are no files."""
        return None


class LiveView:
    """An `Output` on a page of its own, or in a place on the pages of a server.

    Closing it leaves the server of a place as it was.

    Args:
        device: The device.
        actions: What the buttons do.
        place: Port of the page, or the place.

    Attributes:
        port: Port of the page; 0 in a place.
        place: The place.

    Raises:
        OutputError: The port is in use.
    """

    name, trouble = "view", None

    def __init__(self, device: ViewedDevice, actions: PanelActions, place: int | LivePlace) -> None:
        self._server: WebServer | None = None
        if isinstance(place, LivePlace):
            self.port, self.place = 0, place
        else:
            self.port = place
            self._server = WebServer(place, Access(HOST))
            self.place = LivePlace(self._server)
            _start(self._server, self.place.handlers, "live", f"{device.name} live", self.place)
        self.place.open(device, actions)

    @property
    def about(self) -> str:
        """Description with the address of the page."""
        return f"view: {self.url}"

    @property
    def url(self) -> str:
        """Address of the page; empty in a place."""
        return f"http://{HOST}:{self.port}" if self.port else ""

    def send(self, frame: LiveFrame) -> None:
        """Show a frame."""
        self.place.send(frame)

    def close(self) -> None:
        """Close the page, or remove the view from it."""
        self.place.close()
        if self._server is not None:
            self._server.close()


@dataclass(frozen=True)
class GuidedPage:
    """A page that shows a guided run.

    Attributes:
        screen: The screen of the run.
        url: Link to open in a browser.
        has_token: Whether the link contains a token, with which other machines have access.
    """

    screen: GuidedScreen
    url: str
    has_token: bool


@contextlib.contextmanager
def open_guided_page(port: int, title: str, host: str | None = None) -> Iterator[GuidedPage]:
    """Serve a page that shows a guided run until the block ends.

    Args:
        port: The port.
        title: Title of the run and of the page.
        host: Address of this machine to serve others at, or 0.0.0.0 for all; None to serve this
            machine alone.

    Raises:
        OutputError: The port is in use, or the host is not an address of this machine.
    """
    address = host or HOST
    access = Access(address)
    server = WebServer(port, access, address)
    screen = GuidedScreen(server, title)
    _start(server, screen.handlers, "guided", title)
    try:
        yield GuidedPage(screen, access.link(port), bool(access.token))
    finally:
        screen.close()
        server.close()


def _start(
    server: WebServer,
    handlers: Mapping[type[Request], Handler],
    screen: Literal["live", "guided"],
    title: str,
    place: LivePlace | None = None,
) -> None:
    server.publish(LivePage(screen=screen, title=title))
    server.start(PageApplication(handlers, place))


def _not_expected(name: str) -> LiveError:
    return LiveError(f"{name!r} is not expected here", code="not-expected")
