"""The view as an output: a page on this machine that shows every device's newest frame."""

from __future__ import annotations

from typing import Any

from ..frames.live_frame import LiveFrame
from .live_panel import LivePanel, PanelActions
from .live_scene import LiveScene
from .local_page import end_page, local_page
from .viewed_device import ViewedDevice

PORT = 8080


class LiveView:
    """An `Output` on a page at http://127.0.0.1:`port`. Raises OutputError for a port that is
    taken, and where viser is not installed."""

    name, trouble = "view", None

    def __init__(
        self, device: ViewedDevice, actions: PanelActions | None = None, port: int = PORT
    ) -> None:
        self.server: Any = local_page(port, f"{device.name} live")
        self.port = int(self.server.get_port())
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
        end_page(self.server)
