"""The view as an output: a page on this machine that shows every device's newest frame."""

from __future__ import annotations

import contextlib
import io
import logging
import socket
from typing import Any

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame
from .live_panel import LivePanel, PanelActions
from .live_scene import LiveScene
from .viewed_device import ViewedDevice

PORT = 8080


class LiveView:
    """An `Output` on a page at http://127.0.0.1:`port`. Raises OutputError for a port that is
    taken, and where viser is not installed."""

    name, trouble = "view", None

    def __init__(
        self, device: ViewedDevice, actions: PanelActions | None = None, port: int = PORT
    ) -> None:
        try:
            import viser
        except ImportError:
            raise OutputError(
                "--view needs viser: install it with pip install 'defsense-fab[live]'"
            ) from None
        _need_free(port)
        for noisy in ("websockets", "viser"):
            logging.getLogger(noisy).setLevel(logging.ERROR)
        with contextlib.redirect_stdout(io.StringIO()):  # it prints its address in a box
            self.server: Any = viser.ViserServer(
                host="127.0.0.1", port=port, label=f"{device.name} live", verbose=False
            )
        self.port = int(self.server.get_port())
        self.server.gui.configure_theme(
            control_layout="fixed", show_logo=False, show_share_button=False
        )
        self.panel = LivePanel(self.server, device, actions or PanelActions())
        self.scene = LiveScene(self.server, device)

    @property
    def about(self) -> str:
        return f"view: {self.url}"

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def send(self, frame: LiveFrame) -> None:
        with self.server.atomic():
            self.scene.show(frame)
            self.panel.show(frame)

    def close(self) -> None:
        self.panel.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def _need_free(port: int) -> None:
    """Viser takes the next free port without a word; a user would open another program's page."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            raise OutputError(
                f"view: port {port} is taken by another program; give another, as in --view 8090"
            ) from None
